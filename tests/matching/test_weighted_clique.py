import networkx as nx
import numpy as np
import pytest

from oracles.matching import is_clique
from voxjax import InputError
from voxjax.matching.cliques.weighted import maximum_weight_clique


def random_graph(seed):
    """Sizes 1 to 45 and all densities, with weights that are alike, spread or tied."""
    rng = np.random.default_rng([seed, 7])
    size = int(rng.integers(1, 46))
    upper = np.triu(rng.uniform(size=(size, size)) < rng.uniform(0.05, 0.85), 1)
    weights = (rng.uniform(0.9, 1.1, size), rng.exponential(1.0, size) + 1e-3, rng.integers(1, 5, size))[
        seed % 3
    ]
    return upper | upper.T, np.asarray(weights, np.float64)


def heaviest(adjacency, weights):
    """By networkx: all maximal cliques."""
    return max(weights[clique].sum() for clique in nx.find_cliques(nx.from_numpy_array(adjacency)))


@pytest.mark.parametrize("seed", range(200))
def test_weight_equals_networkx(seed):
    adjacency, weights = random_graph(seed)
    found = maximum_weight_clique(adjacency, weights)
    assert found.completed
    assert is_clique(adjacency, found.members)
    assert found.weight == pytest.approx(weights[found.members].sum(), rel=1e-12)
    assert found.weight == pytest.approx(heaviest(adjacency, weights), rel=1e-9)


def test_equal_weights_give_the_size_of_the_maximum_clique():
    adjacency, _ = random_graph(41)
    largest = max(map(len, nx.find_cliques(nx.from_numpy_array(adjacency))))
    assert len(maximum_weight_clique(adjacency, np.full(len(adjacency), 2.5)).members) == largest


def test_one_heavy_node_beats_a_large_clique():
    adjacency = np.zeros((6, 6), bool)
    adjacency[:4, :4] = True
    adjacency[4, 5] = adjacency[5, 4] = True
    found = maximum_weight_clique(adjacency, np.asarray([1.0, 1.0, 1.0, 1.0, 5.0, 0.5]))
    assert found.members.tolist() == [4, 5]
    assert found.weight == 5.5


def test_planted_clique_among_thousands_of_nodes():
    rng = np.random.default_rng(3)
    upper = np.triu(rng.uniform(size=(2000, 2000)) < 0.02, 1)
    adjacency, weights = upper | upper.T, rng.uniform(0.5, 1.0, 2000)
    planted = np.sort(rng.choice(2000, 12, replace=False))
    adjacency[np.ix_(planted, planted)] = True
    assert maximum_weight_clique(adjacency, weights).members.tolist() == planted.tolist()


def test_no_nodes_and_no_edges():
    assert maximum_weight_clique(np.zeros((0, 0), bool), np.zeros(0)).members.tolist() == []
    alone = maximum_weight_clique(np.zeros((3, 3), bool), np.asarray([1.0, 3.0, 2.0]))
    assert alone.members.tolist() == [1]
    assert alone.weight == 3.0


@pytest.mark.parametrize(("limits", "name"), [({"max_nodes": 20}, "nodes"), ({"max_seconds": 1e-6}, "time")])
def test_budget_is_reported_and_leaves_a_clique(limits, name):
    rng = np.random.default_rng(4)
    upper = np.triu(rng.uniform(size=(150, 150)) < 0.7, 1)
    found = maximum_weight_clique(upper | upper.T, rng.uniform(0.9, 1.1, 150), **limits)
    assert not found.completed
    assert found.stopped_by == name
    assert is_clique(upper | upper.T, found.members)


@pytest.mark.parametrize("weights", [[1.0, 2.0], [1.0, 0.0, 1.0], [1.0, np.nan, 1.0]])
def test_weights_that_are_missing_or_not_positive_are_refused(weights):
    with pytest.raises(InputError, match="weights"):
        maximum_weight_clique(np.ones((3, 3), bool), np.asarray(weights))
