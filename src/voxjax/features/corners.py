"""`detect_corners`: the corners of a map."""

from typing import Literal

import equinox as eqx
import numpy as np

from .._checks import check_choice, check_count, check_positive
from .._runtime.buckets import bucket_size, pad_rows
from .._runtime.forks import refused_after_fork
from .._runtime.memory import check_memory
from ..grid import VoxelGrid, check_grid
from ..maps.settings import MapConfig
from ..ops.blocks.windows import TILE
from ..planes.extract import PlaneMap, extract_planes
from ..planes.triples import PlaneTriples, intersect_planes
from .cluster import suppress_duplicates
from .observed import FoundCorners, observe_corners, right_handed
from .paper import paper_corners
from .types import KIND_UNKNOWN, Corners
from .uncertainty import corner_covariance

__all__ = ["Corners", "corners_of_planes", "detect_corners"]


@refused_after_fork
def detect_corners(
    grid: VoxelGrid,
    *,
    virtual: bool = False,
    preset: Literal["default", "paper"] = "default",
    virtual_reach: float = MapConfig.virtual_reach,
    max_virtual: int = 256,
) -> Corners:
    """Find the corners of a map: points where three faces meet.

    A face counts as seen where free space lies before it, so that a map without free space has no observed corners.

    Args:
        grid: The map.
        virtual: Also give points where three planes meet unseen, behind furniture or beyond what was scanned.
        preset: "default": intersections of three fitted planes whose faces lie beside the point, sub-voxel.
            "paper": section III as written; knows no virtual corners.
        virtual_reach: Planes of a virtual corner end within this of it [m].
        max_virtual: At most so many virtual corners, the strongest; `num_found` tells how many there were.

    Returns:
        `Corners`, observed ones first, then virtual ones, each strongest first; possibly none.

    Raises:
        InputError: If the preset is unknown, a length is not positive, or the map needs more memory than there is.
    """
    check_grid("grid", grid)
    check_choice("preset", preset, ("default", "paper"))
    check_positive("virtual_reach", virtual_reach, "m")
    check_count("max_virtual", max_virtual)
    _check_memory(grid, preset)
    # Kernels of float32 see the map around zero, and its corners go back to where it lies in float64.
    local, origin = grid.localized()
    if preset == "paper":
        return _placed(_padded(paper_corners(local).corners), origin)
    planes = extract_planes(local)
    corners = corners_of_planes(
        local, planes, virtual=virtual, virtual_reach=virtual_reach, max_virtual=max_virtual
    )
    return _placed(corners, origin)


def _placed(corners: Corners, origin: np.ndarray) -> Corners:
    """Corners of a local frame in the frame of the map, where the local frame's origin lies at `origin` [m]."""
    position = np.array(corners.position, np.float64)
    position[np.asarray(corners.mask)] += origin
    return eqx.tree_at(lambda c: c.position, corners, position)


def _check_memory(grid: VoxelGrid, preset: str) -> None:
    """Refuse a map for which the memory does not suffice: its file may have been a few bytes."""
    # The paper counts in the window of each voxel. Planes take 290 bytes and more for each occupied voxel of a room,
    # more where they fill a volume, and of the box no more than a tile: what is surely too much is refused, and nothing
    # else.
    num_voxels, num_occupied = float(grid.num_voxels), float(grid.num_occupied)
    need = 6.0 * num_voxels if preset == "paper" else 2.0 * min(num_voxels, TILE) + 200.0 * num_occupied
    what = f"finding corners in {num_voxels:,.0f} voxels, {num_occupied:,.0f} of them occupied,"
    check_memory(need, what, "crop the map, or take a larger voxel size")


def corners_of_planes(
    grid: VoxelGrid,
    plane_map: PlaneMap,
    *,
    virtual: bool = False,
    virtual_reach: float = MapConfig.virtual_reach,
    max_virtual: int = 256,
    min_triple_product: float = 0.4,
) -> Corners:
    """Find the corners of a map whose planes are known (`extract_planes`).

    Args:
        grid: The map.
        plane_map: Planes of the map.
        virtual: Also give virtual corners.
        virtual_reach: Planes of a virtual corner end within this of it [m].
        max_virtual: At most so many virtual corners.
        min_triple_product: Planes whose normals have a smaller triple product are nearly parallel.

    Returns:
        `Corners`.
    """
    # Faces may end some voxels before their corner, where the edge is rounded or hidden.
    beside = 7.0 * grid.voxel_size
    reach = max(virtual_reach, beside) if virtual else beside
    triples = intersect_planes(plane_map, reach=reach, min_triple_product=min_triple_product)
    normals = np.asarray(plane_map.planes.normal)[triples.planes]
    covariance = corner_covariance(plane_map, triples)
    # Only where all three faces reach the point can it be observed; the others may be virtual corners.
    near = np.flatnonzero((triples.distance <= beside).all(axis=1))
    seen = observe_corners(grid, triples.position[near], normals[near])
    observed = _observed(grid, plane_map, triples, covariance, near, seen)
    if not virtual:
        return _padded(observed)
    # Virtual corners are cut to the strongest, but all of them are counted: `num_found` tells what was left
    # out.
    hidden = _virtual(grid, plane_map, triples, covariance, normals, virtual_reach, observed)
    num_hidden = len(hidden.position)
    parts = [getattr(observed, f) for f in _FIELDS], [getattr(hidden, f)[:max_virtual] for f in _FIELDS]
    both = {f: np.concatenate(pair) for f, pair in zip(_FIELDS, zip(*parts, strict=True), strict=True)}
    return _padded(Corners(**both, num_found=np.asarray(len(observed.position) + num_hidden, np.int32)))


_FIELDS = ("position", "normals", "weight", "convexity", "mask", "is_observed", "covariance")


def _weights(plane_map: PlaneMap, triples: PlaneTriples, reach: float) -> np.ndarray:
    """How well supported: the weakest plane's width [m], less when it ends far away or the angles are flat."""
    area = np.asarray(plane_map.planes.num_voxels, np.float64)[triples.planes] * plane_map.voxel_size**2
    # A plane is extrapolated to the corner from its nearest support, and errs the more the farther that is.
    near = np.exp(-triples.distance / reach)
    return np.abs(triples.triple_product) * (np.sqrt(area) * near).min(axis=1, initial=np.inf)


def _observed(
    grid: VoxelGrid,
    plane_map: PlaneMap,
    triples: PlaneTriples,
    covariance: np.ndarray,
    near: np.ndarray,
    seen: FoundCorners,
) -> Corners:
    """Observed corners, each once, strongest first."""
    row = near[seen.row]
    weight = _weights(plane_map, triples, 2.0)[row] * seen.coverage
    position = triples.position[row]
    # Planes that were not merged, and their crossings with others, give the same corner more than once.
    keep = suppress_duplicates(position, seen.normals, seen.convexity, weight, radius=3.0 * grid.voxel_size)
    return _corners(
        position[keep], seen.normals[keep], weight[keep], seen.convexity[keep], covariance[row[keep]], True
    )


def _virtual(
    grid: VoxelGrid,
    plane_map: PlaneMap,
    triples: PlaneTriples,
    covariance: np.ndarray,
    normals: np.ndarray,
    reach: float,
    observed: Corners,
) -> Corners:
    """Intersections of planes that end nearby, but for those that are observed corners; strongest first."""
    signed = right_handed(normals.astype(np.float64))
    num = len(observed.position)
    # Observed corners outweigh everything here, so that they suppress the virtual ones that are the same.
    position = np.concatenate([observed.position, triples.position])
    weight = np.concatenate([np.full(num, np.inf), _weights(plane_map, triples, reach)])
    all_normals = np.concatenate([observed.normals, signed])
    keep = suppress_duplicates(
        position, all_normals, np.zeros(len(position), np.int32), weight, radius=3.0 * grid.voxel_size
    )
    keep = keep[keep >= num]
    # Nobody saw the faces beside the point: which of its edges are convex is not known.
    kind = np.full(len(keep), KIND_UNKNOWN, np.int32)
    return _corners(position[keep], all_normals[keep], weight[keep], kind, covariance[keep - num], False)


def _corners(
    position: np.ndarray,
    normals: np.ndarray,
    weight: np.ndarray,
    convexity: np.ndarray,
    covariance: np.ndarray,
    is_observed: bool,
) -> Corners:
    """Unpadded corners of one sort."""
    num = len(position)
    return Corners(
        position=position.astype(np.float32),
        normals=normals.astype(np.float32),
        weight=weight.astype(np.float32),
        convexity=convexity.astype(np.uint8),
        mask=np.ones(num, bool),
        is_observed=np.full(num, is_observed),
        num_found=np.asarray(num, np.int32),
        covariance=covariance,
    )


def _padded(corners: Corners) -> Corners:
    """Rows padded to a bucket, so that matching compiles for few sizes."""
    size = bucket_size(len(corners.position), 32)
    rows = {f: pad_rows(np.asarray(getattr(corners, f)), size) for f in _FIELDS}
    return Corners(**rows, num_found=corners.num_found)
