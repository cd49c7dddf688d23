"""Every translation of every rotation: the two-way evidence on coarse cells by Fourier transform.

It needs no corner and no descriptor, and finds poses that neither does; it is as good as its rotations.
"""

import numpy as np
from jaxtyping import Float
from scipy.spatial import ConvexHull

from ...maps.prepared import COARSE_FACTOR, PreparedMap
from ...ops.evidence.lookup import Block
from ...ops.evidence.translations import CoarseMap, Placement, search_translations
from .settings import ExhaustiveConfig, SourceConfig


def upright_frame(directions: np.ndarray, shares: np.ndarray) -> np.ndarray:
    """Rotation whose rows are the map's two strongest orthogonal directions and their product, float64 (3, 3).

    In this frame a building fills a small block, however its map is turned.
    """
    if len(directions) == 0:
        return np.eye(3)
    # Of the other directions only the part across the first counts: those nearly parallel to it have little
    # left.
    first = directions[np.argmax(shares)]
    rest = directions - (directions @ first)[:, None] * first
    strength = np.linalg.norm(rest, axis=1) * shares
    # A map of one direction, such as a single wall, fixes no second one: any axis across the first will do.
    if strength.max() < 1e-6:
        rest, strength = (
            np.eye(3) - np.outer(first, first),
            np.linalg.norm(np.eye(3) - np.outer(first, first), axis=1),
        )
    second = rest[np.argmax(strength)]
    second = second / np.linalg.norm(second)
    return np.stack([second, np.cross(first, second), first])


def _outermost(prepared: PreparedMap) -> np.ndarray:
    """Points that span the same box as all points, in any frame: vertices of the convex hull, float64 (n, 3)."""
    points = np.asarray(prepared.points)[: prepared.num_points].astype(np.float64)
    # Voxels are listed column by column; only the ends of a column can be vertices.
    ends = np.ones(len(points) + 1, bool)
    ends[1:-1] = np.any(points[1:, :2] != points[:-1, :2], axis=1)
    points = points[ends[1:] | ends[:-1]]
    # Points in one plane have no convex hull in three dimensions.
    flat = np.linalg.matrix_rank(points - points.mean(axis=0), tol=0.1 * prepared.grid.voxel_size) < 3
    return points if flat else points[ConvexHull(points).vertices]


def _box(points: np.ndarray, rotation: np.ndarray, margin: float) -> tuple[np.ndarray, np.ndarray]:
    rotated = points @ rotation.T
    return rotated.min(axis=0) - margin, rotated.max(axis=0) + margin


def exhaustive_hypotheses(
    a: PreparedMap,
    b: PreparedMap,
    rotations: Float[np.ndarray, "k 3 3"],
    frame: Float[np.ndarray, "3 3"],
    *,
    conflict_weight: float,
    num_peaks: int = SourceConfig.num_peaks,
    settings: ExhaustiveConfig | None = None,
) -> tuple[Float[np.ndarray, "m 4 4"], np.ndarray]:
    """Best translations for each rotation of b into a.

    Args:
        a: First map.
        b: Second map.
        rotations: Candidates, b into a.
        frame: Rotation of a into the frame of the coarse block (`upright_frame`).
        conflict_weight: How many hits a conflict outweighs.
        num_peaks: Translations kept for each rotation.
        settings: How fine the cells are, None for the defaults: the finest from `COARSE_FACTOR` on that
            keep the blocks small enough.

    Returns:
        Poses `T_a_b` float32 (k * num_peaks, 4, 4) and their coarse scores, best first.
    """
    chosen = ExhaustiveConfig() if settings is None else settings
    points_a, points_b = _outermost(a), _outermost(b)
    radius = 0.5 * float(np.linalg.norm(np.ptp(points_b, axis=0)))
    factor, placements = COARSE_FACTOR, []
    # The finest cells whose blocks are small enough are taken: what is lost between cells grows with the cells, and
    # time with the blocks.
    for factor in range(COARSE_FACTOR, max(COARSE_FACTOR, chosen.max_factor) + 1):
        cell = factor * a.grid.voxel_size
        # Half a cell at the far end of b is lost in the cells.
        turned = _quarter_turns_apart(frame @ rotations.astype(np.float64), 0.5 * cell / max(radius, cell))
        placements = _place(points_a, points_b, turned, frame, cell)
        # A transform needs room for all translations: a block as wide as both maps beside each other.
        if all(np.prod(place.box_a + place.box_b) <= chosen.max_cells for place in placements):
            break
    found = search_translations(
        _coarse_map(a, factor),
        _coarse_map(b, factor),
        placements,
        num_peaks=num_peaks,
        conflict_weight=conflict_weight,
    )
    poses, scores = [], []
    for place, (top, shift) in zip(placements, found, strict=True):
        # A cell x of b lies at low_b + x * cell, and meets cell x + shift of a at low_a + (x + shift) * cell.
        translation = place.low_a - place.low_b + shift.astype(np.float64) * factor * a.grid.voxel_size
        T = np.tile(np.eye(4), (len(top), 1, 1))
        T[:, :3, :3] = place.block_a.T @ place.block_b
        T[:, :3, 3] = translation @ place.block_a
        poses.append(T)
        scores.append(top.astype(np.float64))
    if not poses:
        return np.zeros((0, 4, 4), np.float32), np.zeros(0)
    # The search adds both ways; scores of poses are the mean of both everywhere else.
    all_poses, all_scores = np.concatenate(poses), np.concatenate(scores) / 2.0
    order = np.argsort(-all_scores, kind="stable")
    return all_poses[order].astype(np.float32), all_scores[order]


def upright_sides(prepared: PreparedMap, frame: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3"]:
    """Sides of a map's box in its `upright_frame`, longest first, float64 (3,) [m]."""
    low, high = _box(_outermost(prepared), frame, prepared.grid.voxel_size)
    return np.sort(high - low)[::-1].astype(np.float64)


def affordable_coarsening(sides: Float[np.ndarray, "3"], settings: ExhaustiveConfig) -> int:
    """How many times as wide voxels must be for blocks of the widest cells to have few enough of them.

    Args:
        sides: Sides of a block [voxel]: those of both maps beside each other.
        settings: How wide cells may be, and how many a block may have.
    """
    factor = 1
    while np.ceil(sides / (factor * settings.max_factor)).prod() > settings.most_cells:
        factor += 1
    return factor


def _coarse_map(prepared: PreparedMap, factor: int) -> CoarseMap:
    """A map as the search takes it, with evidence codes at the tolerance of cells `factor` voxels wide."""
    grid, lists = prepared.grid, (prepared.points, prepared.weights, prepared.num_points)
    block = Block(prepared.dims, np.asarray(grid.origin, np.float64), grid.voxel_size, prepared.table)
    return CoarseMap(prepared.coarse_codes(factor), block, *lists)


def _place(
    points_a: np.ndarray, points_b: np.ndarray, turned: np.ndarray, frame: np.ndarray, cell: float
) -> list[Placement]:
    """Where both maps go, in cells of so many metres, for rotations of b into the frame of the block.

    The longest axis comes first, so that turned blocks have the same shape; a permutation may be a reflection, which is
    as good, because both maps undergo it.
    """
    low_a, high_a = _box(points_a, frame, cell)
    box_a = np.ceil((high_a - low_a) / cell).astype(int)
    placements = []
    for rotation in turned:
        largest = np.take_along_axis(rotation, np.argmax(np.abs(rotation), axis=1)[:, None], axis=1)
        # Adding 0 turns -0 into 0: equal blocks are to have equal bytes.
        upright = np.where(largest < 0, -rotation, rotation) + 0.0
        low_b, high_b = _box(points_b, upright, cell)
        box_b = np.ceil((high_b - low_b) / cell).astype(int)
        order = np.argsort(-(box_a + box_b), kind="stable")
        placements.append(
            Placement(
                box_a[order],
                box_b[order],
                frame[order],
                low_a[order],
                upright[order],
                low_b[order],
                largest[order, 0] < 0,
                cell,
            )
        )
    return placements


def _quarter_turns_apart(turned: np.ndarray, max_angle: float) -> np.ndarray:
    """Rotations (k, 3, 3), those that differ by quarter turns but for `max_angle` [rad] made to do so exactly.

    Rotations of a building come in such families; a family shares its Fourier transforms.
    """
    bound = 1.0 + 2.0 * np.cos(max_angle)
    snapped, is_head = np.array(turned), np.zeros(len(turned), bool)
    for row, rotation in enumerate(turned):
        heads = turned[is_head]
        between = rotation @ np.swapaxes(heads, 1, 2)
        # Rounded to whole numbers, a rotation near a quarter turn becomes one; any other becomes no rotation, or one
        # that is too far away.
        quarter = np.rint(between)
        is_turn = np.all(quarter @ np.swapaxes(quarter, 1, 2) == np.eye(3), axis=(1, 2))
        alike = np.flatnonzero(is_turn & (np.sum(between * quarter, axis=(1, 2)) >= bound))
        if len(alike):
            snapped[row] = quarter[alike[0]] @ heads[alike[0]]
        else:
            is_head[row] = True
    return snapped
