"""How uncertain a refined pose is: by what the planes fix, and by what errors of the voxels do to the solution."""

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float

from ... import rigid
from ..._runtime.precision import in_full_precision
from ..._runtime.programs import kept_program
from ..._types import Array
from ..residuals.planes import NearestSurface, PointToPlane, Sample, meet
from ..residuals.terms import dot, moved_columns
from .problem import PoseProblem

PATCH_VOXELS = 1000.0
"""Surface voxels that share one error: maps are wrong by whole patches, not voxel by voxel. With so many the normalised
errors squared of accepted generated pairs have the mean that they should have (`python -m bench calibration`); maps
that drift by more than a voxel need more."""

MAP_ACCURACY = 0.1
"""Error that no number of patches takes away [voxel], and about the same at the map's radius."""

PRIOR = 10.0
"""A direction that no surface fixes is uncertain by this [voxel], and by as much at the map's radius."""


@kept_program
@jax.jit
@in_full_precision
def pose_covariance(
    problem: PoseProblem, T_a_b: Float[Array, "4 4"], scale: Float[Array, ""], num_patches: Float[Array, ""]
) -> tuple[Float[Array, "6 6"], Bool[Array, ""]]:
    """Covariance of the tangent about the centroid of b in frame a, and whether a direction is not fixed.

    The covariance is that of Gauss-Newton, with the noise that the offsets from the planes show.

    Args:
        problem: Residuals with at least one term of planes.
        T_a_b: Refined pose.
        scale: Robust scale [m].
        num_patches: Independent observations if all of b met a plane.
    """
    voxel_size = _planes(problem)[0].surface.voxel_size
    information, variance = plane_information(problem, T_a_b, scale)
    # Voxels round positions: a twelfth of a voxel squared, even where all offsets happen to vanish.
    variance = variance + voxel_size**2 / 12.0
    # Turns count in metres at the map's radius, so that directions compare and one prior serves all.
    one = jnp.ones(3, T_a_b.dtype)
    units = jnp.concatenate([one, one / problem.radius])
    scaled = information * units[:, None] * units[None, :] * num_patches / variance
    # Each direction is inverted for itself, with the prior, so that those that no surface fixes stay finite.
    values, vectors = jnp.linalg.eigh(scaled)
    spread = (vectors / (jnp.maximum(values, 0.0) + 1.0 / (PRIOR * voxel_size) ** 2)[None, :]) @ vectors.T
    spread = spread + (MAP_ACCURACY * voxel_size) ** 2 * jnp.eye(6, dtype=T_a_b.dtype)
    # A direction slides if the maps know it worse than the last robust scale.
    is_degenerate = values[0] < 1.0 / scale**2
    return spread * units[:, None] * units[None, :], is_degenerate


def plane_information(
    problem: PoseProblem, T_a_b: Float[Array, "4 4"], scale: Float[Array, ""]
) -> tuple[Float[Array, "6 6"], Float[Array, ""]]:
    """What the planes say about the pose.

    Returns:
        The weighted sum of `J J^T` of the distances across the surfaces, about the centroid of b in frame a; the
        weighted variance of these distances [m^2].
    """
    # The tangent is about this point, so that shifts and turns of map b are least entangled.
    centre = T_a_b[:3, :3] @ problem.centroid + T_a_b[:3, 3]
    rows, points = [], []
    for term in _planes(problem):
        T = rigid.inverse(T_a_b) if term.is_inverse else T_a_b
        normal, distance, weight = _plane_rows(T, term.surface, term.sample, scale)
        # A motion of b moves what a sees in b the other way: the sign falls out of J J^T.
        rows.append((normal @ T_a_b[:3, :3].T if term.is_inverse else normal, distance, weight))
        points.append(term.sample.points if term.is_inverse else rigid.apply(T_a_b, term.sample.points))
    normal, distance, weight = (jnp.concatenate(part) for part in zip(*rows, strict=True))
    # A turn w about the centre moves a point by w x arm, hence its distance from the plane by w . (arm x
    # normal).
    arm = jnp.concatenate(points) - centre[None, :]
    jacobian = jnp.concatenate([normal, jnp.cross(arm, normal)], axis=1)
    total = jnp.sum(weight, dtype=weight.dtype)
    # Without any match there is no information either, and the prior is all that is left.
    total_safe = jnp.maximum(total, jnp.finfo(total.dtype).tiny)
    variance = jnp.sum(weight * distance * distance, dtype=weight.dtype) / total_safe
    return (jacobian * weight[:, None]).T @ jacobian, variance


def _planes(problem: PoseProblem) -> list[PointToPlane]:
    return [term for term in problem.terms if isinstance(term, PointToPlane)]


def _plane_rows(
    T: Float[Array, "4 4"], surface: NearestSurface, sample: Sample, scale: Float[Array, ""]
) -> tuple[Float[Array, "n 3"], Float[Array, "n"], Float[Array, "n"]]:
    """Normals in the frame of the surface, distances across it and robust weights."""
    points = moved_columns(T, sample.points)
    met = meet(surface, points, sample.normals, T[:3, :3])
    gap = [p - q for p, q in zip(points, met.anchor, strict=True)]
    squared = dot(gap, gap) / (scale * scale)
    # Whatever the loss was, weights are those that the loss of Geman and McClure leaves.
    weight = jnp.where(met.is_match, sample.weights * met.planarity / (1.0 + squared) ** 2, 0.0)
    return jnp.stack(met.normal, axis=-1), dot(gap, met.normal), weight
