"""The transform from matched corners and the occupied voxels around them (sections IV.C, IV.D and V.B)."""

from functools import partial

import jax
import jax.numpy as jnp
import lineax as lx
import numpy as np
import optimistix as optx
from jaxtyping import Bool, Float, Float32, Int32
from scipy.spatial import KDTree

from ..._runtime.buckets import pad_rows, wide_bucket_size
from ..._runtime.precision import in_full_precision
from ..._types import Array
from ...matching.early_transform import Align, kabsch
from ...refinement.residuals.losses import robustify
from ...refinement.solve.equations import move_about
from .settings import PaperConfig


class NeighbouringPoints:
    """Occupied voxels of both maps, to find those beside matched corners."""

    def __init__(
        self,
        voxels_a: Float[np.ndarray, "n 3"],
        voxels_b: Float[np.ndarray, "m 3"],
        voxel_size: float,
        *,
        settings: PaperConfig | None = None,
    ):
        """Build the search trees.

        Args:
            voxels_a: Centres of the occupied voxels of a [m].
            voxels_b: Centres of the occupied voxels of b [m].
            voxel_size: Voxel size of both maps [m].
            settings: How far neighbouring points reach, how many there are and how they match; None for the defaults.
        """
        self.tree_a, self.tree_b = KDTree(voxels_a), KDTree(voxels_b)
        self.voxels_a, self.voxels_b = voxels_a, voxels_b
        self.voxel_size, self.settings = voxel_size, PaperConfig() if settings is None else settings

    def beside(self, corners_b: Float[np.ndarray, "k 3"], *, radius: float, count: int) -> np.ndarray:
        """Rows of the voxels of b within `radius` [m] of the corners, at most `count` a corner, each once."""
        ranks = list(range(1, min(count, len(self.voxels_b)) + 1))
        _, rows = self.tree_b.query(corners_b, k=ranks, distance_upper_bound=radius)  # pyright: ignore
        # Where there are fewer neighbours, the tree gives the row after the last.
        # Corners near each other share neighbours, which must not weigh twice.
        rows = np.unique(rows)
        return rows[rows < len(self.voxels_b)]

    def pairs(
        self, rows_b: np.ndarray, T_a_b: np.ndarray, max_distance: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Voxels of b and the nearest voxels of a under a pose, where these lie within `max_distance` [m]."""
        moved = self.voxels_b[rows_b] @ T_a_b[:3, :3].T + T_a_b[:3, 3]
        distance, nearest = map(np.asarray, self.tree_a.query(moved, distance_upper_bound=max_distance))
        is_near = np.isfinite(distance)
        return self.voxels_a[nearest[is_near]], self.voxels_b[rows_b[is_near]]

    def early_align(self) -> Align:
        """Transform of five matches and their neighbours, quick enough for the inside of a search."""
        chosen = self.settings
        radius, reach = (
            length * self.voxel_size for length in (chosen.early_radius, chosen.early_match_distance)
        )

        def align(points_a: np.ndarray, points_b: np.ndarray) -> np.ndarray:
            # Five corners alone are rounded to voxels; their neighbours average that away (section IV.C).
            T_a_b = kabsch(points_a, points_b)
            rows = self.beside(points_b, radius=radius, count=chosen.max_neighbours // 4)
            more_a, more_b = self.pairs(rows, T_a_b, reach)
            return kabsch(np.concatenate([points_a, more_a]), np.concatenate([points_b, more_b]))

        return align


def align_matches(
    points_a: Float32[np.ndarray, "k 3"],
    points_b: Float32[np.ndarray, "k 3"],
    neighbours: NeighbouringPoints,
) -> tuple[np.ndarray, bool]:
    """Transform of matched corners and their neighbouring voxels, by optimistix.

    The corners alone give the start; then the voxels of b around them are matched with the nearest voxels of
    a and all are aligned together, several times, the search radius shrinking.

    Args:
        points_a: Matched corners of a [m].
        points_b: Matched corners of b [m].
        neighbours: Occupied voxels of the two maps, with the settings of how they match.

    Returns:
        `T_a_b` float32 (4, 4), and whether the solver converged in the last round.
    """
    chosen, voxel_size = neighbours.settings, neighbours.voxel_size
    T_a_b = kabsch(points_a, points_b).astype(np.float32)
    radius = chosen.neighbour_radius * voxel_size
    rows = neighbours.beside(points_b, radius=radius, count=chosen.max_neighbours)
    # All rounds have as many rows as any of them may need, and share one compiled fit.
    size = wide_bucket_size(len(points_a) + len(rows), 256)
    converged = True
    reaches = np.geomspace(chosen.first_match_distance, chosen.last_match_distance, chosen.num_rounds)
    # The reach falls with the error of the pose: wide enough at first to find partners, narrow at last to find
    # right ones.
    for reach in reaches * voxel_size:
        more_a, more_b = neighbours.pairs(rows, T_a_b, reach)
        all_a, all_b = np.concatenate([points_a, more_a]), np.concatenate([points_b, more_b])
        # Corners are worth many voxels, and keep a part of the weight however many neighbours there are.
        share = max(chosen.min_corner_weight * len(more_a) / len(points_a), 1.0)
        weights = np.concatenate([np.full(len(points_a), share), np.ones(len(more_a))])
        weights = pad_rows((weights / weights.sum()).astype(np.float32), size)
        fit = fit_points(pad_rows(all_a, size), pad_rows(all_b, size), weights, T_a_b, np.float32(reach))
        T_a_b, converged = np.asarray(fit[0]), bool(fit[1])
    return T_a_b, converged


@partial(jax.jit, static_argnames=("max_steps",))
@in_full_precision
def fit_points(
    points_a: Float[Array, "n 3"],
    points_b: Float[Array, "n 3"],
    weights: Float[Array, "n"],
    T_a_b: Float[Array, "4 4"],
    scale: Float[Array, ""] | np.float32,
    *,
    max_steps: int = 24,
) -> tuple[Float[Array, "4 4"], Bool[Array, ""], Int32[Array, ""]]:
    """Robust point-to-point fit by Levenberg-Marquardt, Huber loss.

    Args:
        points_a: Points of a [m].
        points_b: Points of b that they match [m].
        weights: Weight of each match, 0 for padding; the sum is 1.
        T_a_b: Pose that the fit starts from.
        scale: Distance from which on an offset counts linearly [m].
        max_steps: Largest number of steps of the solver.

    Returns:
        The pose, whether the solver converged, and its steps.
    """
    # The fit turns about the centroid of the points, where shifts and turns hardly depend on each other.
    centroid = jnp.sum(points_b * weights[:, None], axis=0, dtype=points_b.dtype)
    offset = (points_b - centroid[None, :]) * jnp.sqrt(weights)[:, None]
    radius = jnp.sqrt(jnp.sum(offset * offset, dtype=offset.dtype))
    radius = jnp.maximum(radius, scale)
    # A step of 1 in any unknown moves the points by about the robust scale: one damping then serves metres and
    # radians.
    units = jnp.concatenate([jnp.ones(3, points_a.dtype), jnp.ones(3, points_a.dtype) / radius]) * scale

    def residuals(unknowns: Array, args: tuple) -> Array:
        points_a, points_b, weights, T = args
        moved = move_about(T, centroid, unknowns * units)
        gap = points_b @ moved[:3, :3].T + moved[:3, 3][None, :] - points_a
        return robustify(gap / scale, "huber") * jnp.sqrt(weights)[:, None]

    # Six unknowns and many rows: normal equations are small, and forward passes, one for each unknown, are the
    # fewest.
    solver = optx.LevenbergMarquardt(rtol=1e-5, atol=1e-5, linear_solver=lx.Normal(lx.Cholesky()))
    solution = optx.least_squares(
        residuals,
        solver,
        jnp.zeros(6, points_a.dtype),
        (points_a, points_b, weights, T_a_b),
        options={"jac": "fwd"},
        max_steps=max_steps,
        throw=False,
    )
    T = move_about(T_a_b, centroid, solution.value * units)
    return T, solution.result == optx.RESULTS.successful, jnp.asarray(solution.stats["num_steps"], jnp.int32)
