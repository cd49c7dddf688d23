"""Packed rows and edge lists against dense matrices and networkx."""

import itertools

import networkx as nx
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from oracles.matching import is_clique
from random_graphs import networkx_maximum, random_graph
from voxjax.matching.cliques.graph_rows import (
    common_neighbours,
    edges_of_rows,
    pack,
    peeling_order,
    prune,
    usable_edges,
)


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), size=st.integers(3, 25), density=st.floats(0.3, 0.9))
def test_pruning_keeps_every_clique_of_the_size(seed, size, density):
    adjacency = random_graph(seed, size, density)
    if not adjacency.any():
        return
    largest, cliques = networkx_maximum(adjacency)
    nodes, graph = prune(adjacency, edges_of_rows(pack(adjacency)), largest)
    position = {int(v): k for k, v in enumerate(nodes)}
    for clique in cliques:
        assert is_clique(graph, [position[v] for v in clique])


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), size=st.integers(3, 90), density=st.floats(0.1, 0.9))
def test_the_first_sieve_keeps_every_clique_of_the_size(seed, size, density):
    adjacency = random_graph(seed, size, density)
    if not adjacency.any():
        return
    rng = np.random.default_rng(seed)
    planted = rng.choice(size, max(3, size // 4), replace=False)
    adjacency[np.ix_(planted, planted)] = True
    np.fill_diagonal(adjacency, False)
    kept = usable_edges(pack(adjacency), edges_of_rows(pack(adjacency)), len(planted))
    wanted = {tuple(sorted(p)) for p in itertools.combinations(planted.tolist(), 2)}
    assert wanted <= {tuple(e) for e in kept.tolist()}


def test_common_neighbours_by_packed_words():
    adjacency = random_graph(8, 130, 0.3)
    i, j = np.triu_indices(130, 1)
    expected = (adjacency.astype(int) @ adjacency.astype(int))[i, j]
    np.testing.assert_array_equal(common_neighbours(pack(adjacency), np.stack([i, j], axis=1)), expected)


def test_peeling_order_leaves_no_more_later_neighbours_than_the_core_number():
    adjacency = random_graph(10, 80, 0.2)
    order = peeling_order(adjacency)
    assert sorted(order.tolist()) == list(range(80))
    cores = max(nx.core_number(nx.from_numpy_array(adjacency)).values())
    subset = adjacency[np.ix_(order, order)]
    assert np.triu(subset).sum(axis=1).max() <= 2 * cores
