"""Graphs as packed rows and edge lists, and what of them a clique of a given size can use.

Rows are uint64 words, bit j of row i standing for the edge (i, j). Everything here is NumPy over whole graphs; what
is left of a graph afterwards is small, and is searched node by node elsewhere.
"""

import numpy as np

from ..._checks import InputError

_CHUNK_WORDS = 1 << 16
"""Words gathered at a time: they stay in the cache of a core."""


def pack(graph: np.ndarray) -> np.ndarray:
    """Rows of a Boolean matrix as uint64 words."""
    words = -(-graph.shape[1] // 64)
    packed = np.zeros((len(graph), words * 8), np.uint8)
    # Rows are filled up with zeros to whole words; "little" puts column j at bit j % 64 of word j // 64.
    packed[:, : -(-graph.shape[1] // 8)] = np.packbits(graph, axis=1, bitorder="little")
    return packed.view(np.uint64)


def edges_of_rows(rows: np.ndarray) -> np.ndarray:
    """Edges (e, 2) of a symmetric graph, the smaller node first, in lexicographic order; the diagonal is ignored.

    Args:
        rows: Packed rows.

    Raises:
        InputError: If an edge has one direction only.
    """
    one, low = np.uint64(1), np.uint64(63)
    node, word = np.nonzero(rows)
    # Words left of the diagonal hold the backward direction of edges alone, half of the graph.
    is_upper = word >= node >> 6
    node, word = node[is_upper], word[is_upper]
    bits, keys = rows[node, word], []
    key = node * rows.shape[1] * 64 + word * 64
    # One bit of every word a round; most words hold one or two.
    while len(bits):
        # An unsigned number has its negative written out; the bits below the lowest one are as many as its
        # position.
        lowest = bits & (~bits + one)
        keys.append(key + np.bitwise_count(lowest - one))
        bits = bits ^ lowest
        is_left = bits != 0
        bits, key = bits[is_left], key[is_left]
    found = np.sort(np.concatenate(keys)) if keys else np.zeros(0, np.int64)
    edges = np.stack(np.divmod(found, rows.shape[1] * 64), axis=1)
    # Words on the diagonal hold both directions and loops.
    edges = edges[edges[:, 0] < edges[:, 1]]
    num_bits = int(np.bitwise_count(rows).sum(dtype=np.int64))
    diagonal = np.arange(len(rows))
    num_loops = np.count_nonzero((rows[diagonal, diagonal >> 6] >> (diagonal.astype(np.uint64) & low)) & one)
    # Every forward edge has its way back, and no bit is left over: then no backward edge is alone either.
    backward = (rows[edges[:, 1], edges[:, 0] >> 6] >> (edges[:, 0].astype(np.uint64) & low)) & one
    if not backward.all() or num_bits != 2 * len(edges) + num_loops:
        raise InputError("adjacency must be symmetric; join both directions with `adjacency | adjacency.T`.")
    return edges


def from_edges(nodes: np.ndarray, edges: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The nodes that have an edge, the dense graph between them, and the edges in its numbering."""
    is_used = np.zeros(len(nodes), bool)
    is_used[edges.reshape(-1)] = True
    edges = (np.cumsum(is_used) - 1)[edges]
    count = int(np.count_nonzero(is_used))
    graph = np.zeros((count, count), bool)
    graph[edges[:, 0], edges[:, 1]] = True
    graph[edges[:, 1], edges[:, 0]] = True
    return nodes[is_used], graph, edges


def common_neighbours(rows: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Number of common neighbours of each pair of nodes (e, 2), from packed rows."""
    counts = np.empty(len(edges), np.int32)
    step = max(1, _CHUNK_WORDS // max(rows.shape[1], 1))
    for start in range(0, len(edges), step):
        i, j = edges[start : start + step].T
        counts[start : start + step] = np.bitwise_count(rows[i] & rows[j]).sum(axis=1, dtype=np.int32)
    return counts


def usable_edges(rows: np.ndarray, edges: np.ndarray, size: int) -> np.ndarray:
    """Edges between nodes of which some clique of `size` nodes may consist: a first, cheap sieve.

    A clique is met at its first node u: its other nodes are later neighbours of u, each with `size - 2` common
    neighbours with u later than u. Only columns from u on are read, half of the matrix.

    Args:
        rows: Packed rows.
        edges: All edges in lexicographic order.
        size: At least 2.
    """
    # Degrees cost least to look at, and leave fewer edges whose common neighbours are counted.
    edges = peel(edges, len(rows), size - 1)
    later = np.bincount(edges[:, 0], minlength=len(rows))
    wanted = edges[later[edges[:, 0]] >= size - 1]
    is_good = np.zeros(len(wanted), bool)
    start = 0
    while start < len(wanted):
        # Edges come in the order of their first node, so the columns from the first one's on serve the whole
        # chunk. Nodes before u that they still hold can only count too much, and a sieve may keep too much.
        column = int(wanted[start, 0]) >> 6
        stop = start + max(1, _CHUNK_WORDS // (rows.shape[1] - column))
        i, j = wanted[start:stop].T
        counts = np.bitwise_count(rows[i, column:] & rows[j, column:]).sum(axis=1, dtype=np.int32)
        is_good[start:stop] = counts >= size - 2
        start = stop
    good = wanted[is_good]
    good = good[np.bincount(good[:, 0], minlength=len(rows))[good[:, 0]] >= size - 1]
    # Edges between nodes of a clique that were not counted, because they do not start at its first node, come
    # back with their nodes.
    is_used = np.zeros(len(rows), bool)
    is_used[good.reshape(-1)] = True
    return edges[is_used[edges].all(axis=1)]


def prune(
    graph: np.ndarray, edges: np.ndarray, size: int, shared: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Drop nodes and edges that no clique of `size` nodes can use.

    Such a clique gives each of its nodes `size - 1` neighbours and each edge `size - 2` common ones.

    Args:
        graph: Symmetric bool (m, m), no diagonal.
        edges: Edges of the graph (e, 2).
        size: Nodes of the cliques that are looked for, at least 2.
        shared: Common neighbours of each edge, if they are known.

    Returns:
        Nodes that stay, and the graph between them.
    """
    nodes = np.arange(len(graph))
    is_weak = np.zeros(len(edges), bool) if shared is None else shared < size - 2
    # Without known counts a first round has to count them, even though no edge is weak yet.
    is_first = shared is None
    # Each edge that falls takes common neighbours from others, until none falls any more.
    while is_first or is_weak.any():
        is_first = False
        edges = peel(edges[~is_weak], len(nodes), size - 1)
        if not len(edges):
            return nodes[:0], graph[:0, :0]
        nodes, graph, edges = from_edges(nodes, edges)
        is_weak = common_neighbours(pack(graph), edges) < size - 2
    return nodes, graph


def peel(edges: np.ndarray, num_nodes: int, min_degree: int) -> np.ndarray:
    """Edges whose two nodes keep `min_degree` edges when all others are gone (a core of the graph)."""
    while len(edges):
        degree = np.bincount(edges.reshape(-1), minlength=num_nodes)
        is_kept = (degree[edges] >= min_degree).all(axis=1)
        if is_kept.all():
            break
        edges = edges[is_kept]
    return edges


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
