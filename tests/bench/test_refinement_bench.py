"""The benchmark of refinement: starts exactly as far off as asked, basins, targets, refusals, the file of results."""

import importlib
import json

import numpy as np
import pytest
from bench.refinement_cases import RefinementCase, generated_cases, pose_off, starts_of
from bench.refinement_parts import Plan, accuracy_rows, basin_rows, has_converged
from bench.refinement_peers import Refiner, load_refiners
from bench.refinement_table import FILE, OURS, markdown, read, targets, width, write
from bench.worlds import MapPair

from bench import refinement
from oracles import motions
from voxjax import InputError, VoxelGrid
from voxjax.metrics import PoseError


def made_pair():
    rng = np.random.default_rng(3)
    grids = [
        VoxelGrid(rng.integers(0, 3, (6, 7, 8)).astype(np.uint8), np.full(3, shift, np.float32), 0.1)
        for shift in (0.0, 20.0)
    ]
    return MapPair(grids[0], grids[1], motions.random_pose(rng), 1.0)


def made_case(pair, name="drift-free/one", suite="drift-free"):
    return RefinementCase(name, suite, "yaw", lambda: pair)


def refiner(name, refine):
    return Refiner(name, None, lambda pair: lambda T: refine(pair, T), lambda pair: lambda T: refine(pair, T))


def accuracy_row(method, metres, degrees, suite="drift-free"):
    return {
        "suite": suite,
        "method": method,
        "num_pairs": 2,
        "num_poses": 4,
        "converged": 1.0,
        "metres": [metres, 2 * metres],
        "voxels": [10 * metres, 20 * metres],
        "degrees": [degrees, 2 * degrees],
        "seconds": [0.1, 0.2],
        "prepare_seconds": [0.2, 0.3],
    }


def basin_row(method, shares, line="both"):
    steps = np.linspace(0.0, 1.0, len(shares))
    return {
        "line": line,
        "method": method,
        "num_pairs": 2,
        "num_trials": [10] * len(shares),
        "metres": (2 * steps).tolist(),
        "degrees": (30 * steps).tolist(),
        "converged": shares,
    }


@pytest.mark.parametrize(("metres", "degrees"), [(0.3, 3.0), (0.0, 30.0), (2.0, 0.0), (0.0, 0.0)])
def test_a_start_is_off_by_exactly_what_is_asked(metres, degrees):
    pair = made_pair()
    centroid = pair.centroid_of_b
    for start in starts_of(made_case(pair), pair, 5, metres=metres, degrees=degrees, seed=1):
        found_degrees, found_metres = motions.pose_error(start, pair.T_a_b, centroid)
        assert found_metres == pytest.approx(metres, abs=1e-9)
        assert found_degrees == pytest.approx(degrees, abs=1e-6)
        np.testing.assert_allclose(start[:3, :3] @ start[:3, :3].T, np.eye(3), atol=1e-12)


def test_starts_repeat_and_differ_with_number_seed_and_case():
    pair = made_pair()

    def starts(name, seed):
        return np.stack(starts_of(made_case(pair, name), pair, 2, metres=0.3, degrees=3.0, seed=seed))

    found = starts("x", 1)
    np.testing.assert_array_equal(found, starts("x", 1))
    others = [found[0], found[1], starts("x", 2)[0], starts("y", 1)[0]]
    assert len({other.tobytes() for other in others}) == 4


def test_starts_of_other_sizes_point_the_same_way():
    pair = made_pair()
    centroid = pair.centroid_of_b
    assert pair.T_a_b is not None
    near, far = (
        pose_off(pair.T_a_b, centroid, metres=m, degrees=0.0, rng=np.random.default_rng(4))
        for m in (0.5, 2.0)
    )
    np.testing.assert_allclose(4 * (near - pair.T_a_b)[:3, 3], (far - pair.T_a_b)[:3, 3], atol=1e-9)


def test_suites_share_their_worlds_and_meet_every_frame_and_voxel_size():
    free, drifting = (generated_cases(suite, 9, 5) for suite in ("drift-free", "drifting"))
    assert [c.name.split("/")[1] for c in free] == [c.name.split("/")[1] for c in drifting]
    assert {(c.frame, c.name.split("_")[-1]) for c in free} == {
        (frame, size) for frame in ("yaw", "tilt", "so3") for size in ("0.1", "0.2")
    }


@pytest.mark.parametrize(
    ("metres", "degrees", "voxel_size", "expected"),
    [
        (0.149, 0.99, 0.1, True),
        (0.151, 0.0, 0.1, False),
        (0.19, 0.0, 0.2, True),
        (0.0, 1.01, 0.2, False),
    ],
)
def test_what_counts_as_converged(metres, degrees, voxel_size, expected):
    assert has_converged(PoseError(degrees, metres), voxel_size) == expected


def test_rows_tell_a_perfect_method_from_one_that_does_nothing():
    pair = made_pair()
    plan = Plan([made_case(pair)], [made_case(pair)], starts=2, levels=3, seed=1)
    methods = [refiner("perfect", lambda pair, T: pair.T_a_b), refiner("idle", lambda pair, T: T)]
    perfect, idle = accuracy_rows(plan, methods)
    assert (perfect["converged"], idle["converged"]) == (1.0, 0.0)
    assert perfect["metres"] == pytest.approx([0.0, 0.0], abs=1e-9)
    assert idle["metres"] == pytest.approx([0.3, 0.3])
    assert idle["voxels"] == pytest.approx([3.0, 3.0])
    assert idle["degrees"] == pytest.approx([3.0, 3.0])
    assert idle["num_poses"] == 2
    rows = {(row["line"], row["method"]): row for row in basin_rows(plan, methods)}
    assert rows["both", "perfect"]["converged"] == [1.0, 1.0, 1.0]
    assert rows["both", "idle"]["converged"] == [1.0, 0.0, 0.0]
    assert rows["both", "idle"]["num_trials"] == [1, 2, 2]
    assert rows["translation", "idle"]["degrees"] == [0.0, 0.0, 0.0]
    assert rows["rotation", "idle"]["degrees"] == [0.0, 15.0, 30.0]


@pytest.mark.parametrize(
    ("shares", "expected"),
    [([1.0, 0.9, 1.0], (2.0, 30.0)), ([1.0, 0.89, 1.0], (0.0, 0.0)), ([1.0, 1.0, 0.5], (1.0, 15.0))],
)
def test_a_basin_ends_where_too_few_converge(shares, expected):
    assert width(basin_row("x", shares)) == expected


def test_targets_are_judged_against_the_best_peer():
    rows = [accuracy_row(OURS, 0.02, 0.12), accuracy_row("p", 0.05, 0.13), accuracy_row("q", 0.01, 0.2)]
    rows += [accuracy_row("voxjax, one way", 0.001, 0.001)]
    basin = [basin_row(OURS, [1.0, 1.0, 0.5]), basin_row("p", [1.0, 1.0, 1.0])]
    results = {"accuracy": {"quick": False, "rows": rows}, "basin": {"quick": False, "rows": basin}}
    judged = {what: (text, is_met) for what, text, is_met in targets(results)}
    assert judged["drift-free: median <= 0.3 voxel"][1]
    assert not judged["drift-free: median <= 0.1 degrees"][1]
    assert judged["drift-free: median [m] no worse than any peer's"] == ("0.02, q 0.01", False)
    assert judged["drift-free: median [degrees] no worse than any peer's"] == ("0.12, p 0.13", True)
    assert judged["drift-free: 90th percentile [degrees] no worse than any peer's"] == ("0.24, p 0.26", True)
    assert judged["basin, both: as wide as any peer's"] == ("1 m, 15°, p 2 m, 30°", False)


def test_a_part_that_did_not_run_stays_in_the_file(tmp_path):
    path = tmp_path / "new" / FILE
    write(path, "accuracy", {"setting": {}, "quick": False, "rows": [accuracy_row(OURS, 0.0123456, 0.1)]})
    write(path, "basin", {"setting": {}, "quick": True, "rows": [basin_row(OURS, [1.0, 0.0])]})
    found = read(path)
    assert set(found) == {"accuracy", "basin"}
    assert found["accuracy"]["rows"][0]["metres"][0] == 0.01235
    text = markdown(found)
    assert "In the quick form, on few pairs: basin." in text
    widths = {line.count("|") for line in text.split("\n\n")[0].splitlines()}
    assert len(widths) == 1


@pytest.mark.parametrize(
    ("argv", "said"),
    [
        (["--peers", "nonsense"], "peer 'nonsense' is not known"),
        (["--only", "speed"], "part 'speed' is not known"),
        (["--maps", "no/such/folder"], "is no folder"),
        (["--table", "--results", "no/such/folder"], "there is no file"),
    ],
)
def test_what_cannot_be_run_is_refused(argv, said, capsys):
    assert refinement.main(argv) == 2
    message = capsys.readouterr().err
    assert said in message
    assert message.count("\n") == 1


def test_a_missing_peer_is_refused_with_the_way_to_install_it(monkeypatch):
    real = importlib.import_module

    def without_open3d(name, *rest):
        if name == "open3d":
            raise ImportError("No module named 'open3d'")
        return real(name, *rest)

    monkeypatch.setattr(importlib, "import_module", without_open3d)
    with pytest.raises(InputError, match="pip install open3d-cpu"):
        load_refiners(["open3d"])
    assert [r.module for r in load_refiners([])] == [None, None, None]


def test_the_command_writes_draws_and_prints_its_results(tmp_path, monkeypatch, capsys):
    pair = made_pair()
    plan = Plan([made_case(pair)], [made_case(pair)], starts=1, levels=2, seed=1)
    methods = [refiner(OURS, lambda pair, T: pair.T_a_b), refiner("peer", lambda pair, T: T)]
    monkeypatch.setattr(refinement, "_plan", lambda args: plan)
    monkeypatch.setattr(refinement, "load_refiners", lambda names: methods)
    folder = ["--results", str(tmp_path)]
    quick = ["--only", "accuracy,basin", "--plot", str(tmp_path / "img")]
    assert refinement.main([*folder, *quick]) == 0
    assert {p.name for p in (tmp_path / "img").iterdir()} == {
        "refinement_basin.png",
        "refinement_accuracy.png",
    }
    assert set(json.loads((tmp_path / FILE).read_text())) == {"accuracy", "basin"}
    capsys.readouterr()
    assert refinement.main([*folder, "--table"]) == 0
    printed = capsys.readouterr().out
    assert "| basin, both: as wide as any peer's | 2 m, 30°, peer 0 m, 0° | met |" in printed
