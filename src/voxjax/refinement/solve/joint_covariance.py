"""How uncertain poses that were refined together are, each beside the poses that were held."""

import jax
import jax.numpy as jnp
from jaxtyping import Float

from ..._runtime.precision import in_full_precision
from ..._types import Array
from .covariance import MAP_ACCURACY, PATCH_VOXELS, PRIOR, plane_information
from .equations import NormalEquations
from .joint_equations import PairEquations, relative_slopes, spread_pairs
from .joint_problem import JointProblem
from .problem import PoseProblem


@jax.jit
@in_full_precision
def joint_covariance(
    problem: JointProblem,
    poses: Float[Array, "maps 4 4"],
    scale: Float[Array, ""],
    num_points: Float[Array, "maps"],
    voxel_size: Float[Array, ""],
) -> Float[Array, "maps 6 6"]:
    """Covariance of each map's tangent about its centroid in the world; 0 for maps that were held.

    The covariance is that of Gauss-Newton with the noise that the offsets from the planes show, as `pose_covariance` of
    a pair. Pairs count as if their errors were independent, though those of a map are in all of its pairs.

    Args:
        problem: Residuals with terms of planes in each pair.
        poses: Refined poses.
        scale: Robust scale [m].
        num_points: Occupied voxels of each map.
        voxel_size: Voxel size of the maps [m].
    """
    dtype, num_maps = poses.dtype, poses.shape[0]

    def of_pair(pair: PoseProblem, T_a_b: Array, a: Array, b: Array) -> PairEquations:
        information, variance = plane_information(pair, T_a_b, scale)
        # Both maps err, each by patches of its own.
        num_patches = 0.5 * (num_points[a] + num_points[b]) / PATCH_VOXELS
        # Voxels round positions, as in `pose_covariance`.
        known = information * (num_patches / (variance + voxel_size**2 / 12.0))
        # Only the matrix of the equations is asked for; cost and slope have to be something.
        nothing = jnp.zeros(6, dtype)
        slopes = relative_slopes(
            poses[a], poses[b], problem.centroids[a], problem.centroids[b], pair.centroid
        )
        return PairEquations(NormalEquations(nothing[0], nothing, known), *slopes)

    parts = [
        spread_pairs(group.each(of_pair, poses), group.first, group.second, num_maps).dense()
        for group in problem.edges
    ]
    one = jnp.ones((num_maps, 3), dtype)
    units = jnp.concatenate([one, one / problem.radii[:, None]], axis=1)
    # What is held is taken out of the system: its rows and columns have no information, and no share in others.
    is_free = jnp.repeat(~problem.is_fixed, 6)
    scaled = sum(parts[1:], start=parts[0]) * units.reshape(-1)[:, None] * units.reshape(-1)[None, :]
    scaled = jnp.where(is_free[:, None] & is_free[None, :], scaled, 0.0)
    values, vectors = jnp.linalg.eigh(scaled)
    spread = (vectors / (jnp.maximum(values, 0.0) + 1.0 / (PRIOR * voxel_size) ** 2)[None, :]) @ vectors.T
    # The blocks on the diagonal are what is unknown of each map while the others are unknown too.
    each = jnp.arange(num_maps)
    own = spread.reshape(num_maps, 6, num_maps, 6)[each, :, each, :]
    own = own + (MAP_ACCURACY * voxel_size) ** 2 * jnp.eye(6, dtype=dtype)[None]
    own = own * units[:, :, None] * units[:, None, :]
    # A map that is held is known by definition, though its rows were only cut out of the system above.
    return jnp.where(problem.is_fixed[:, None, None], jnp.zeros_like(own), own)
