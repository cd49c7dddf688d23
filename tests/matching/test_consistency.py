import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from compilations import compilations
from corner_lists import corners_at
from oracles.matching import consistency, distance_gaps, rotation_angle
from oracles.motions import moved, random_pose
from voxjax import InputError, consistency_graph
from voxjax._runtime import memory
from voxjax.features.types import KIND_UNKNOWN
from voxjax.matching import consistency as matching_consistency
from voxjax.matching.associations import all_associations
from voxjax.matching.consistency import graph_memory, pairwise_consistency


def everything(n, m):
    return all_associations(np.ones(n, bool), np.ones(m, bool))


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    n=st.integers(1, 9),
    m=st.integers(1, 9),
    far=st.sampled_from([0.0, 200.0]),
)
def test_equals_equation_4_pair_by_pair(seed, n, m, far):
    rng = np.random.default_rng(seed)
    a, b = (rng.uniform(far, far + 4, (k, 3)).astype(np.float32) for k in (n, m))
    pairs = everything(n, m)
    tolerance = 0.3
    graph = consistency_graph(corners_at(a), corners_at(b), distance_tolerance=tolerance)
    size = graph.num_associations
    assert size == n * m
    np.testing.assert_array_equal(np.asarray(graph.associations)[:size], pairs)
    expected = consistency(a, b, pairs.tolist(), tolerance)
    # float32 may decide otherwise where the gap of lengths is the tolerance itself, to rounding.
    is_clear = np.abs(distance_gaps(a, b, pairs.tolist()) - tolerance) > 1e-5
    np.testing.assert_array_equal(np.asarray(graph.adjacency)[:size, :size][is_clear], expected[is_clear])


def test_padding_has_no_edges_and_comes_last():
    graph = consistency_graph(corners_at(np.eye(3)), corners_at(np.eye(3)), distance_tolerance=0.1)
    mask = np.asarray(graph.mask)
    assert mask[:9].all()
    assert not mask[9:].any()
    assert not np.asarray(graph.adjacency)[9:].any()
    assert not np.asarray(graph.adjacency)[:, 9:].any()
    assert (np.asarray(graph.associations)[9:] == -1).all()


def test_masked_corners_are_not_associated():
    mask = np.array([True, False, True])
    graph = consistency_graph(corners_at(np.eye(3), mask=mask), corners_at(np.eye(3)), distance_tolerance=0.1)
    assert graph.num_associations == 6
    assert 1 not in np.asarray(graph.associations)[:6, 0]


def test_graph_is_symmetric_and_a_rigid_motion_keeps_it():
    rng = np.random.default_rng(4)
    a, b = rng.uniform(0, 5, (2, 12, 3))
    graph = consistency_graph(corners_at(a), corners_at(b), distance_tolerance=0.2)
    again = consistency_graph(corners_at(moved(random_pose(rng), a)), corners_at(b), distance_tolerance=0.2)
    np.testing.assert_array_equal(graph.adjacency, np.asarray(graph.adjacency).T)
    is_clear = np.abs(distance_gaps(a, b, everything(12, 12).tolist()) - 0.2) > 1e-4
    same = np.asarray(graph.adjacency)[:144, :144] == np.asarray(again.adjacency)[:144, :144]
    assert same[is_clear].all()


def test_true_associations_are_a_clique_under_any_motion():
    rng = np.random.default_rng(5)
    a = rng.uniform(0, 5, (15, 3))
    b = moved(np.linalg.inv(random_pose(rng)), a)
    pairs = np.stack([np.arange(15)] * 2, axis=1)
    adjacency = pairwise_consistency(a, b, pairs, distance_tolerance=1e-3)[:15, :15]
    np.testing.assert_array_equal(adjacency, ~np.eye(15, dtype=bool))


def test_near_corners_do_not_count_below_the_minimum_distance():
    a = np.array([[0, 0, 0], [0.05, 0, 0], [3, 0, 0]])
    pairs = np.stack([np.arange(3)] * 2, axis=1)
    adjacency = pairwise_consistency(a, a, pairs, distance_tolerance=0.1, min_distance=0.5)
    assert not adjacency[0, 1]
    assert adjacency[0, 2]


def test_frames_turned_alike_agree_in_any_cyclic_order_and_others_do_not():
    rng = np.random.default_rng(6)
    points = rng.uniform(0, 5, (6, 3))
    frames = np.stack([random_pose(rng)[:3, :3] for _ in range(6)])
    T = random_pose(rng)
    # Rows of a frame are directions: they turn with the map; each corner lists them from another start.
    frames_a = np.stack([np.roll(f @ T[:3, :3].T, k % 3, axis=0) for k, f in enumerate(frames)])
    tilted = frames_a.copy()
    tilted[2] = tilted[2] @ Rotation.from_euler("x", 20, degrees=True).as_matrix()
    pairs = np.stack([np.arange(6)] * 2, axis=1)
    for given_a, expected in ((frames_a, True), (tilted, False)):
        graph = consistency_graph(
            corners_at(moved(T, points), given_a),
            corners_at(points, frames),
            associations=pairs,
            distance_tolerance=0.01,
            angle_tolerance=np.radians(8),
        )
        assert bool(np.asarray(graph.adjacency)[2, [0, 1, 3, 4, 5]].all()) == expected
        assert np.asarray(graph.adjacency)[0, [1, 3, 4, 5]].all()


def test_frames_decide_at_the_angle_between_the_rotations():
    """Two associations with the same corner distance; the second rotation differs by a known angle."""
    points = np.array([[0.0, 0, 0], [1, 0, 0]])
    frames_b = np.tile(np.eye(3), (2, 1, 1))
    for degrees in (0.5, 4.0, 6.0, 30.0):
        turn = Rotation.from_rotvec(np.radians(degrees) * np.array([0.6, 0, 0.8])).as_matrix()
        assert np.isclose(np.degrees(rotation_angle(turn)), degrees)
        frames_a = np.stack([np.eye(3), np.eye(3) @ turn])
        adjacency = pairwise_consistency(
            points,
            points,
            np.array([[0, 0], [1, 1]]),
            distance_tolerance=0.1,
            angle_tolerance=np.radians(5),
            frames_a=frames_a,
            frames_b=frames_b,
        )
        assert bool(adjacency[0, 1]) == (degrees < 5)


def test_kinds_filter_candidates_but_unknown_kinds_match_all():
    kinds_a, kinds_b = np.array([0, 1, KIND_UNKNOWN], np.uint8), np.array([1, 0], np.uint8)
    graph = consistency_graph(
        corners_at(np.eye(3), convexity=kinds_a),
        corners_at(np.eye(3)[:2], convexity=kinds_b),
        distance_tolerance=0.1,
        match_kinds=True,
    )
    assert graph.num_associations == 4


def test_no_corner_gives_an_empty_graph():
    graph = consistency_graph(corners_at(np.zeros((0, 3))), corners_at(np.eye(3)), distance_tolerance=0.1)
    assert graph.num_associations == 0
    assert not np.asarray(graph.adjacency).any()


def test_sizes_on_one_rung_compile_once():
    rng = np.random.default_rng(8)
    with compilations() as found:
        for n in (9, 10, 11):
            a = rng.uniform(0, 4, (n, 3))
            pairwise_consistency(a, a, everything(n, n)[:90], distance_tolerance=0.1)
    assert found["distance_consistency"] <= 1


def allow(monkeypatch, num_bytes):
    monkeypatch.setattr(memory, "memory_limit", lambda **_: num_bytes)


@pytest.mark.parametrize("angle_tolerance", [None, 0.1])
def test_a_graph_that_memory_will_not_hold_is_refused_before_it_is_made(monkeypatch, angle_tolerance):
    def never(*_: object):
        raise AssertionError("the graph was made")

    corners = corners_at(np.zeros((129, 3)))
    options = {"associations": everything(129, 129), "angle_tolerance": angle_tolerance}
    # 16,641 associations, padded to 32,768 and not to 65,536.
    need = graph_memory(129**2, has_angles=angle_tolerance is not None)
    assert need == 2.0**30 * (1 if angle_tolerance is None else 4)
    allow(monkeypatch, 0.99 * need)
    monkeypatch.setattr(matching_consistency, "distance_consistency", never)
    with pytest.raises(InputError, match=r"a consistency graph of 16641 associations needs about .* fewer"):
        consistency_graph(corners, corners, distance_tolerance=0.1, **options)
    allow(monkeypatch, 1.01 * need)
    with pytest.raises(AssertionError, match="the graph was made"):
        consistency_graph(corners, corners, distance_tolerance=0.1, **options)


def test_edges_that_memory_will_not_hold_are_refused_before_they_are_listed(monkeypatch):
    points = corners_at(np.random.default_rng(10).uniform(0, 0.01, (32, 3)))
    allow(monkeypatch, 1.01 * graph_memory(32**2, has_angles=True))
    graph = consistency_graph(points, points, distance_tolerance=0.1)
    num_edges = int(np.count_nonzero(graph.adjacency)) // 2
    # Everything agrees but what shares a corner; what an edge takes is more than this graph's mask.
    assert num_edges == (32 * 31) ** 2 // 2
    allow(monkeypatch, 31.0 * num_edges)
    with pytest.raises(InputError, match=f"a consistency graph of {num_edges} edges needs about"):
        consistency_graph(points, points, distance_tolerance=0.1, angle_tolerance=0.1)


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"distance_tolerance": 0.0}, "distance_tolerance"),
        ({"distance_tolerance": float("nan")}, "distance_tolerance"),
        ({"angle_tolerance": -1.0}, "angle_tolerance"),
        ({"associations": np.array([[0, 3]])}, "associations"),
        ({"associations": np.zeros((40000, 2), int)}, "at most"),
    ],
)
def test_bad_input_is_one_sentence(changes, word):
    with pytest.raises(InputError, match=word):
        consistency_graph(
            corners_at(np.eye(3)), corners_at(np.eye(3)), **({"distance_tolerance": 0.1} | changes)
        )
