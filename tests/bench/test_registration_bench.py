"""The command of the registration benchmark: refusals in one sentence, and resuming."""

import importlib
import json

import numpy as np
import pytest
from bench.cases import Case
from bench.peer_features import mutual_matches
from bench.peers import PEERS, Peer, load_peers, run_peer, working_voxel
from bench.worlds import MapPair

from bench import registration
from voxjax import InputError, VoxelGrid


def test_a_missing_peer_is_refused_with_the_way_to_install_it(monkeypatch, capsys):
    real = importlib.import_module

    def without_open3d(name, *rest):
        if name == "open3d":
            raise ImportError("No module named 'open3d'")
        return real(name, *rest)

    monkeypatch.setattr(importlib, "import_module", without_open3d)
    assert registration.main(["--peers", "open3d"]) == 2
    message = capsys.readouterr().err
    assert message.count("\n") == 1
    assert "pip install open3d-cpu" in message


@pytest.mark.parametrize(
    ("argv", "said"),
    [
        (["--peers", "nonsense"], "peer 'nonsense' is not known"),
        (["--presets", "fast"], "preset 'fast' is not known"),
        (["--maps", "no/such/folder"], "is no folder"),
        (["--only", "", "--generated", "0"], "no pair to run"),
    ],
)
def test_what_cannot_be_run_is_refused(argv, said, capsys):
    assert registration.main(argv) == 2
    assert said in capsys.readouterr().err


@pytest.mark.parametrize(
    ("voxel_size", "is_real", "expected"),
    [(0.05, False, 0.3), (0.1, True, 0.25), (0.25, True, 0.3), (0.5, True, 0.5)],
)
def test_working_voxel_of_peers(voxel_size, is_real, expected):
    assert working_voxel(voxel_size, is_real=is_real) == pytest.approx(expected)


def test_a_module_without_a_distribution_is_said_to_be_built():
    peer = Peer("other", ("numpy", "no_such_module"), "", lambda a, b, working: pytest.fail("is not run"))
    assert peer.versions() == {"numpy": np.__version__, "no_such_module": "built from source"}


def test_mutual_matches_are_the_nearest_ones_in_order():
    features_b = np.array([[0.0], [10.0], [20.0], [20.6]])
    features_a = np.array([[20.5], [12.0], [0.3], [90.0]])
    np.testing.assert_array_equal(mutual_matches(features_b, features_a, most=9), [[3, 0], [0, 2], [1, 1]])
    np.testing.assert_array_equal(mutual_matches(features_b, features_a, most=2), [[3, 0], [0, 2]])
    assert mutual_matches(np.empty((0, 1)), features_a, most=2).shape == (0, 2)


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


def test_resume_runs_only_what_is_missing(tmp_path, monkeypatch, capsys):
    grid = VoxelGrid(np.full((2, 2, 2), 2, np.uint8), np.zeros(3, np.float32), 0.1)
    calls = []

    def method(case, pair):
        calls.append(case.name)
        return {"seconds": 1.0, "verdict": "accepted", "accepted": True} | case.judge(
            [np.eye(4)], pair.T_a_b, np.zeros(3)
        )

    def case(name):
        return Case(name, "sim", "pair", "yaw", 3.0, 0.4, lambda: MapPair(grid, grid, np.eye(4), 1.0), {})

    names = ["sim/one"]
    monkeypatch.setattr(registration, "_voxjax", lambda preset: method)
    monkeypatch.setattr(registration, "_cases", lambda args: [case(name) for name in names])
    out = tmp_path / "rows.json"
    assert registration.main(["--out", str(out)]) == 0
    names.append("sim/two")
    assert registration.main(["--out", str(out), "--resume"]) == 0
    assert calls == ["sim/one", "sim/two"]
    assert [row["case"] for row in json.loads(out.read_text())["rows"]] == ["sim/one", "sim/two"]
    assert registration.main(["--out", str(out), "--resume", "--warm"]) == 2
    assert "leave out --resume" in capsys.readouterr().err
