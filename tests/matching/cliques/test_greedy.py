"""Greedy cliques are maximal cliques."""

from oracles.matching import is_clique
from random_graphs import random_graph
from voxjax.matching.cliques.graph_rows import common_neighbours, edges_of_rows, pack
from voxjax.matching.cliques.greedy import greedy_clique, quick_clique


def test_quick_clique_is_a_clique():
    adjacency = random_graph(13, 150, 0.3)
    found = quick_clique(pack(adjacency), edges_of_rows(pack(adjacency)))
    assert is_clique(adjacency, found)
    assert not adjacency[found].all(axis=0).any()


def test_greedy_gives_a_maximal_clique():
    adjacency = random_graph(9, 60, 0.4)
    edges = edges_of_rows(pack(adjacency))
    found = greedy_clique(adjacency, edges, common_neighbours(pack(adjacency), edges))
    assert is_clique(adjacency, found)
    assert not adjacency[found].all(axis=0).any()
