"""Residuals between N maps as a function of all their poses: pairs of equal shapes are evaluated together."""

from collections.abc import Callable, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float, Int32, PyTree

from ..._types import Array
from ..residuals.terms import Level
from .equations import pose_equations
from .joint_equations import JointEquations, PairEquations, relative_pose, relative_slopes, spread_pairs
from .problem import PoseProblem, sum_of_squares


class Edges(eqx.Module):
    """Pairs of maps whose problems have the same shapes.

    Attributes:
        own: Problem whose arrays are stacked on a leading axis; None where they are in common.
        common: The arrays that all have in common; None elsewhere.
        first: Map a of each pair.
        second: Map b of each pair.
        found: What the points meet and keep, by `met`; None while they look for it.
        stride: Every `stride`-th point is used, and weighs as much as all.
    """

    own: PoseProblem
    common: PoseProblem
    first: Int32[Array, "pairs"]
    second: Int32[Array, "pairs"]
    found: PyTree = None
    stride: int = eqx.field(static=True, default=1)

    def each(
        self,
        function: Callable[[PoseProblem, Array, Array, Array], Any],
        poses: Float[Array, "maps 4 4"],
    ) -> Any:
        """What `function(problem, T_a_b, a, b)` gives for each pair, stacked; a and b are numbers of maps."""

        def one(own: PoseProblem, found: PyTree, a: Array, b: Array) -> Any:
            # `vmap` sees the arrays of each pair alone; tables in common come in from outside, without a copy for each.
            problem = eqx.combine(own, self.common)
            # Points are thinned before what they met is held, so that both have the same length.
            problem = problem if self.stride == 1 else problem.thinned(self.stride)
            problem = problem if found is None else problem.holding(found)
            return function(problem, relative_pose(poses[a], poses[b]), a, b)

        return jax.vmap(one)(self.own, self.found, self.first, self.second)


def edges_of(pairs: Sequence[tuple[int, int, PoseProblem]]) -> tuple[Edges, ...]:
    """Pairs in as few groups as their shapes allow; arrays that are the same object in all of a group stay one.

    Args:
        pairs: (a, b, problem) of each pair, where the problem is about `T_a_b`.
    """
    groups: dict[Any, list[tuple[int, int, PoseProblem]]] = {}
    for pair in pairs:
        # Pairs whose trees and shapes agree can be stacked and evaluated by one kernel.
        struct = jax.tree.structure(pair[2])
        shapes = tuple((jnp.shape(leaf), jnp.asarray(leaf).dtype) for leaf in jax.tree.leaves(pair[2]))
        groups.setdefault((struct, shapes), []).append(pair)
    return tuple(_stacked(group) for group in groups.values())


def _stacked(pairs: Sequence[tuple[int, int, PoseProblem]]) -> Edges:
    first, second, problems = zip(*pairs, strict=True)
    leaves = [jax.tree.leaves(problem) for problem in problems]
    # Objects are compared, not values: tables are long, and what is traced has no values.
    is_common = [all(leaf is column[0] for leaf in column) for column in zip(*leaves, strict=True)]
    own = [
        None if common else jnp.stack(column)
        for common, column in zip(is_common, zip(*leaves, strict=True), strict=True)
    ]
    shared = [
        jnp.asarray(leaf) if common else None for common, leaf in zip(is_common, leaves[0], strict=True)
    ]
    struct = jax.tree.structure(problems[0])
    return Edges(
        jax.tree.unflatten(struct, own),
        jax.tree.unflatten(struct, shared),
        jnp.asarray(first, jnp.int32),
        jnp.asarray(second, jnp.int32),
    )


class JointProblem(eqx.Module):
    """Residuals between maps as a function of their poses in the world.

    Attributes:
        edges: The pairs.
        centroids: Centroids of the maps, in their own frames [m]: the points about which they are moved.
        radii: Lengths that make radians comparable to metres: about those of the maps [m].
        is_fixed: Maps that keep their pose: at least one of each set of maps that pairs connect.
    """

    edges: tuple[Edges, ...]
    centroids: Float[Array, "maps 3"]
    radii: Float[Array, "maps"]
    is_fixed: Bool[Array, "maps"]

    @property
    def num_pairs(self) -> int:
        """How many pairs are held against each other."""
        return sum(group.first.shape[0] for group in self.edges)

    def rows(self, poses: Float[Array, "maps 4 4"], level: Level) -> tuple[PyTree, ...]:
        """Rows of all pairs."""
        return tuple(group.each(lambda problem, T, *_: problem.rows(T, level), poses) for group in self.edges)

    def cost(self, poses: Float[Array, "maps 4 4"], level: Level) -> Float[Array, ""]:
        """Sum of the squares of all rows."""
        return sum_of_squares(self.rows(poses, level))

    def met(self, poses: Float[Array, "maps 4 4"]) -> tuple[PyTree, ...]:
        """What the points of each pair meet; None where that is held already."""
        return tuple(
            # What is held already is not looked up again.
            group.each(lambda problem, T, *_: problem.met(T), poses) if group.found is None else None
            for group in self.edges
        )

    def holding(self, met: tuple[PyTree, ...]) -> "JointProblem":
        """The problem with what the points meet held."""
        edges = [
            group
            if found is None
            else Edges(group.own, group.common, group.first, group.second, found, group.stride)
            for group, found in zip(self.edges, met, strict=True)
        ]
        return JointProblem(tuple(edges), self.centroids, self.radii, self.is_fixed)

    def thinned(self, stride: int) -> "JointProblem":
        """The problem with every `stride`-th point."""
        edges = [
            Edges(group.own, group.common, group.first, group.second, group.found, stride * group.stride)
            for group in self.edges
        ]
        return JointProblem(tuple(edges), self.centroids, self.radii, self.is_fixed)

    def equations(self, poses: Float[Array, "maps 4 4"], level: Level) -> JointEquations:
        """Normal equations of the tangents (translation [m], rotation [rad]) about the maps' centroids in the world."""

        def of_pair(problem: PoseProblem, T_a_b: Array, a: Array, b: Array) -> PairEquations:
            found = pose_equations(problem.terms, T_a_b, problem.centroid, level)
            slopes = relative_slopes(
                poses[a], poses[b], self.centroids[a], self.centroids[b], problem.centroid
            )
            return PairEquations(found, *slopes)

        parts = [
            spread_pairs(group.each(of_pair, poses), group.first, group.second, poses.shape[0])
            for group in self.edges
        ]
        # What belongs to maps is added over the groups; what belongs to pairs is put one after the other.
        total = jax.tree.map(lambda *each: sum(each[1:], start=each[0]), *(part[:3] for part in parts))
        pairs = jax.tree.map(lambda *each: jnp.concatenate(each), *(part[3:] for part in parts))
        return JointEquations(*total, *pairs)

    def no_equations(self, dtype: jnp.dtype) -> JointEquations:
        """What is known before the first evaluation: a cost without bound."""
        num_maps = self.is_fixed.shape[0]
        first, second = (
            jnp.concatenate([getattr(group, name) for group in self.edges]) for name in ("first", "second")
        )
        return JointEquations(
            jnp.full((), jnp.inf, dtype),
            jnp.zeros((num_maps, 6), dtype),
            jnp.zeros((num_maps, 6, 6), dtype),
            jnp.zeros((first.shape[0], 6, 6), dtype),
            first,
            second,
        )
