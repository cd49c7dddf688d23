"""Other systems on the same maps, those that are installed."""

import numpy as np
import pytest
from bench.peers import PEERS, Peer, load_peers, run_peer, working_voxel

from voxjax import InputError


@pytest.mark.parametrize(
    ("voxel_size", "is_real", "expected"),
    [(0.05, False, 0.3), (0.1, True, 0.25), (0.25, True, 0.3), (0.5, True, 0.5)],
)
def test_working_voxel_of_peers(voxel_size, is_real, expected):
    assert working_voxel(voxel_size, is_real=is_real) == pytest.approx(expected)


def test_a_module_without_a_distribution_is_said_to_be_built():
    peer = Peer("other", ("numpy", "no_such_module"), "", lambda a, b, working: pytest.fail("is not run"))
    assert peer.versions() == {"numpy": np.__version__, "no_such_module": "built from source"}


@pytest.mark.parametrize("name", [peer.name for peer in PEERS])
def test_peers_find_a_turned_cloud(name):
    peer = _loaded(name)
    points_b = _boxes(np.random.default_rng(0))
    T_a_b = np.eye(4)
    T_a_b[:2, :2], T_a_b[:3, 3] = [[0.8, -0.6], [0.6, 0.8]], [3.0, -2.0, 0.5]
    answer = run_peer(
        peer, points_b @ T_a_b[:3, :3].T + T_a_b[:3, 3], points_b, voxel_size=0.1, is_real=False
    )
    np.testing.assert_allclose(answer.T_a_b, T_a_b, atol=0.05)


def test_teaser_says_nothing_of_fewer_than_three_matches():
    points = np.array([[0.0, 0.0, 0.0], [5.0, 0.0, 0.0]])
    coarse = _loaded("teaser").solve(points, points, 0.3)
    np.testing.assert_array_equal(coarse.T_a_b, np.eye(4))
    assert coarse.score == 0


def _loaded(name):
    try:
        (peer,) = load_peers([name])
    except InputError as error:
        pytest.skip(str(error))
    return peer


def _boxes(rng):
    """Points on the faces of boxes of random sizes."""
    points = []
    for _ in range(12):
        inside = rng.uniform(0, 1, (1500, 3))
        rows, sides = np.arange(len(inside)), rng.integers(0, 3, len(inside))
        inside[rows, sides] = np.round(inside[rows, sides])
        points.append(rng.uniform(0, 10, 3) + rng.uniform(1, 4, 3) * inside)
    return np.concatenate(points)
