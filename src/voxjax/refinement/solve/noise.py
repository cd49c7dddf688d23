"""Covariance of a refined pose by the implicit function theorem: what errors of the voxels do to the solution."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int32

from ..._runtime.precision import in_full_precision
from ..._types import Array
from ..residuals.planes import HeldPointToPlane
from ..residuals.terms import Columns, Level, PointTerm, robust_rows
from .equations import move_about
from .problem import PoseProblem, sum_of_squares


@jax.jit
@in_full_precision
def implicit_covariance(
    problem: PoseProblem,
    T_a_b: Float[Array, "4 4"],
    scale: Float[Array, ""],
    *,
    deviation: Float[Array, ""],
    patch: Float[Array, ""],
    prior: Float[Array, "6"],
) -> Float[Array, "6 6"]:
    """Covariance of the tangent about the centroid of b in frame a.

    The surfaces of both maps err by patches: all voxels in a cube of space are off by one vector, independent of the
    other cubes' and of the other map's. The solution moves by `-H^-1 (dg/de) e` with the vectors e, where g is the
    slope of the cost and H its full Hessian, curvature of the loss and of the rotation included. Where Gauss-Newton
    takes the offsets of points for independent and the loss for quadratic, this takes neither. What resists
    motion along planes is left out: it is the grid, not the place.

    Trust it only where nothing slides (`Refinement.result` is not `degenerate`): normals count as exact, so that where
    surfaces fix a direction by their roughness alone it claims to know it (`notebooks/04_refinement.ipynb`).

    Args:
        problem: Residuals of which the pose is the solution; what its points meet is held.
        T_a_b: Refined pose.
        scale: Robust scale of the last level [m].
        deviation: Standard deviation of each coordinate of the errors [m].
        patch: Edge of the cubes [m].
        prior: Deviation of each unknown without any observation [m, rad].

    References:
        Censi, An accurate closed-form estimate of ICP's covariance, 2007.
    """
    dtype = T_a_b.dtype
    held = _without_slide(problem.holding(problem.met(T_a_b)))
    level = Level(scale, jnp.zeros((), jnp.int32))

    def cost(tangent: Array, errors: tuple[Array, Array]) -> Array:
        T = move_about(T_a_b, problem.centroid, tangent)
        rows = [
            _shaken(term, T, errors, level, patch) if isinstance(term, PointTerm) else term.rows(T, level)
            for term in held.terms
        ]
        return 0.5 * sum_of_squares(rows)

    still = jnp.zeros(6, dtype)
    # Patches that are told apart, a power of two. Where there are more, some share errors by chance, which overstates
    # the covariance a little.
    num_patches = 512
    quiet = (jnp.zeros((num_patches, 3), dtype), jnp.zeros((num_patches, 3), dtype))
    # These are H, and dg/de for the errors of both maps: the covariance is H^-1 (sum of dg/de dg/de^T) H^-1.
    curvature = jax.hessian(cost)(still, quiet)
    pulls = jax.jacrev(jax.grad(cost), argnums=1)(still, quiet)
    spread = sum((jnp.einsum("ipc,jpc->ij", pull, pull) for pull in pulls), start=jnp.zeros((6, 6), dtype))
    # In units of the prior, so that metres and radians are alike.
    curvature, spread = (matrix * prior[:, None] * prior[None, :] for matrix in (curvature, spread))
    values, vectors = jnp.linalg.eigh(0.5 * (curvature + curvature.T))
    # Of directions with less curvature, the prior is all that is known; this is their variance without it [prior^2].
    is_fixed, unknown = values > 1e-4 * jnp.max(values), 1e6
    inverse = jnp.where(is_fixed, 1.0 / jnp.where(is_fixed, values, 1.0), 0.0)
    inner = vectors.T @ spread @ vectors * deviation**2
    observed = inverse[:, None] * inner * inverse[None, :] + jnp.diag(jnp.where(is_fixed, 0.0, unknown))
    # Together with the prior: (C^-1 + I)^-1, without the inverse of what may be singular.
    both = jnp.linalg.solve(observed + jnp.eye(6, dtype=dtype), observed)
    found = vectors @ (0.5 * (both + both.T)) @ vectors.T
    return found * prior[:, None] * prior[None, :]


def _without_slide(problem: PoseProblem) -> PoseProblem:
    terms = [
        dataclasses.replace(term, slide=jnp.zeros_like(term.slide))
        if isinstance(term, HeldPointToPlane)
        else term
        for term in problem.terms
    ]
    return PoseProblem(tuple(terms), problem.centroid, problem.radius)


def _shaken(
    term: PointTerm, T_a_b: Array, errors: tuple[Array, Array], level: Level, patch: Array
) -> Float[Array, "k n"]:
    """Rows with the surfaces of both maps off by the errors of their patches, each in the frame of its map."""
    placed = term.placed(T_a_b, jnp.zeros(3, T_a_b.dtype))
    rotation = T_a_b[:3, :3]
    # The first errors are of map a, the second of map b; whose points they are depends on the way.
    own, other = (errors[0], errors[1]) if term.is_inverse else (errors[1], errors[0])
    turn = rotation.T if term.is_inverse else rotation
    mine = own[_patches(list(term.points().T), patch, len(own))] @ turn.T
    theirs = other[_patches(placed.points, patch, len(other))]
    # A surface that is off by an error is met as if the point were off by as much the other way.
    points = [column + mine[:, i] - theirs[:, i] for i, column in enumerate(placed.points)]
    return robust_rows(term.offsets(points, level), term.weights(), term.loss)


def _patches(points: Columns, patch: Array, num_patches: int) -> Int32[Array, "n"]:
    """Number of the cube of space that each point lies in, folded into so many, which must be a power of two."""
    primes = (73856093, 19349663, 83492791)  # so that neighbours along an axis do not share a number
    mixed = jnp.zeros(points[0].shape, jnp.int32)
    for column, prime in zip(points, primes, strict=True):
        cube = jnp.floor(jax.lax.stop_gradient(column) / patch).astype(jnp.int32)
        mixed = mixed ^ (cube * np.int32(prime))
    # With a power of two the low bits are the remainder, also of products that have wrapped below 0.
    return mixed & (num_patches - 1)
