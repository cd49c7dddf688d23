"""Random graphs, for the tests of cliques."""

import networkx as nx
import numpy as np


def random_graph(seed, size, density):
    """A symmetric Boolean matrix without loops."""
    upper = np.triu(np.random.default_rng(seed).uniform(size=(size, size)) < density, 1)
    return upper | upper.T


def networkx_maximum(adjacency):
    cliques = [sorted(c) for c in nx.find_cliques(nx.from_numpy_array(adjacency))]
    largest = max(map(len, cliques))
    return largest, sorted(c for c in cliques if len(c) == largest)
