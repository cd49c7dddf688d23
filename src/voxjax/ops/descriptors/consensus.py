"""Agreement of point matches: which pairs fit one rigid motion, greedy cliques of those that do, and poses.

A match is a point with a normal in each of two maps. Two matches agree when the distance of their points, the
angle of their normals and the angles of each normal with the line between them are the same in both maps.
"""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from ... import rigid
from ..._runtime.precision import in_full_precision
from ..._types import Array


@partial(jax.jit, static_argnames=("chunk",))
@in_full_precision
def agreement_matrix(
    points_a: Float[Array, "n 3"],
    normals_a: Float[Array, "n 3"],
    points_b: Float[Array, "n 3"],
    normals_b: Float[Array, "n 3"],
    mask: Bool[Array, "n"],
    *,
    distance_tolerance: Float[Array, "n"],
    cosine_tolerance: float | Float[Array, ""],
    chunk: int = 128,
) -> Bool[Array, "n n"]:
    """Tell which pairs of matches may both be right.

    Args:
        points_a: Points of the matches in map a (n, 3) [m].
        normals_a: Unit normals there.
        points_b: Points of the matches in map b (n, 3) [m].
        normals_b: Unit normals there.
        mask: Matches that take part.
        distance_tolerance: Largest error of a matched point, per match [m]. Two matches agree when their
            distances differ by no more than the larger of the two tolerances, and are longer than twice that.
        cosine_tolerance: Largest difference of the cosines of corresponding angles.
        chunk: Rows handled at once.

    Returns:
        Symmetric matrix (n, n), False on the diagonal.
    """
    # Coordinates apart: fused loops over long rows are vectorised, and those over axes of three are not.
    sides = [tuple(part.T for part in side) for side in ((points_a, normals_a), (points_b, normals_b))]

    def angles(point: Array, normal: Array, points: Array, normals: Array) -> tuple[Array, tuple[Array, ...]]:
        offset = [points[axis] - point[axis] for axis in range(3)]
        length = jnp.sqrt(_dot(offset, offset))
        # A point has no direction to itself. That pair, the diagonal, is no longer than twice any tolerance, and falls
        # out below with all that are too near.
        inverse = 1.0 / jnp.maximum(length, 1e-6)
        return length, (
            _dot(normals, normal),
            _dot(offset, normal) * inverse,
            _dot(offset, normals) * inverse,
        )

    def row(one: tuple[Array, ...]) -> Array:
        point_a, normal_a, point_b, normal_b, is_valid, tolerance = one
        length_a, cosines_a = angles(point_a, normal_a, *sides[0])
        length_b, cosines_b = angles(point_b, normal_b, *sides[1])
        allowed = jnp.maximum(distance_tolerance, tolerance)
        # Nearer than that, the errors of the two points are as long as the line between them, whose direction and
        # length then rule nothing out.
        agrees = (jnp.minimum(length_a, length_b) > 2.0 * allowed) & mask & is_valid
        agrees &= jnp.abs(length_a - length_b) <= allowed
        for cosine_a, cosine_b in zip(cosines_a, cosines_b, strict=True):
            agrees &= jnp.abs(cosine_a - cosine_b) <= cosine_tolerance
        return agrees

    # In chunks of rows: all at once would hold the directions of n * n pairs.
    each = (points_a, normals_a, points_b, normals_b, mask, distance_tolerance)
    return jax.lax.map(row, each, batch_size=min(chunk, max(points_a.shape[0], 1)))


@partial(jax.jit, static_argnames=("max_size",))
@in_full_precision
def greedy_cliques(
    agreement: Bool[Array, "n n"], *, max_size: int = 64
) -> tuple[Bool[Array, "n n"], Int[Array, "n"]]:
    """Grow a clique from every node, taking the candidate that shares most neighbours with the seed first.

    The result need not be the largest clique of the seed; right matches agree with nearly all others that are
    right, so little is missed, and the poses are refitted to all matches anyway. Ties go to the lower node.

    Args:
        agreement: Symmetric, False on the diagonal.
        max_size: Growth stops here.

    Returns:
        Members (n, n), row i the clique grown from node i, node i included, and their sizes (n,) int32.
    """
    n = agreement.shape[0]
    edges = agreement.astype(jnp.float32)
    # Neighbours that two nodes share, by one product; float32 holds such counts exactly.
    shared = jnp.where(agreement, edges @ edges, -1.0)
    index = jnp.arange(n, dtype=jnp.int32)

    def grow(state: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        members, candidates, step = state
        # A candidate may share no neighbour with the seed; -1 is less than that, too.
        support = jnp.where(candidates, shared, -1.0)
        best = jnp.max(support, axis=1)
        # The lowest of the best, so that ties fall alike on every device.
        choice = jnp.min(jnp.where((support >= best[:, None]) & candidates, index[None], n), axis=1)
        is_growing = choice < n
        # A clique that is complete looks up some row like all others, and takes nothing from it.
        choice = jnp.minimum(choice, n - 1)
        chosen = (index[None] == choice[:, None]) & is_growing[:, None]
        # No node agrees with itself, so the chosen one leaves the candidates too.
        candidates = candidates & agreement[choice] & is_growing[:, None]
        return members | chosen, candidates, step + 1

    def is_unfinished(state: tuple[Array, Array, Array]) -> Array:
        return jnp.any(state[1]) & (state[2] < max_size)

    start = (index[None] == index[:, None], agreement, jnp.int32(1))  # the seed alone: size 1
    members, _, _ = jax.lax.while_loop(is_unfinished, grow, start)
    return members, jnp.sum(members, axis=1, dtype=jnp.int32)


@jax.jit
@in_full_precision
def poses_from_matches(
    points_a: Float[Array, "n 3"],
    normals_a: Float[Array, "n 3"],
    points_b: Float[Array, "n 3"],
    normals_b: Float[Array, "n 3"],
    weights: Float[Array, "p n"],
    *,
    normal_weight: float | np.floating | Float[Array, ""],
) -> Float[Array, "p 4 4"]:
    """Least-squares poses `T_a_b` of weighted sets of matches; the normals steady sets that lie along a line.

    Args:
        points_a: Points in map a (n, 3) [m].
        normals_a: Unit normals there.
        points_b: Points in map b (n, 3) [m].
        normals_b: Unit normals there.
        weights: One row of weights >= 0 a pose (p, n).
        normal_weight: Squared length [m^2] that a unit error of a normal counts as.

    Returns:
        Poses (p, 4, 4).
    """

    def solve(weight: Array) -> Array:
        # A set without any weight has sums of 0 and some pose; without the bound it would be NaN.
        share = (weight / jnp.maximum(jnp.sum(weight, dtype=weight.dtype), 1e-12))[:, None]
        mean_a = jnp.sum(share * points_a, axis=0, dtype=weight.dtype)
        mean_b = jnp.sum(share * points_b, axis=0, dtype=weight.dtype)
        # Points are centred before they are multiplied, which keeps the digits of float32; directions have no place.
        cross = (share * (points_b - mean_b[None])).T @ (points_a - mean_a[None])
        cross = cross + normal_weight * ((share * normals_b).T @ normals_a)
        # The sum is one of b a^T, whose nearest rotation brings a onto b; its transpose brings b onto a.
        rotation = rigid.nearest_rotation(cross).T
        return rigid.from_rotation_translation(rotation, mean_a - rotation @ mean_b)

    return jax.lax.map(solve, weights, batch_size=64)


@jax.jit
@in_full_precision
def matches_under_poses(
    poses: Float[Array, "p 4 4"],
    points_a: Float[Array, "n 3"],
    normals_a: Float[Array, "n 3"],
    points_b: Float[Array, "n 3"],
    normals_b: Float[Array, "n 3"],
    mask: Bool[Array, "n"],
    *,
    distance_tolerance: Float[Array, "n"],
    min_cosine: float | np.floating | Float[Array, ""],
) -> Bool[Array, "p n"]:
    """Tell which matches each pose `T_a_b` explains.

    Args:
        poses: Candidate poses (p, 4, 4).
        points_a: Points in map a (n, 3) [m].
        normals_a: Unit normals there.
        points_b: Points in map b (n, 3) [m].
        normals_b: Unit normals there.
        mask: Matches that take part.
        distance_tolerance: Largest distance of a point from its match, per match [m].
        min_cosine: Least cosine between a normal and that of its match.

    Returns:
        (p, n).
    """
    # Coordinates apart, as in `agreement_matrix`.
    side_a, side_b = (points_a.T, normals_a.T), (points_b.T, normals_b.T)

    def explain(pose: Array) -> Array:
        moved = [_dot(pose[axis], side_b[0]) + pose[axis, 3] for axis in range(3)]
        offset = [moved[axis] - side_a[0][axis] for axis in range(3)]
        cosine = _dot([_dot(pose[axis], side_b[1]) for axis in range(3)], side_a[1])
        return (_dot(offset, offset) <= distance_tolerance**2) & (cosine >= min_cosine) & mask

    return jax.lax.map(explain, poses, batch_size=64)


def _dot(x: Array | list[Array], y: Array | list[Array]) -> Array:
    """Sum of the products of the first three coordinates, each of which may be a row of values."""
    return x[0] * y[0] + x[1] * y[1] + x[2] * y[2]
