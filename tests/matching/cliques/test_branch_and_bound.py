"""The search for cliques against networkx, and what ends it early."""

import networkx
import numpy as np
import pytest

from voxjax.matching.cliques.branch_and_bound import Search, bitsets
from voxjax.matching.cliques.budget import SearchBudget


def random_edges(seed, size=14, density=0.5):
    """A symmetric graph without a diagonal, its edges (e, 2), and the common neighbours of each."""
    upper = np.triu(np.random.default_rng(seed).random((size, size)) < density, 1)
    graph, edges = upper | upper.T, np.argwhere(upper)
    shared = (graph[edges[:, 0]] & graph[edges[:, 1]]).sum(axis=1)
    return graph, edges, shared


def found_by(search, graph, edges, shared, most=10**9):
    found = []

    def record(clique):
        found.append(tuple(sorted(clique)))
        return len(found) < most

    search.run(graph, edges, shared, record)
    return found


@pytest.mark.parametrize("seed", range(6))
def test_all_maximal_cliques_of_the_size_are_found_once(seed):
    graph, edges, shared = random_edges(seed)
    maximal = {tuple(sorted(c)) for c in networkx.find_cliques(networkx.from_numpy_array(graph))}
    goal = max(map(len, maximal))
    found = found_by(Search(goal, SearchBudget(10**6)), graph, edges, shared)
    assert sorted(found) == sorted(clique for clique in maximal if len(clique) == goal)


def test_the_receiver_and_the_budget_end_the_search():
    graph, edges, shared = random_edges(1)
    search = Search(3, SearchBudget(10**6))
    assert len(found_by(search, graph, edges, shared, most=1)) == 1
    assert search.stopped
    search = Search(3, SearchBudget(2))
    found_by(search, graph, edges, shared)
    assert search.stopped
    assert search.budget.stopped_by == "nodes"


def test_rows_become_whole_numbers():
    graph = np.random.default_rng(0).random((5, 70)) < 0.5
    assert bitsets(graph) == [sum(1 << int(k) for k in np.flatnonzero(row)) for row in graph]
