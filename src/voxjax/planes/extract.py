"""`extract_planes`: the planes of a map and the surface elements that support them, in one call."""

import equinox as eqx
import numpy as np
from jaxtyping import Float32, Int32

from ..grid import VoxelGrid, check_resolution
from .chamfers import drop_chamfers
from .consolidate import drop_narrow, extend_segments, merge_segments, split_segments
from .fit import Planes, fit_planes
from .grow import keep_large, segment_planes
from .segments import plane_of_segments
from .settings import PlaneConfig
from .surface import Surface, find_surface


class PlaneMap(eqx.Module):
    """The planes of a map with their support.

    Attributes:
        planes: `Planes` in the map's frame [m], largest first; both faces of a wall are planes of their own.
        points: float32 (n, 3) [m]: voxel centres of the surface elements.
        normals: float32 (n, 3): normals of the elements, into free space.
        labels: int32 (n,): row of `planes` that each element lies on, -1 for none.
        voxel_size: Edge length of a voxel [m].
    """

    planes: Planes
    points: Float32[np.ndarray, "n 3"]
    normals: Float32[np.ndarray, "n 3"]
    labels: Int32[np.ndarray, "n"]
    voxel_size: float = eqx.field(static=True)


def extract_planes(grid: VoxelGrid, *, settings: PlaneConfig | None = None) -> PlaneMap:
    """Find the planes of a map: grow, split, merge and extend, fit.

    Region growing (section III) gives cores; pieces that are not flat are split, pieces of one plane are
    merged, and planes take in the elements that lie on them up to the edges, so that each plane is fitted
    over a whole face.

    Args:
        grid: The map.
        settings: What a plane is; None for the defaults.

    Returns:
        `PlaneMap`; without any plane where the map has none.

    Raises:
        InputError: If the map lies so far from the origin of its frame that float32 does not tell its voxels apart.
    """
    check_resolution(grid)
    chosen = PlaneConfig() if settings is None else settings
    surface = find_surface(grid, size=2 * chosen.window_radius + 1)
    labels = _cores(surface, chosen)
    # A round opens the next: merged segments have better planes, which take in elements that bring other pieces near.
    for _ in range(3):
        labels = merge_segments(
            surface,
            labels,
            # The smaller piece is held against a plane that was fitted without it, so it may be a little less
            # flat there.
            max_rms=chosen.max_rms + 0.1,
            max_angle=chosen.merge_angle,
            gap=chosen.gap,
        )
        labels = extend_segments(surface, labels, distance=chosen.tolerance)
    # Last, when faces reach to their edges: the elements of a rounded edge then go to the faces beside it.
    labels = drop_narrow(surface, labels, min_width=chosen.min_width)
    labels = drop_chamfers(surface, labels, reach=chosen.chamfer_reach)
    # What the dropped segments held is given to the faces beside them before those are counted and fitted.
    labels = extend_segments(surface, labels, distance=chosen.tolerance)
    labels = _largest_first(keep_large(labels, chosen.min_voxels), chosen.max_planes)
    points = grid.world_from_index(surface.index).astype(np.float32)
    planes = fit_planes(
        points, _away_from_edges(surface, labels), normals=surface.normal, huber_scale=0.7 * grid.voxel_size
    )
    # The fit left the rims out; the size of a face is all of it.
    count = np.zeros(len(planes.num_voxels), np.int32)
    used = np.bincount(labels[labels >= 0])
    count[: len(used)] = used
    planes = eqx.tree_at(lambda p: p.num_voxels, planes, count)
    return PlaneMap(
        planes=planes, points=points, normals=surface.normal, labels=labels, voxel_size=grid.voxel_size
    )


def _cores(surface: Surface, settings: PlaneConfig) -> np.ndarray:
    """Flat segments to start from, in three passes: half the bounds, the bounds, and twice the curvature.

    Strict bounds first keep large faces from leaking into each other around noisy edges; each later pass takes up
    what is left: small faces, then thick walls.
    """
    labels = np.full(len(surface.index), -1, np.int32)
    for angle, curvature, smallest in ((0.7, 0.5, 30), (1.0, 1.0, 12), (1.5, 2.0, 40)):
        # Elements with a label take no part any more: infinite curvature makes them no seeds, and their pairs
        # are gone.
        is_left = labels < 0
        i, j = surface.pairs.T
        rest = eqx.tree_at(
            lambda s: (s.pairs, s.curvature),
            surface,
            (
                surface.pairs[is_left[i] & is_left[j]],
                np.where(is_left, surface.curvature, np.float32(np.inf)),
            ),
        )
        more = segment_planes(
            rest,
            max_angle=angle * settings.max_angle,
            max_curvature=curvature * settings.max_curvature,
            min_elements=smallest,
        )
        more = split_segments(
            surface,
            more,
            max_rms=settings.max_rms,
            distance=settings.tolerance,
            max_angle=20.0,
            min_elements=smallest,
        )
        labels = np.where(is_left & (more >= 0), more + labels.max(initial=-1) + 1, labels).astype(np.int32)
        labels = extend_segments(surface, labels, distance=settings.tolerance)
    return labels


def _away_from_edges(surface: Surface, labels: np.ndarray, min_cosine: float = 0.85) -> np.ndarray:
    """Labels without the elements that lean toward another face, as those of one row beside an edge do.

    A single such row, one voxel off, turns the plane of a face ten voxels wide by four degrees.
    """
    num = int(labels.max(initial=-1)) + 1
    if num == 0:
        return labels
    normal = plane_of_segments(surface.index.astype(np.float64), surface.normal, labels, num).normal
    agrees = (labels >= 0) & (np.abs(np.einsum("ij,ij->i", surface.normal, normal[labels])) > min_cosine)
    # A face most of whose elements lean, such as a narrow one, would be left with nothing to fit: it keeps them all.
    is_enough = np.bincount(labels[agrees], minlength=num) >= 0.5 * np.bincount(
        labels[labels >= 0], minlength=num
    )
    return np.where(agrees | ~is_enough[labels], labels, -1).astype(np.int32)


def _largest_first(labels: np.ndarray, max_planes: int) -> np.ndarray:
    """Renumber the labels by falling size; those from `max_planes` on become -1."""
    if labels.max(initial=-1) < 0:
        return labels
    order = np.argsort(-np.bincount(labels[labels >= 0]), kind="stable")
    rank = np.empty(len(order), np.int32)
    rank[order] = np.arange(len(order), dtype=np.int32)
    rank[rank >= max_planes] = -1
    return np.where(labels >= 0, rank[labels], -1).astype(np.int32)
