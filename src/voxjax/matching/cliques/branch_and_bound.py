"""Branch and bound for cliques: depth first over bitsets, bounded by a greedy colouring."""

from collections.abc import Callable

import numpy as np

from .budget import SearchBudget
from .graph_rows import pack, peeling_order, prune

Record = Callable[[list[int]], bool]
"""Takes a clique of at least the goal's size that nothing later extends; False ends the search."""


class Search:
    """A search for cliques of at least `goal` nodes, two or more; the goal may rise while it runs.

    Attributes:
        goal: Smallest size that is still of interest.
        budget: What may be spent; shared with other searches.
        stopped: Whether the budget or the receiver ended the search.
    """

    def __init__(self, goal: int, budget: SearchBudget) -> None:
        self.goal = goal
        self.budget = budget
        self.stopped = False

    def run(self, graph: np.ndarray, edges: np.ndarray, shared: np.ndarray, record: Record) -> None:
        """Search the neighbourhoods of all nodes, each together with the nodes after it in peeling order.

        Args:
            graph: Symmetric bool (m, m), no diagonal.
            edges: Edges of the graph (e, 2).
            shared: Common neighbours of each edge.
            record: Called with every clique found, in a fixed order.
        """
        nodes, graph = prune(graph, edges, self.goal, shared)
        if not len(nodes):
            return
        order = peeling_order(graph)
        nodes, graph = nodes[order], graph[np.ix_(order, order)]
        # Each clique is found once, at its first node in this order. The densest part falls away last: searched
        # first, it raises the goal before the many sparse neighbourhoods are looked at.
        for v in range(len(nodes) - 1, -1, -1):
            if not self.budget.look():
                self.stopped = True
                return
            later = v + 1 + np.flatnonzero(graph[v, v + 1 :])
            sub = graph[np.ix_(later, later)]
            # Within the neighbourhood, nodes with too few links to the rest of it.
            # The goal may have risen since the graph was pruned, so each neighbourhood is held against the goal
            # of now.
            while len(later) + 1 >= self.goal:
                is_core = np.count_nonzero(sub, axis=1) >= self.goal - 2
                if is_core.all():
                    self._branch(sub, nodes[later].tolist(), int(nodes[v]), record)
                    break
                later, sub = later[is_core], sub[np.ix_(is_core, is_core)]
            if self.stopped:
                return

    def _branch(self, graph: np.ndarray, names: list[int], root: int, record: Record) -> None:
        """Cliques of `graph`, each with the root added; iterative."""
        count = len(names)
        # Highest degree first, so that bit 0 is coloured first and branched on last.
        order = np.argsort(-np.count_nonzero(graph, axis=1), kind="stable")
        rows = bitsets(graph[np.ix_(order, order)])
        names = [names[i] for i in order]
        clique = [root]
        candidates = [(1 << count) - 1]
        stack = [_colour(rows, candidates[0], self.goal - 1)]
        while stack:
            if not stack[-1]:
                stack.pop()
                candidates.pop()
                clique.pop()
                continue
            bit, colour = stack[-1].pop()
            # Colours fall along the list: what is left of it cannot reach the goal either.
            if len(clique) + colour < self.goal:
                stack[-1].clear()
                continue
            if not self.budget.spend():
                self.stopped = True
                return
            inside = candidates[-1] & rows[bit]
            # All cliques with this node are found below it; the branches beside it do without.
            candidates[-1] &= ~(1 << bit)
            clique.append(names[bit])
            # Only a clique that no candidate extends is recorded; others are parts of what is found below.
            if inside:
                candidates.append(inside)
                stack.append(_colour(rows, inside, self.goal - len(clique)))
                continue
            if len(clique) >= self.goal and not record(clique.copy()):
                self.stopped = True
                return
            clique.pop()


def bitsets(graph: np.ndarray) -> list[int]:
    """Rows of a Boolean matrix as whole numbers."""
    return [int.from_bytes(row.tobytes(), "little") for row in pack(graph)]


def _colour(rows: list[int], candidates: int, needed: int) -> list[tuple[int, int]]:
    """Greedy colouring: (node, colours so far), for nodes that a clique of `needed` more could end in.

    A set of nodes has no clique larger than its number of colours, so nodes of the first `needed - 1` colours
    need no branch of their own.
    """
    # The first `needed - 1` colours are given but not listed, so that the list holds what has to be branched
    # on.
    coloured = []
    colour = 0
    while candidates:
        colour += 1
        free = candidates
        while free:
            lowest = free & -free
            bit = lowest.bit_length() - 1
            candidates ^= lowest
            # A colour takes nodes without an edge between them: a clique has one node of it at most.
            free = (free ^ lowest) & ~rows[bit]
            if colour >= needed:
                coloured.append((bit, colour))
    return coloured
