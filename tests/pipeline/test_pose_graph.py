"""The best tree over accepted pairs, the poses along it, and how far the other pairs disagree."""

import itertools

import networkx as nx
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fake_register import assert_is, cube_map, pose, registration, relative
from voxjax.pipeline.pose_graph import chain_poses, loop_errors, spanning_tree


def test_of_equal_parts_the_one_with_the_lowest_map_is_merged():
    pairs = [(2, 3, registration(np.eye(4), confidence=0.99)), (0, 1, registration(np.eye(4)))]
    assert [edge[:2] for edge in spanning_tree(4, pairs)] == [(0, 1)]


def test_the_tree_avoids_the_weak_pair_and_reports_how_far_it_is_off():
    wrong = relative(0, 1) @ pose(0.0, (3.0, 0.0, 0.0))
    pairs = [
        (0, 1, registration(wrong, confidence=0.6)),
        (0, 2, registration(relative(0, 2), confidence=0.9)),
        (1, 2, registration(relative(1, 2), confidence=0.8)),
    ]
    tree = spanning_tree(3, pairs)
    poses = chain_poses(3, tree)
    assert_is(poses[1], relative(0, 1))
    (loop,) = loop_errors([cube_map(n) for n in range(3)], poses, pairs, tree)
    assert (loop.a, loop.b) == (0, 1)
    assert loop.metres == pytest.approx(3.0, abs=1e-4)
    assert loop.radians == pytest.approx(0.0, abs=1e-3)


@given(data=st.data(), num_maps=st.integers(2, 7))
@settings(max_examples=60, deadline=None)
def test_the_tree_is_the_maximum_spanning_tree_of_its_part(data, num_maps):
    edges = data.draw(
        st.lists(st.sampled_from(list(itertools.combinations(range(num_maps), 2))), unique=True)
    )
    confidences = data.draw(st.permutations([(n + 1) / 64 for n in range(len(edges))]))
    weighted = [(a, b, c) for (a, b), c in zip(edges, confidences, strict=True)]
    pairs = [(a, b, registration(np.eye(4), confidence=c)) for a, b, c in weighted]
    tree = spanning_tree(num_maps, pairs)
    shuffled = spanning_tree(num_maps, data.draw(st.permutations(pairs)))
    assert sorted(e[:2] for e in tree) == sorted(e[:2] for e in shuffled)
    graph = nx.Graph()
    graph.add_nodes_from(range(num_maps))
    graph.add_weighted_edges_from(weighted)
    part = max(nx.connected_components(graph), key=lambda nodes: (len(nodes), -min(nodes)))
    expected = nx.maximum_spanning_tree(graph.subgraph(part))
    assert {e[:2] for e in tree} == {tuple(sorted(e)) for e in expected.edges}


def test_ties_of_confidence_are_settled_by_evidence():
    pairs = [
        (0, 1, registration(np.eye(4), score=0.2)),
        (0, 2, registration(np.eye(4), score=0.4)),
        (1, 2, registration(np.eye(4), score=0.3)),
    ]
    assert [edge[:2] for edge in spanning_tree(3, pairs)] == [(0, 2), (1, 2)]


def test_poses_are_chained_against_the_order_of_pairs_too():
    tree = [(a, b, registration(relative(a, b))) for a, b in ((1, 4), (2, 3), (1, 3), (0, 4))]
    poses = chain_poses(5, tree)
    for number, found in enumerate(poses):
        assert_is(found, relative(0, number))


def test_nothing_accepted_gives_no_tree_and_no_poses():
    refused = [(0, 1, registration(np.eye(4), verdict="ambiguous"))]
    assert spanning_tree(3, refused) == []
    assert chain_poses(3, []) == [None, None, None]
