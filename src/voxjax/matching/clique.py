"""Exact maximum clique of a sparse graph: greedy bound, pruning by triangles, bitset branch and bound.

The pruning is dense NumPy on packed words; what survives it is small, and is searched with whole numbers as
bitsets. Deterministic: the effort is bounded by a number of search nodes, never by time.
"""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool

from .._checks import InputError
from .._types import Array

MAX_SEARCH_NODES = 200_000
"""Default budget; a node costs 10 to 100 microseconds."""

_NUM_GREEDY_STARTS = 32


class Clique(NamedTuple):
    """A maximum clique.

    Attributes:
        members: int32 (k,), increasing.
        completed: Whether the search ended inside its budget, so that no larger clique exists.
        ties: All maximum cliques that were asked for, the first is `members`.
        has_all_ties: Whether `ties` is complete.
        num_nodes: Nodes of the search tree that were visited.
    """

    members: np.ndarray
    completed: bool
    ties: tuple[np.ndarray, ...]
    has_all_ties: bool
    num_nodes: int


def maximum_clique(
    adjacency: Bool[Array, "m m"],
    *,
    max_nodes: int = MAX_SEARCH_NODES,
    all_maximum: bool = False,
    max_cliques: int = 64,
) -> Clique:
    """Largest set of nodes that are all joined to each other.

    Args:
        adjacency: Symmetric; the diagonal is ignored.
        max_nodes: Budget of the search tree. When it is spent, the largest clique so far is returned.
        all_maximum: Whether to list all cliques of the largest size.
        max_cliques: At most so many of them.

    Returns:
        The clique; of several, the one found first in a fixed order. Empty for a graph without nodes.

    Raises:
        InputError: If the matrix is not square or not symmetric.

    References:
        Section IV.B: the maximum common subgraph is the maximum clique of the association graph.
    """
    matrix = np.asarray(adjacency)
    if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1]:
        raise InputError(f"adjacency must be a square matrix, got shape {matrix.shape}.")
    if not len(matrix):
        empty = np.zeros(0, np.int32)
        return Clique(empty, True, (empty,), True, 0)
    edges = upper_edges(matrix)
    if not len(edges):
        return _edgeless(len(matrix), all_maximum, max_cliques)
    nodes, graph, edges = _from_edges(np.arange(len(matrix)), edges)
    shared = common_neighbours(pack(graph), edges)
    best = greedy_clique(graph, edges, shared)
    search = _Search(best=[int(i) for i in best], max_nodes=max_nodes)
    _solve(graph, edges, shared, search)
    ties, has_all_ties = [search.best], False
    if all_maximum and search.completed:
        again = _Search(
            best=search.best,
            max_nodes=max_nodes,
            num_nodes=search.num_nodes,
            ties=[],
            max_cliques=max_cliques,
        )
        _solve(graph, edges, shared, again)
        ties, has_all_ties, search.num_nodes = again.ties or ties, again.completed, again.num_nodes
    found = tuple(sorted((np.sort(nodes[np.asarray(t, np.int64)]).astype(np.int32) for t in ties), key=tuple))
    return Clique(found[0], search.completed, found, has_all_ties, search.num_nodes)


def upper_edges(matrix: np.ndarray) -> np.ndarray:
    """Edges (e, 2) of a symmetric Boolean matrix, the smaller node first, in lexicographic order.

    Raises:
        InputError: If an edge has one direction only.
    """
    pairs = np.stack(np.divmod(np.flatnonzero(matrix), len(matrix)), axis=1)
    edges = pairs[pairs[:, 0] < pairs[:, 1]]
    num_lower = np.count_nonzero(pairs[:, 0] > pairs[:, 1])
    if num_lower != len(edges) or not matrix[edges[:, 1], edges[:, 0]].all():
        raise InputError("adjacency must be symmetric; join both directions with `adjacency | adjacency.T`.")
    return edges


def _from_edges(nodes: np.ndarray, edges: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The nodes that have an edge, the dense graph between them, and the edges in its numbering."""
    is_used = np.zeros(len(nodes), bool)
    is_used[edges.reshape(-1)] = True
    edges = (np.cumsum(is_used) - 1)[edges]
    count = int(np.count_nonzero(is_used))
    graph = np.zeros((count, count), bool)
    graph[edges[:, 0], edges[:, 1]] = True
    graph[edges[:, 1], edges[:, 0]] = True
    return nodes[is_used], graph, edges


def _edgeless(count: int, all_maximum: bool, max_cliques: int) -> Clique:
    """Every node alone is a maximum clique."""
    ties = tuple(np.asarray([i], np.int32) for i in range(min(count, max_cliques) if all_maximum else 1))
    return Clique(ties[0], True, ties, all_maximum and count <= max_cliques, 0)


def pack(graph: np.ndarray) -> np.ndarray:
    """Rows of a Boolean matrix as uint64 words."""
    words = -(-graph.shape[1] // 64)
    packed = np.zeros((len(graph), words * 8), np.uint8)
    packed[:, : -(-graph.shape[1] // 8)] = np.packbits(graph, axis=1, bitorder="little")
    return packed.view(np.uint64)


def common_neighbours(rows: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Number of common neighbours of each pair of nodes (e, 2), from packed rows."""
    counts = np.empty(len(edges), np.int32)
    # Small parts stay in the cache of a core.
    step = max(1, (1 << 16) // max(rows.shape[1], 1))
    for start in range(0, len(edges), step):
        i, j = edges[start : start + step].T
        counts[start : start + step] = np.bitwise_count(rows[i] & rows[j]).sum(axis=1, dtype=np.int32)
    return counts


def greedy_clique(
    graph: np.ndarray, edges: np.ndarray, shared: np.ndarray, num_starts: int = _NUM_GREEDY_STARTS
) -> np.ndarray:
    """A large clique, not always the largest: grown from the nodes in most triangles.

    Args:
        graph: Symmetric bool (m, m) with an edge, no diagonal.
        edges: Its edges.
        shared: Common neighbours of each edge.
        num_starts: Nodes to start from.
    """
    triangles = np.bincount(edges.reshape(-1), np.repeat(shared, 2), len(graph))
    best = edges[0]
    for v in np.argsort(-triangles, kind="stable")[:num_starts]:
        clique = _grow(graph, int(v))
        if len(clique) > len(best):
            best = clique
    return best


def _grow(graph: np.ndarray, start: int) -> np.ndarray:
    """Add the candidate with most links to the other candidates, until none is left."""
    members = [start]
    candidates = np.flatnonzero(graph[start])
    inside = graph[np.ix_(candidates, candidates)]
    while len(candidates):
        pick = int(np.argmax(np.count_nonzero(inside, axis=1)))
        members.append(int(candidates[pick]))
        keep = np.flatnonzero(inside[pick])
        candidates, inside = candidates[keep], inside[np.ix_(keep, keep)]
    return np.asarray(members)


def prune(
    graph: np.ndarray, edges: np.ndarray, size: int, shared: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Drop nodes and edges that no clique of `size` nodes can use.

    Such a clique gives each of its nodes `size - 1` neighbours and each edge `size - 2` common ones.

    Args:
        graph: Symmetric bool (m, m), no diagonal.
        edges: Its edges (e, 2).
        size: Of the cliques that are looked for, at least 2.
        shared: Common neighbours of each edge, if they are known.

    Returns:
        Nodes that stay, and the graph between them.
    """
    nodes = np.arange(len(graph))
    is_weak = np.zeros(len(edges), bool) if shared is None else shared < size - 2
    is_first = shared is None
    while is_first or is_weak.any():
        is_first = False
        edges = _peel(edges[~is_weak], len(nodes), size - 1)
        if not len(edges):
            return nodes[:0], graph[:0, :0]
        nodes, graph, edges = _from_edges(nodes, edges)
        is_weak = common_neighbours(pack(graph), edges) < size - 2
    return nodes, graph


def _peel(edges: np.ndarray, num_nodes: int, min_degree: int) -> np.ndarray:
    """Edges whose two nodes keep `min_degree` edges when all others are gone (a core of the graph)."""
    while len(edges):
        degree = np.bincount(edges.reshape(-1), minlength=num_nodes)
        is_kept = (degree[edges] >= min_degree).all(axis=1)
        if is_kept.all():
            break
        edges = edges[is_kept]
    return edges


@dataclass
class _Search:
    """State of a branch and bound: the best clique so far, the budget, and the ties if they are wanted."""

    best: list[int]
    max_nodes: int
    num_nodes: int = 0
    ties: list[list[int]] | None = None
    max_cliques: int = 0
    completed: bool = True
    stopped: bool = field(default=False)

    @property
    def goal(self) -> int:
        """Smallest size that is still of interest."""
        return len(self.best) + (self.ties is None)

    def record(self, clique: list[int]) -> None:
        """Keep a clique of at least the goal's size."""
        if self.ties is None:
            self.best = clique
        elif len(self.ties) < self.max_cliques:
            self.ties.append(clique)
        else:
            self.stop()

    def stop(self) -> None:
        self.completed, self.stopped = False, True


def _solve(graph: np.ndarray, edges: np.ndarray, shared: np.ndarray, search: _Search) -> None:
    """Search the neighbourhoods of all nodes, each together with the nodes after it in peeling order."""
    nodes, graph = prune(graph, edges, search.goal, shared)
    if not len(nodes):
        return
    order = peeling_order(graph)
    nodes, graph = nodes[order], graph[np.ix_(order, order)]
    for v in range(len(nodes) - 1, -1, -1):
        later = v + 1 + np.flatnonzero(graph[v, v + 1 :])
        sub = graph[np.ix_(later, later)]
        # Within the neighbourhood, nodes with too few links to the rest of it.
        while len(later) + 1 >= search.goal:
            is_core = np.count_nonzero(sub, axis=1) >= search.goal - 2
            if is_core.all():
                _branch(sub, nodes[later].tolist(), int(nodes[v]), search)
                break
            later, sub = later[is_core], sub[np.ix_(is_core, is_core)]
        if search.stopped:
            return


def peeling_order(graph: np.ndarray) -> np.ndarray:
    """Order in which nodes of least degree fall away, so that few neighbours come later."""
    degree = np.count_nonzero(graph, axis=1).astype(np.int64)
    is_left = np.ones(len(graph), bool)
    order = []
    while is_left.any():
        lowest = degree[is_left].min()
        layer = np.flatnonzero(is_left & (degree <= lowest))
        order.append(layer)
        is_left[layer] = False
        degree -= np.count_nonzero(graph[layer], axis=0)
    return np.concatenate(order)


def _branch(graph: np.ndarray, names: list[int], root: int, search: _Search) -> None:
    """Cliques of `graph`, each with the root added: depth first, bounded by a colouring; iterative."""
    count = len(names)
    # Highest degree first, so that bit 0 is coloured first and branched on last.
    order = np.argsort(-np.count_nonzero(graph, axis=1), kind="stable")
    rows = [int.from_bytes(row.tobytes(), "little") for row in pack(graph[np.ix_(order, order)])]
    names = [names[i] for i in order]
    clique = [root]
    stack = [_colour(rows, (1 << count) - 1, search.goal - 1)]
    candidates = [(1 << count) - 1]
    while stack:
        if not stack[-1]:
            stack.pop()
            candidates.pop()
            clique.pop()
            continue
        bit, colour = stack[-1].pop()
        if len(clique) + colour < search.goal:
            stack[-1].clear()
            continue
        search.num_nodes += 1
        if search.num_nodes > search.max_nodes:
            search.stop()
            return
        inside = candidates[-1] & rows[bit]
        candidates[-1] &= ~(1 << bit)
        clique.append(names[bit])
        if len(clique) >= search.goal and not inside:
            search.record(clique.copy())
            if search.stopped:
                return
        if not inside:
            clique.pop()
            continue
        candidates.append(inside)
        stack.append(_colour(rows, inside, search.goal - len(clique)))


def _colour(rows: list[int], candidates: int, needed: int) -> list[tuple[int, int]]:
    """Greedy colouring: (node, colours so far), for nodes that a clique of `needed` more could end in.

    A set of nodes has no clique larger than its number of colours, so nodes of the first `needed - 1` colours
    need no branch of their own.
    """
    coloured = []
    colour = 0
    while candidates:
        colour += 1
        free = candidates
        while free:
            lowest = free & -free
            bit = lowest.bit_length() - 1
            candidates ^= lowest
            free = (free ^ lowest) & ~rows[bit]
            if colour >= needed:
                coloured.append((bit, colour))
    return coloured
