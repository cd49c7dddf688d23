"""Large cliques by greedy growth: lower bounds that let an exact search prune."""

import numpy as np


def greedy_clique(
    graph: np.ndarray, edges: np.ndarray, shared: np.ndarray, num_starts: int = 32
) -> np.ndarray:
    """A large clique, not always the largest: grown from the nodes in most triangles.

    Args:
        graph: Symmetric bool (m, m) with an edge, no diagonal.
        edges: Edges of the graph.
        shared: Common neighbours of each edge.
        num_starts: Nodes to start from.
    """
    # Each triangle of a node counts twice, once for either of its edges there, which changes no order.
    triangles = np.bincount(edges.reshape(-1), np.repeat(shared, 2), len(graph))
    best = edges[0]
    # Large cliques show in triangles: one of k nodes puts each of them into (k - 1)(k - 2) / 2.
    for v in np.argsort(-triangles, kind="stable")[:num_starts]:
        clique = _grow(graph, int(v))
        if len(clique) > len(best):
            best = clique
    return best


def _grow(graph: np.ndarray, start: int) -> np.ndarray:
    """Add the candidate with most links to the other candidates, until none is left."""
    candidates = np.flatnonzero(graph[start])
    return np.concatenate([[start], candidates[_grow_inside(graph[np.ix_(candidates, candidates)])]])


def _grow_inside(inside: np.ndarray) -> np.ndarray:
    """Members, among the rows of a dense graph, of the clique that grows by most links."""
    names, members = np.arange(len(inside)), []
    while len(names):
        pick = int(np.argmax(np.count_nonzero(inside, axis=1)))
        members.append(int(names[pick]))
        keep = np.flatnonzero(inside[pick])
        names, inside = names[keep], inside[np.ix_(keep, keep)]
    return np.asarray(members, np.int64)


def quick_clique(rows: np.ndarray, edges: np.ndarray, num_starts: int = 4) -> np.ndarray:
    """`greedy_clique` for a large graph: triangles are counted only of the nodes with most edges.

    Args:
        rows: Packed rows, no diagonal.
        edges: Edges (e, 2), at least one.
        num_starts: Nodes to start from.
    """
    # Nodes of highest degree whose triangles are counted before any clique is grown.
    num_tried = 96
    degree = np.bincount(edges.reshape(-1), minlength=len(rows))
    tried = np.argsort(-degree, kind="stable")[:num_tried]
    triangles = np.zeros(len(tried), np.int64)
    neighbours = []
    for k, v in enumerate(tried):
        beside = _members(rows[v])
        neighbours.append(beside)
        triangles[k] = np.bitwise_count(rows[beside] & rows[v]).sum(dtype=np.int64)
    # An edge is a clique of two nodes, so that there is a bound even where nothing grows.
    best = edges[0]
    for k in np.argsort(-triangles, kind="stable")[:num_starts]:
        beside = neighbours[k]
        inside = np.unpackbits(rows[beside].view(np.uint8), axis=1, bitorder="little")[:, beside].astype(bool)
        clique = np.concatenate([[tried[k]], beside[_grow_inside(inside)]])
        if len(clique) > len(best):
            best = clique
    return best


def _members(row: np.ndarray) -> np.ndarray:
    """Set bits of a packed row."""
    return np.flatnonzero(np.unpackbits(row.view(np.uint8), bitorder="little"))
