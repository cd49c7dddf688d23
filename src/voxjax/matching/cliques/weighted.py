"""Exact maximum-weight clique: the search of `clique`, with sums of weights in the place of counts."""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from ..._checks import InputError, check_positive
from ..._types import Array
from .branch_and_bound import bitsets
from .budget import Budget
from .graph_rows import edges_of_rows, from_edges, pack
from .maximum import MAX_SEARCH_NODES, Limit, check_square, without_diagonal

_CHUNK_WORDS = 1 << 16
_NUM_STARTS = 32

_ROUNDING = 1e-9
"""Sums of weights closer than this share of the total count as equal: float64 sums depend on their order."""


class WeightedClique(NamedTuple):
    """A clique of largest weight.

    Attributes:
        members: int32 (k,), increasing.
        weight: Sum of the members' weights.
        completed: Whether the search ended inside its budget, so that no heavier clique exists.
        num_nodes: Nodes of the search tree that were visited.
        stopped_by: Which limit of the budget was hit, None for none.
    """

    members: np.ndarray
    weight: float
    completed: bool
    num_nodes: int
    stopped_by: Limit | None


def maximum_weight_clique(
    adjacency: Bool[Array, "m m"],
    weights: Float[Array, "w"],
    *,
    max_nodes: int = MAX_SEARCH_NODES,
    max_seconds: float | None = None,
) -> WeightedClique:
    """Set of nodes that are all joined to each other, of the largest sum of weights.

    Args:
        adjacency: Symmetric; the diagonal is ignored.
        weights: Weight of each node, positive.
        max_nodes: Budget of the search tree. When it is spent, the heaviest clique so far is returned.
        max_seconds: Budget of time [s], or None. Where it ends a search, the result depends on the machine.

    Returns:
        The clique; of several, the one found first in a fixed order. Empty for a graph without nodes.

    Raises:
        InputError: If the matrix is not square or not symmetric, or a weight is not positive and finite.
    """
    matrix = check_square(adjacency)
    weight = np.asarray(weights, np.float64)
    if weight.shape != matrix.shape[:1]:
        raise InputError(f"weights must have one entry a node ({len(matrix)}), got shape {weight.shape}.")
    if not (np.isfinite(weight) & (weight > 0)).all():
        raise InputError("weights must be positive and finite; leave nodes of no weight out.")
    if max_seconds is not None:
        check_positive("max_seconds", max_seconds, "s")
    budget = Budget(max_nodes, max_seconds)
    if not len(matrix):
        return WeightedClique(np.zeros(0, np.int32), 0.0, True, 0, None)
    # Heaviest first: words of 64 nodes then hold nearly equal weights, which makes their bound tight.
    order = np.argsort(-weight, kind="stable")
    rows = without_diagonal(pack(matrix[np.ix_(order, order)]))
    edges = edges_of_rows(rows)
    search = _Search(weight[order], budget)
    if len(edges):
        search.run(rows, edges)
    members = np.sort(order[search.best]).astype(np.int32)
    return WeightedClique(
        members, math.fsum(weight[members]), budget.stopped_by is None, budget.num_nodes, budget.stopped_by
    )


class _Search:
    """Branch and bound; nodes are numbered by falling weight."""

    def __init__(self, weight: np.ndarray, budget: Budget) -> None:
        self.weight = weight
        self.budget = budget
        self.margin = _ROUNDING * float(weight.sum())
        self.best = np.zeros(1, np.int64)
        self.best_weight = float(weight[0])

    def record(self, members: np.ndarray | list[int]) -> None:
        """Keep a clique that is heavier than the best."""
        total = float(self.weight[members].sum())
        if total > self.best_weight + self.margin:
            self.best, self.best_weight = np.asarray(members, np.int64), total

    def run(self, rows: np.ndarray, edges: np.ndarray) -> None:
        """Bound from below by greedy growth, drop edges, search what is left."""
        bound = self._edge_bounds(rows, edges)
        nodes, graph, edges = from_edges(np.arange(len(rows)), edges)
        for v in np.argsort(-np.bincount(edges.reshape(-1), np.repeat(bound, 2)), kind="stable")[
            :_NUM_STARTS
        ]:
            self.record(nodes[_grow_heavy(graph, self.weight[nodes], int(v))])
        while True:
            is_kept = bound > self.best_weight + self.margin
            if is_kept.all() or not is_kept.any():
                break
            nodes, graph, edges = from_edges(nodes, edges[is_kept])
            bound = self._edge_bounds(pack(graph), edges, nodes)
        if is_kept.any():
            self._search_nodes(nodes, graph)

    def _edge_bounds(
        self, rows: np.ndarray, edges: np.ndarray, nodes: np.ndarray | None = None
    ) -> np.ndarray:
        """No clique through an edge is heavier than its two nodes and all their common neighbours."""
        weight = self.weight if nodes is None else self.weight[nodes]
        heaviest = weight[::64].astype(np.float32) * np.float32(1.0 + 1e-6)
        bound = weight[edges].sum(axis=1)
        step = max(1, _CHUNK_WORDS // rows.shape[1])
        for start in range(0, len(edges), step):
            i, j = edges[start : start + step].T
            bound[start : start + step] += np.bitwise_count(rows[i] & rows[j]).astype(np.float32) @ heaviest
        # Above any rounding of the float32 sums.
        return bound * (1.0 + 1e-5)

    def _search_nodes(self, nodes: np.ndarray, graph: np.ndarray) -> None:
        """Each node with its later neighbours, lightest node first, so that few heavy nodes come late."""
        weight = self.weight[nodes]
        for v in range(len(nodes) - 1, -1, -1):
            if not self.budget.look():
                return
            # Numbers fall with weight: the neighbours before v are the heavier ones.
            beside = np.flatnonzero(graph[v, :v])
            sub = graph[np.ix_(beside, beside)]
            while weight[v] + weight[beside].sum() > self.best_weight + self.margin:
                reachable = weight[v] + weight[beside] + sub @ weight[beside]
                is_kept = reachable > self.best_weight + self.margin
                if is_kept.all():
                    self._branch(sub, nodes[beside], int(nodes[v]))
                    break
                beside, sub = beside[is_kept], sub[np.ix_(is_kept, is_kept)]
            if self.budget.stopped_by is not None:
                return

    def _branch(self, graph: np.ndarray, names: np.ndarray, root: int) -> None:
        """Cliques of `graph`, each with the root added; iterative."""
        rows, weight = bitsets(graph), self.weight[names].tolist()
        clique, total = [root], [float(self.weight[root])]
        candidates = [(1 << len(names)) - 1]
        stack = [_colour_by_weight(rows, weight, candidates[0], self.best_weight + self.margin - total[0])]
        if not len(names):
            self.record(clique)
        while stack:
            if not stack[-1]:
                stack.pop()
                candidates.pop()
                clique.pop()
                total.pop()
                continue
            bit, bound = stack[-1].pop()
            if total[-1] + bound <= self.best_weight + self.margin:
                stack[-1].clear()
                continue
            if not self.budget.spend():
                return
            inside = candidates[-1] & rows[bit]
            candidates[-1] &= ~(1 << bit)
            clique.append(int(names[bit]))
            total.append(total[-1] + weight[bit])
            candidates.append(inside)
            if not inside:
                self.record(clique)
            stack.append(_colour_by_weight(rows, weight, inside, self.best_weight + self.margin - total[-1]))


def _grow_heavy(graph: np.ndarray, weight: np.ndarray, start: int) -> np.ndarray:
    """Add the candidate that keeps most weight within reach, until none is left."""
    members, candidates = [start], np.flatnonzero(graph[start])
    while len(candidates):
        inside = graph[np.ix_(candidates, candidates)]
        pick = int(np.argmax(weight[candidates] + inside @ weight[candidates]))
        members.append(int(candidates[pick]))
        candidates = candidates[inside[pick]]
    return np.asarray(members)


def _colour_by_weight(
    rows: list[int], weight: list[float], candidates: int, needed: float
) -> list[tuple[int, float]]:
    """Greedy colouring: (node, bound of a clique that ends in it), for nodes whose bound is above `needed`.

    A clique has one node of a colour at most, so the heaviest node of each colour so far bounds it.
    """
    coloured = []
    before = 0.0
    while candidates:
        free, heaviest = candidates, 0.0
        while free:
            lowest = free & -free
            bit = lowest.bit_length() - 1
            candidates ^= lowest
            free = (free ^ lowest) & ~rows[bit]
            heaviest = max(heaviest, weight[bit])
            if before + heaviest > needed:
                coloured.append((bit, before + heaviest))
        before += heaviest
    return coloured
