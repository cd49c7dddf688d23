"""Sparse normal equations of many poses: a block for each map, and one for each pair."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import lineax as lx
from jaxtyping import Float, Int32

from ... import rigid
from ..._types import Array
from .equations import NormalEquations

DENSE_MAPS = 32
"""Up to so many maps a dense factorisation is quicker than conjugate gradients, whose work grows with the pairs."""

_multiply = jax.vmap(jnp.matmul)


class JointEquations(NamedTuple):
    """A least-squares problem of N poses to second order, six unknowns a map.

    Attributes:
        cost: Half the sum of squares.
        slope: Gradient of the cost.
        own: Diagonal blocks of the Gauss-Newton matrix.
        cross: Blocks of the pairs: row of unknowns `first`, column `second`. The matrix has their transposes too.
        first: First map of each pair.
        second: Second map of each pair.
    """

    cost: Float[Array, ""]
    slope: Float[Array, "maps 6"]
    own: Float[Array, "maps 6 6"]
    cross: Float[Array, "pairs 6 6"]
    first: Int32[Array, "pairs"]
    second: Int32[Array, "pairs"]

    def along(self, slopes: Float[Array, "maps 6 6"]) -> "JointEquations":
        """The equations in other unknowns, with which those of a map change by its `slopes`."""
        # By the chain rule a gradient is multiplied by the slopes' transpose, a matrix from both sides.
        across = jnp.swapaxes(slopes, -1, -2)
        return self._replace(
            slope=_multiply(across, self.slope),
            own=_multiply(across, _multiply(self.own, slopes)),
            cross=_multiply(across[self.first], _multiply(self.cross, slopes[self.second])),
        )

    def times(self, move: Float[Array, "maps 6"]) -> Float[Array, "maps 6"]:
        """The matrix times a vector."""
        # A block off the diagonal is kept once and serves for both halves of the symmetric matrix.
        back = _multiply(jnp.swapaxes(self.cross, -1, -2), move[self.first])
        product = _multiply(self.own, move).at[self.first].add(_multiply(self.cross, move[self.second]))
        return product.at[self.second].add(back)

    def dense(self) -> Float[Array, "k k"]:
        """The matrix, maps one after the other."""
        num_maps = self.slope.shape[0]
        each = jnp.arange(num_maps)
        # Blocks are added, not set: a problem made by hand may name a pair of maps twice.
        blocks = jnp.zeros((num_maps, num_maps, 6, 6), self.own.dtype).at[each, each].add(self.own)
        blocks = blocks.at[self.first, self.second].add(self.cross)
        blocks = blocks.at[self.second, self.first].add(jnp.swapaxes(self.cross, -1, -2))
        return jnp.swapaxes(blocks, 1, 2).reshape(6 * num_maps, 6 * num_maps)

    def damped(self, damping: Float[Array, ""]) -> "JointEquations":
        """The equations with a share of the diagonal added to the matrix.

        They are positive definite also where no residual sees a direction.
        """
        # Damping is a share of each unknown's own curvature, so that it does not depend on units.
        diagonal = jnp.diagonal(self.own, axis1=-2, axis2=-1)
        info = jnp.finfo(diagonal.dtype)
        # What rounding may take off an eigenvalue grows with the number of unknowns.
        floor = jnp.asarray(diagonal.size * info.eps, diagonal.dtype) * jnp.max(diagonal) + info.tiny
        return self._replace(own=self.own + jax.vmap(jnp.diag)(damping * diagonal + floor))

    def step(self, damping: Float[Array, ""]) -> Float[Array, "maps 6"]:
        """The damped step; 0 along what no residual sees."""
        damped = self.damped(damping)
        return dense_step(damped) if self.slope.shape[0] <= DENSE_MAPS else sparse_step(damped)

    def fall(self, move: Float[Array, "maps 6"]) -> Float[Array, ""]:
        """The fall of the cost that the equations promise for a step."""
        return -jnp.vdot(move, self.slope) - 0.5 * jnp.vdot(move, self.times(move))


def dense_step(equations: JointEquations) -> Float[Array, "maps 6"]:
    """Step to the minimum of equations that are positive definite, by Cholesky's factors of the whole matrix."""
    operator = lx.MatrixLinearOperator(jnp.asarray(equations.dense()), lx.positive_semidefinite_tag)
    solution = lx.linear_solve(operator, -equations.slope.reshape(-1), lx.Cholesky(), throw=False)
    return solution.value.reshape(equations.slope.shape)


def sparse_step(
    equations: JointEquations, *, tolerance: float = 1e-5, max_steps: int = 200
) -> Float[Array, "maps 6"]:
    """The step that `dense_step` gives, by conjugate gradients, preconditioned with the inverses of the maps' blocks.

    Args:
        equations: Positive definite.
        tolerance: Share of the slope that may be left: the next step of the solver takes it.
        max_steps: Steps of conjugate gradients; each brings information one pair farther.
    """
    slope = equations.slope
    struct = jax.eval_shape(lambda: slope)
    # Maps' blocks differ by how many pairs they are in; their inverses make all maps alike.
    factors = jnp.linalg.cholesky(equations.own)

    def precondition(rest: Array) -> Array:
        return jax.vmap(lambda factor, part: jax.scipy.linalg.cho_solve((factor, True), part))(factors, rest)

    # The absolute tolerance is next to nothing: slopes shrink as the descent goes on, and steps must stay as exact.
    solver = lx.CG(rtol=tolerance, atol=float(jnp.finfo(slope.dtype).tiny), max_steps=max_steps)
    operator, inverse = (
        lx.FunctionLinearOperator(function, struct, tags=lx.positive_semidefinite_tag)
        for function in (equations.times, precondition)
    )
    return lx.linear_solve(operator, -slope, solver, options={"preconditioner": inverse}, throw=False).value


def relative_pose(T_world_a: Float[Array, "4 4"], T_world_b: Float[Array, "4 4"]) -> Float[Array, "4 4"]:
    """`T_a_b`; differences first, so that float32 keeps its digits far from the world's origin."""
    turn = T_world_a[:3, :3].T
    rotation = jnp.matmul(turn, T_world_b[:3, :3], precision=jax.lax.Precision.HIGHEST)
    shift = jnp.matmul(turn, T_world_b[:3, 3] - T_world_a[:3, 3], precision=jax.lax.Precision.HIGHEST)
    return rigid.from_rotation_translation(rotation, shift)


def relative_slopes(
    T_world_a: Float[Array, "4 4"],
    T_world_b: Float[Array, "4 4"],
    centroid_a: Float[Array, "3"],
    centroid_b: Float[Array, "3"],
    pivot: Float[Array, "3"],
) -> tuple[Float[Array, "6 6"], Float[Array, "6 6"]]:
    """How the tangent of `T_a_b` changes with those of `T_world_a` and of `T_world_b`.

    Those of the maps are about their centroids in the world, that of the pair about `pivot`, in frame b, seen from a.
    """
    turn = T_world_a[:3, :3].T
    centre = rigid.apply(T_world_b, pivot)

    def slopes(image: Array) -> Array:
        # The difference comes first: both places may lie far from the world's origin, but they lie near each
        # other.
        arm = jnp.matmul(turn, image - centre, precision=jax.lax.Precision.HIGHEST)
        return rigid.adjoint(rigid.from_rotation_translation(turn, arm))

    # b moves in frame a as in the world; a motion of a moves b the other way.
    return -slopes(rigid.apply(T_world_a, centroid_a)), slopes(rigid.apply(T_world_b, centroid_b))


class PairEquations(NamedTuple):
    """A pair's problem to second order, and what it has to do with the poses of its maps.

    Attributes:
        equations: Normal equations in the tangent of `T_a_b`.
        slopes_a: Change of that tangent with the tangent of `T_world_a`, see `relative_slopes`.
        slopes_b: Change of that tangent with the tangent of `T_world_b`.
    """

    equations: NormalEquations
    slopes_a: Float[Array, "*pairs 6 6"]
    slopes_b: Float[Array, "*pairs 6 6"]


def spread_pairs(
    pairs: PairEquations, first: Int32[Array, "pairs"], second: Int32[Array, "pairs"], num_maps: int
) -> JointEquations:
    """Equations of all maps from those of the pairs, which are stacked.

    Args:
        pairs: Stacked on a leading axis.
        first: Map a of each pair.
        second: Map b of each pair.
        num_maps: Number of maps.
    """
    (cost, slope, matrix), *slopes = pairs
    # By the chain rule, slopes of a pair's tangent take its gradient and matrix to the unknowns of its two maps.
    left_a, left_b = (jnp.swapaxes(each, -1, -2) for each in slopes)
    on_a, on_b = (_multiply(matrix, each) for each in slopes)
    total = jnp.zeros((num_maps, 6), slope.dtype)
    total = total.at[first].add(_multiply(left_a, slope)).at[second].add(_multiply(left_b, slope))
    own = jnp.zeros((num_maps, 6, 6), slope.dtype)
    own = own.at[first].add(_multiply(left_a, on_a)).at[second].add(_multiply(left_b, on_b))
    return JointEquations(jnp.sum(cost, dtype=cost.dtype), total, own, _multiply(left_a, on_b), first, second)
