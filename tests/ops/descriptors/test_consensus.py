import networkx as nx
import numpy as np
import pytest

from oracles.descriptors import agree
from oracles.motions import pose_of, random_rotation
from voxjax.ops.descriptors.consensus import (
    agreement_matrix,
    greedy_cliques,
    matches_under_poses,
    poses_from_matches,
)


def unit(v):
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def random_matches(seed=0, n=40, num_right=25, noise=0.01):
    """Points and normals of matches of which the first `num_right` follow a random pose; and the pose."""
    rng = np.random.default_rng(seed)
    R, t = random_rotation(rng), rng.normal(size=3)
    points_b, normals_b = rng.uniform(-4, 4, (n, 3)), unit(rng.normal(size=(n, 3)))
    points_a, normals_a = points_b @ R.T + t + noise * rng.normal(size=(n, 3)), normals_b @ R.T
    points_a[num_right:] = rng.uniform(-4, 4, (n - num_right, 3))
    normals_a[num_right:] = unit(rng.normal(size=(n - num_right, 3)))
    return [x.astype(np.float32) for x in (points_a, normals_a, points_b, normals_b)], pose_of(R, t)


def agreement_of(matches, tolerance=0.2, mask=None, **options):
    n = len(matches[0])
    mask = np.ones(n, bool) if mask is None else mask
    return np.asarray(
        agreement_matrix(
            *matches,
            mask,
            distance_tolerance=np.full(n, tolerance, np.float32),
            cosine_tolerance=0.3,
            **options,
        )
    )


def test_agreement_equals_the_definition():
    matches, _ = random_matches(n=30, num_right=12)
    rows = list(zip(*(x.astype(float) for x in matches), strict=True))
    expected = [[i != j and agree(rows[i], rows[j], 0.2, 0.3) for j in range(30)] for i in range(30)]
    np.testing.assert_array_equal(agreement_of(matches, chunk=8), expected)


def test_agreement_is_symmetric_and_leaves_out_masked_matches():
    matches, _ = random_matches(1)
    mask = np.arange(40) % 3 != 0
    agreement = agreement_of(matches, mask=mask)
    np.testing.assert_array_equal(agreement, agreement.T)
    assert not agreement[~mask].any()
    assert not agreement.diagonal().any()
    assert agreement[mask].any()


def test_right_matches_agree_with_each_other():
    matches, _ = random_matches(2)
    agreement = agreement_of(matches)[:25, :25]
    lengths = np.linalg.norm(matches[2][:25, None] - matches[2][None, :25], axis=-1)
    assert agreement[lengths > 0.5].all()


@pytest.mark.parametrize("seed", range(5))
def test_grown_cliques_are_cliques_that_hold_their_seed(seed):
    upper = np.triu(np.random.default_rng(seed).uniform(size=(24, 24)) < 0.4, 1)
    graph = upper | upper.T
    members, sizes = map(np.asarray, greedy_cliques(graph))
    np.testing.assert_array_equal(sizes, members.sum(axis=1))
    for node in range(24):
        rows = np.flatnonzero(members[node])
        assert node in rows
        assert graph[np.ix_(rows, rows)].sum() == len(rows) * (len(rows) - 1)
        assert not graph[rows].all(axis=0).any()  # maximal: nothing could be added


def test_a_planted_clique_is_found_in_full():
    rng = np.random.default_rng(0)
    upper = np.triu(rng.uniform(size=(60, 60)) < 0.1, 1)
    planted = np.sort(rng.choice(60, 12, replace=False))
    graph = upper | upper.T
    graph[np.ix_(planted, planted)] = ~np.eye(12, dtype=bool)
    sizes = np.asarray(greedy_cliques(graph)[1])
    assert sizes.max() == max(map(len, nx.find_cliques(nx.from_numpy_array(graph)))) >= 12


def test_growth_stops_at_the_given_size():
    graph = ~np.eye(10, dtype=bool)
    assert np.asarray(greedy_cliques(graph, max_size=3)[1]).tolist() == [3] * 10


def test_poses_of_right_matches_are_the_pose():
    matches, T = random_matches(3)
    weights = np.zeros((2, 40), np.float32)
    weights[0, :25], weights[1, :5] = 1.0, [1.0, 2.0, 1.0, 0.5, 1.0]
    poses = np.asarray(poses_from_matches(*matches, weights, normal_weight=0.1))
    np.testing.assert_allclose(poses, np.stack([T, T]), atol=0.05)


def test_normals_fix_the_turn_about_a_line():
    matches, T = random_matches(4, noise=0.0)
    direction = unit(np.array([[1.0, 2.0, -1.0]]))
    matches[2][:] = np.linspace(-3, 3, 40)[:, None] * direction
    matches[0][:] = matches[2] @ T[:3, :3].T + T[:3, 3]
    weights = np.concatenate([np.ones(25), np.zeros(15)])[None].astype(np.float32)
    poses = np.asarray(poses_from_matches(*matches, weights, normal_weight=0.1))
    np.testing.assert_allclose(poses[0], T, atol=1e-3)


def test_a_pose_explains_its_own_matches_and_no_others():
    matches, T = random_matches(5)
    poses = np.stack([T, np.eye(4)]).astype(np.float32)
    tolerance = np.full(40, 0.2, np.float32)
    mask = np.arange(40) != 4
    explained = np.asarray(
        matches_under_poses(poses, *matches, mask, distance_tolerance=tolerance, min_cosine=0.9)
    )
    np.testing.assert_array_equal(explained[0], (np.arange(40) < 25) & mask)
    assert not explained[1, :25].all()
