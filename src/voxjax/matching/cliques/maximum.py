"""Exact maximum clique of a sparse graph: greedy bound, pruning by triangles, bitset branch and bound.

The pruning is NumPy on packed words; what survives it is small, and is searched with whole numbers as bitsets. The
effort is bounded by a number of search nodes, and then the result is the same everywhere, or also by a time.
"""

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Bool

from ..._checks import InputError, check_positive
from ..._types import Array
from .branch_and_bound import Search
from .budget import SearchBudget
from .graph_rows import common_neighbours, edges_of_rows, from_edges, pack, usable_edges
from .greedy import greedy_clique, quick_clique

MAX_CLIQUE_NODES = 200_000
"""Default budget; a node costs 10 to 100 microseconds."""

Limit = Literal["nodes", "time"]


class Clique(NamedTuple):
    """A maximum clique.

    Attributes:
        members: int32 (k,), increasing.
        completed: Whether the search ended inside its budget, so that no larger clique exists.
        ties: All maximum cliques that were asked for, the first is `members`.
        has_all_ties: Whether `ties` is complete.
        num_nodes: Nodes of the search tree that were visited.
        stopped_by: The limit of the budget that was hit, None for none.
    """

    members: np.ndarray
    completed: bool
    ties: tuple[np.ndarray, ...]
    has_all_ties: bool
    num_nodes: int
    stopped_by: Limit | None = None


def maximum_clique(
    adjacency: Bool[Array, "m m"],
    *,
    max_nodes: int = MAX_CLIQUE_NODES,
    max_seconds: float | None = None,
    all_maximum: bool = False,
    max_cliques: int = 64,
) -> Clique:
    """Largest set of nodes that are all joined to each other.

    Args:
        adjacency: Symmetric; the diagonal is ignored.
        max_nodes: Budget of the search tree. When it is spent, the largest clique so far is returned.
        max_seconds: Budget of time [s], or None. Where it ends a search, the result depends on the machine.
        all_maximum: Whether to list all cliques of the largest size.
        max_cliques: How many of them are listed at most.

    Returns:
        The clique; of several, the one found first in a fixed order. Empty for a graph without nodes.

    Raises:
        InputError: If the matrix is not square or not symmetric, or the time is not positive.

    References:
        Section IV.B: the maximum common subgraph is the maximum clique of the association graph.
    """
    matrix = np.asarray(adjacency)
    if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1]:
        raise InputError(f"adjacency must be a square matrix, got shape {matrix.shape}.")
    if max_seconds is not None:
        check_positive("max_seconds", max_seconds, "s")
    budget = SearchBudget(max_nodes, max_seconds)
    if not len(matrix):
        empty = np.zeros(0, np.int32)
        return Clique(empty, True, (empty,), True, 0)
    # A node is no neighbour of itself here: a loop would count as one more common neighbour.
    rows = _without_diagonal(pack(matrix))
    edges = edges_of_rows(rows)
    if not len(edges):
        return _edgeless(len(matrix), all_maximum, max_cliques)
    # A large clique is grown first: what no clique of its size can use falls before anything is searched.
    bound = quick_clique(rows, edges)
    # Ties are as large as the bound may be; a single clique is only worth a search if it is larger.
    size = len(bound) + 1 - int(all_maximum)
    # What follows takes a dense graph, which this part is small enough for.
    # Cliques of one node are no question here, since there is an edge.
    part = _Part.usable(rows, edges, max(size, 2))
    best, completed = part.largest(bound, budget)
    ties, has_all_ties = [best], False
    if all_maximum and completed:
        ties, has_all_ties = part.all_of_size(len(best), max_cliques, budget)
    # A search for ties that is cut short may have found none, and then the clique itself stands.
    found = _sorted(ties or [best])
    return Clique(found[0], completed, found, has_all_ties, budget.num_nodes, budget.stopped_by)


def _without_diagonal(rows: np.ndarray) -> np.ndarray:
    """Packed rows of a square matrix with the diagonal cleared, in place."""
    node = np.arange(len(rows))
    rows[node, node >> 6] &= ~(np.uint64(1) << (node & 63).astype(np.uint64))
    return rows


def _edgeless(count: int, wants_all: bool, max_cliques: int) -> Clique:
    """Every node alone is a maximum clique."""
    ties = tuple(np.asarray([i], np.int32) for i in range(min(count, max_cliques) if wants_all else 1))
    return Clique(ties[0], True, ties, wants_all and count <= max_cliques, 0)


def _sorted(cliques: list[np.ndarray]) -> tuple[np.ndarray, ...]:
    """Cliques of one size in lexicographic order, members in increasing order."""
    return tuple(sorted((np.sort(clique).astype(np.int32) for clique in cliques), key=tuple))


@dataclass(frozen=True)
class _Part:
    """The part of a graph that cliques of some size can use.

    Attributes:
        nodes: Nodes of the part, in the numbering of the whole graph.
        graph: Symmetric bool (m, m) between them.
        edges: (e, 2) in the numbering of the part.
        shared: Common neighbours of each edge.
    """

    nodes: np.ndarray
    graph: np.ndarray
    edges: np.ndarray
    shared: np.ndarray

    @classmethod
    def usable(cls, rows: np.ndarray, edges: np.ndarray, size: int) -> "_Part":
        """For cliques of at least `size` nodes."""
        nodes, graph, edges = from_edges(np.arange(len(rows)), usable_edges(rows, edges, size))
        return cls(nodes, graph, edges, common_neighbours(pack(graph), edges))

    def largest(self, bound: np.ndarray, budget: SearchBudget) -> tuple[np.ndarray, bool]:
        """A maximum clique, `bound` where nothing larger is here, and whether the search was completed."""
        best = bound
        if len(self.edges):
            grown = self.nodes[greedy_clique(self.graph, self.edges, self.shared)]
            best = grown if len(grown) > len(best) else best
        # Only what is larger is of interest, so that equal cliques are pruned like smaller ones.
        search = Search(len(best) + 1, budget)

        def record(clique: list[int]) -> bool:
            nonlocal best
            best = self.nodes[clique]
            search.goal = len(best) + 1
            return True

        search.run(self.graph, self.edges, self.shared, record)
        return best, not search.stopped

    def all_of_size(self, size: int, max_cliques: int, budget: SearchBudget) -> tuple[list[np.ndarray], bool]:
        """The maximal cliques of exactly `size` nodes, and whether these are all."""
        found: list[np.ndarray] = []
        search = Search(size, budget)

        def record(clique: list[int]) -> bool:
            # Cliques that another node would extend are no ties but parts of a larger one.
            if len(clique) > size or self.graph[clique].all(axis=0).any():
                return True
            if len(found) == max_cliques:
                return False
            found.append(self.nodes[clique])
            return True

        search.run(self.graph, self.edges, self.shared, record)
        return found, not search.stopped
