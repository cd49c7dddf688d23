"""Every translation of every rotation: the two-way evidence on coarse cells by Fourier transform.

It needs no corner and no descriptor, and finds poses that neither does; it is as good as its rotations.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy.spatial import ConvexHull

from .._types import Array
from ..ops.correlate import coarse_spectra, correlation_peaks
from .prepared import PreparedMap

CONFLICT_WEIGHT = 3.0
"""A coarse conflict is less certain than a fine one, which weighs 6."""

SIZES = (16, 24, 32, 48, 64, 96, 128, 192, 256, 384, 512, 768, 1024)
"""Rungs of each axis of the coarse block; multiples of 8 with factors 2 and 3 only."""

FACTORS = (3, 4, 5, 6)
"""Coarse cells are so many voxels wide: the finest that keeps the block below `MAX_CELLS`."""

MAX_CELLS = 2_000_000
"""A transform of such a block takes about 20 ms on one core and 16 MB."""


def upright_frame(directions: np.ndarray, shares: np.ndarray) -> np.ndarray:
    """Rotation whose rows are the map's two strongest orthogonal directions and their product, float64 (3, 3).

    In this frame a building fills a small block, however its map is turned.
    """
    if len(directions) == 0:
        return np.eye(3)
    first = directions[np.argmax(shares)]
    rest = directions - (directions @ first)[:, None] * first
    strength = np.linalg.norm(rest, axis=1) * shares
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
    flat = np.linalg.matrix_rank(points - points.mean(axis=0), tol=0.1 * prepared.grid.voxel_size) < 3
    return points if flat else points[ConvexHull(points).vertices]


def _box(points: np.ndarray, rotation: np.ndarray, margin: float) -> tuple[np.ndarray, np.ndarray]:
    rotated = points @ rotation.T
    return rotated.min(axis=0) - margin, rotated.max(axis=0) + margin


def _rung(cells: float) -> int:
    return next((size for size in SIZES if size >= cells), int(np.ceil(cells / 64)) * 64)


def exhaustive_hypotheses(
    a: PreparedMap,
    b: PreparedMap,
    rotations: Float[np.ndarray, "k 3 3"],
    frame: Float[np.ndarray, "3 3"],
    *,
    num_peaks: int = 24,
) -> tuple[Float[np.ndarray, "m 4 4"], np.ndarray]:
    """Best translations for each rotation of b into a.

    Args:
        a: First map.
        b: Second map.
        rotations: Candidates, b into a.
        frame: Rotation of a into the frame of the coarse block (`upright_frame`).
        num_peaks: Translations kept for each rotation.

    Returns:
        Poses `T_a_b` float32 (k * num_peaks, 4, 4) and their coarse scores, best first.
    """
    points_a, points_b = _outermost(a), _outermost(b)
    factor, plans = _plan(points_a, points_b, rotations, frame, a.grid.voxel_size)
    cell = factor * a.grid.voxel_size
    low_a = _box(points_a, frame, cell)[0]
    codes_a, codes_b = a.coarse_codes(factor), b.coarse_codes(factor)
    by_shape: dict[tuple[int, int, int], list[int]] = {}
    for i, (_, _, shape) in enumerate(plans):
        by_shape.setdefault(shape, []).append(i)

    poses, scores = [], []
    for cells, members in sorted(by_shape.items()):
        spectra_a = _spectra(a, codes_a, frame, low_a, cell, cells)
        for i in members:
            turned, low_b, _ = plans[i]
            spectra_b = _spectra(b, codes_b, turned, low_b, cell, cells)
            top, shift = correlation_peaks(*spectra_a, *spectra_b, cells=cells, num_peaks=num_peaks)
            # A cell x of b lies at low_b + x * cell, and meets the cell x + shift of a at low_a + (x + shift) * cell.
            translation = low_a - low_b + np.asarray(shift, np.float64) * cell
            T = np.tile(np.eye(4), (num_peaks, 1, 1))
            T[:, :3, :3] = frame.T @ turned
            T[:, :3, 3] = translation @ frame
            poses.append(T)
            scores.append(np.asarray(top, np.float64))
    if not poses:
        return np.zeros((0, 4, 4), np.float32), np.zeros(0)
    all_poses, all_scores = np.concatenate(poses), np.concatenate(scores) / 2.0
    order = np.argsort(-all_scores, kind="stable")
    return all_poses[order].astype(np.float32), all_scores[order]


def _plan(
    points_a: np.ndarray, points_b: np.ndarray, rotations: np.ndarray, frame: np.ndarray, voxel_size: float
) -> tuple[int, list[tuple[np.ndarray, np.ndarray, tuple[int, int, int]]]]:
    """Width of a coarse cell [voxel], and for each rotation: b into the block, its corner, and the block's size."""
    factor, plans = FACTORS[-1], []
    for factor in FACTORS:
        cell = factor * voxel_size
        low_a, high_a = _box(points_a, frame, cell)
        plans = []
        for rotation in rotations.astype(np.float64):
            turned = frame @ rotation
            low_b, high_b = _box(points_b, turned, cell)
            x, y, z = (_rung(n) for n in ((high_a - low_a) + (high_b - low_b)) / cell)
            plans.append((turned, low_b, (x, y, z)))
        if all(x * y * z <= MAX_CELLS for _, _, (x, y, z) in plans):
            break
    return factor, plans


def _spectra(
    prepared: PreparedMap,
    codes: Array,
    rotation: np.ndarray,
    low: np.ndarray,
    cell: float,
    cells: tuple[int, int, int],
) -> tuple[Array, Array]:
    return coarse_spectra(
        codes, *prepared.block, prepared.points, prepared.weights,
        jnp.asarray(rotation, jnp.float32), jnp.asarray(low, jnp.float32), jnp.float32(cell),
        jnp.float32(CONFLICT_WEIGHT), cells=cells,
    )  # fmt: skip
