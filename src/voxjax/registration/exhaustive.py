"""Every translation of every rotation: the two-way evidence on coarse cells by Fourier transform.

It needs no corner and no descriptor, and finds poses that neither does; it is as good as its rotations.
"""

from typing import NamedTuple

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

MAX_GROWTH = 1.8
"""A block may be so much larger than needed to share the shape of another."""

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
    codes_a, codes_b = a.coarse_codes(factor), b.coarse_codes(factor)
    groups: dict[tuple[tuple[int, int, int], tuple[int, int, int]], list[_Plan]] = {}
    for plan in plans:
        groups.setdefault((plan.cells, plan.axes), []).append(plan)

    poses, scores = [], []
    for (cells, _), members in sorted(groups.items()):
        first = members[0]
        spectra_a = _spectra(a, codes_a, first.block_a, first.low_a, cell, cells)
        for plan in members:
            spectra_b = _spectra(b, codes_b, plan.block_b, plan.low_b, cell, cells)
            top, shift = correlation_peaks(*spectra_a, *spectra_b, cells=cells, num_peaks=num_peaks)
            # A cell x of b lies at low_b + x * cell, and meets cell x + shift of a at low_a + (x + shift) * cell.
            translation = plan.low_a - plan.low_b + np.asarray(shift, np.float64) * cell
            T = np.tile(np.eye(4), (num_peaks, 1, 1))
            T[:, :3, :3] = plan.block_a.T @ plan.block_b
            T[:, :3, 3] = translation @ plan.block_a
            poses.append(T)
            scores.append(np.asarray(top, np.float64))
    if not poses:
        return np.zeros((0, 4, 4), np.float32), np.zeros(0)
    all_poses, all_scores = np.concatenate(poses), np.concatenate(scores) / 2.0
    order = np.argsort(-all_scores, kind="stable")
    return all_poses[order].astype(np.float32), all_scores[order]


class _Plan(NamedTuple):
    """Where both maps go in the coarse block for one rotation; `axes` orders the block's axes, longest first."""

    cells: tuple[int, int, int]
    axes: tuple[int, int, int]
    block_a: np.ndarray
    block_b: np.ndarray
    low_a: np.ndarray
    low_b: np.ndarray


def _plan(
    points_a: np.ndarray, points_b: np.ndarray, rotations: np.ndarray, frame: np.ndarray, voxel_size: float
) -> tuple[int, list[_Plan]]:
    """Width of a coarse cell [voxel], and the plan of each rotation.

    The longest axis comes first, so that turned blocks have the same shape and compile once; a permutation may be a
    reflection, which is as good, because both maps undergo it.
    """
    factor, plans = FACTORS[-1], []
    for factor in FACTORS:
        cell = factor * voxel_size
        low_a, high_a = _box(points_a, frame, cell)
        plans = []
        for rotation in rotations.astype(np.float64):
            turned = frame @ rotation
            low_b, high_b = _box(points_b, turned, cell)
            sizes = np.asarray([_rung(n) for n in ((high_a - low_a) + (high_b - low_b)) / cell])
            order = np.argsort(-sizes, kind="stable")
            x, y, z = (int(n) for n in sizes[order])
            i, j, k = (int(n) for n in order)
            plans.append(_Plan((x, y, z), (i, j, k), frame[order], turned[order], low_a[order], low_b[order]))
        if all(np.prod(plan.cells) <= MAX_CELLS for plan in plans):
            break
    shared = _share_shapes({plan.cells for plan in plans})
    return factor, [plan._replace(cells=shared[plan.cells]) for plan in plans]


def _share_shapes(shapes: set[tuple[int, int, int]]) -> dict[tuple[int, int, int], tuple[int, int, int]]:
    """For each shape one that holds it and is not much larger; few different ones, because each is compiled."""
    shared: dict[tuple[int, int, int], tuple[int, int, int]] = {}
    for shape in sorted(shapes, key=lambda n: (-np.prod(n), n)):
        fits = [
            other for other in set(shared.values())
            if all(m <= n for m, n in zip(shape, other, strict=True)) and np.prod(other) <= MAX_GROWTH * np.prod(shape)
        ]  # fmt: skip
        shared[shape] = min(fits, key=lambda n: (np.prod(n), n), default=shape)
    return shared


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
