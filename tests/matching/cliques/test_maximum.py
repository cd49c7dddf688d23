"""Maximum cliques, all of them, and budgets, against networkx."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oracles.matching import is_clique
from random_graphs import networkx_maximum, random_graph
from voxjax import InputError
from voxjax.matching.cliques.maximum import maximum_clique


@settings(max_examples=150, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), size=st.integers(1, 40), density=st.floats(0.0, 1.0))
def test_all_maximum_cliques_equal_networkx(seed, size, density):
    adjacency = random_graph(seed, size, density)
    found = maximum_clique(adjacency, all_maximum=True, max_cliques=10_000)
    _, expected = networkx_maximum(adjacency)
    assert found.completed
    assert found.has_all_ties
    assert [t.tolist() for t in found.ties] == expected


@pytest.mark.parametrize(("size", "density"), [(300, 0.1), (200, 0.3), (120, 0.5), (90, 0.7)])
def test_larger_random_graphs_equal_networkx(size, density):
    adjacency = random_graph(size, size, density)
    found = maximum_clique(adjacency)
    assert found.completed
    assert is_clique(adjacency, found.members)
    assert len(found.members) == networkx_maximum(adjacency)[0]


def test_planted_clique_among_thousands_of_nodes():
    adjacency = random_graph(1, 2500, 0.02)
    planted = np.sort(np.random.default_rng(2).choice(2500, 12, replace=False))
    adjacency[np.ix_(planted, planted)] = True
    np.fill_diagonal(adjacency, False)
    found = maximum_clique(adjacency)
    assert found.members.tolist() == planted.tolist()


def test_relabelling_nodes_relabels_the_cliques():
    adjacency = random_graph(3, 30, 0.5)
    order = np.random.default_rng(4).permutation(30)
    first = maximum_clique(adjacency, all_maximum=True, max_cliques=1000).ties
    second = maximum_clique(adjacency[np.ix_(order, order)], all_maximum=True, max_cliques=1000).ties
    assert sorted(sorted(order[t].tolist()) for t in second) == sorted(t.tolist() for t in first)


def test_same_input_same_output():
    adjacency = random_graph(5, 80, 0.4)
    first, second = maximum_clique(adjacency), maximum_clique(adjacency)
    assert first.members.tolist() == second.members.tolist()
    assert first.num_nodes == second.num_nodes


def test_diagonal_is_ignored():
    adjacency = random_graph(6, 20, 0.5)
    looped = adjacency | np.eye(20, dtype=bool)
    assert maximum_clique(looped).members.tolist() == maximum_clique(adjacency).members.tolist()


def test_no_nodes_no_edges_and_complete_graphs():
    assert maximum_clique(np.zeros((0, 0), bool)).members.tolist() == []
    alone = maximum_clique(np.zeros((5, 5), bool), all_maximum=True)
    assert [t.tolist() for t in alone.ties] == [[0], [1], [2], [3], [4]]
    assert maximum_clique(np.ones((70, 70), bool)).members.tolist() == list(range(70))


@pytest.mark.parametrize("seed", range(200))
def test_size_of_random_graphs_equals_networkx(seed):
    rng = np.random.default_rng([seed, 5])
    adjacency = random_graph(rng, int(rng.integers(2, 70)), rng.uniform(0.02, 0.8))
    found = maximum_clique(adjacency)
    assert found.completed
    assert is_clique(adjacency, found.members)
    assert len(found.members) == networkx_maximum(adjacency)[0]


def test_time_budget_is_reported_and_leaves_a_clique():
    adjacency = random_graph(15, 150, 0.7)
    found = maximum_clique(adjacency, max_seconds=1e-6)
    assert not found.completed
    assert found.stopped_by == "time"
    assert is_clique(adjacency, found.members)


def test_no_time_is_refused():
    with pytest.raises(InputError, match="max_seconds"):
        maximum_clique(random_graph(16, 5, 0.5), max_seconds=0.0)


def test_budget_is_reported_and_leaves_a_clique():
    adjacency = random_graph(7, 150, 0.7)
    found = maximum_clique(adjacency, max_nodes=20)
    assert not found.completed
    assert not found.has_all_ties
    assert found.num_nodes <= 21
    assert found.stopped_by == "nodes"
    assert is_clique(adjacency, found.members)


def test_more_ties_than_asked_for_are_reported():
    # A complete 4-partite graph with parts of 3: 81 maximum cliques.
    part = np.repeat(np.arange(4), 3)
    found = maximum_clique(part[:, None] != part[None, :], all_maximum=True, max_cliques=10)
    assert len(found.ties) == 10
    assert found.completed
    assert not found.has_all_ties
    assert len({tuple(t) for t in found.ties}) == 10


def test_a_graph_with_one_directed_edge_is_refused():
    adjacency = random_graph(12, 6, 0.5)
    adjacency[0, 1], adjacency[1, 0] = True, False
    with pytest.raises(InputError, match="symmetric"):
        maximum_clique(adjacency)


def test_every_pair_in_a_tie_is_an_edge():
    adjacency = random_graph(11, 50, 0.5)
    for tie in maximum_clique(adjacency, all_maximum=True).ties:
        assert all(adjacency[i, j] for i, j in itertools.combinations(tie.tolist(), 2))
