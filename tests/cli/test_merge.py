"""`voxjax merge` from the outside: exit codes, messages, files."""

import json
from contextlib import redirect_stdout
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from command_line import WORLD, fake_register, files, one_line
from fake_register import FakeRegister, cube_map, pose
from file_limits import largest_file
from voxjax import VoxelGrid, read_map, write_map
from voxjax._runtime.whole_files import write_files
from voxjax.cli.main import main
from voxjax.frames import from_local
from voxjax.view import page


def test_merge_writes_all_outputs_and_exits_with_0(monkeypatch, maps, capsys):
    fake = fake_register(monkeypatch)
    outputs = ["-o", "out.bt", "--report", "r.json", "--picture", "p.png"]
    assert main(["merge", *maps, *outputs, "--gravity-aligned", "--preset", "paper"]) == 0
    assert all(call["gravity_aligned"] and call["preset"] == "paper" for call in fake.calls)
    report = json.loads(Path("r.json").read_text())
    assert report["status"] == "merged"
    assert [entry["path"] for entry in report["maps"]] == maps
    np.testing.assert_allclose(
        report["maps"][2]["T_world_map"], np.linalg.inv(WORLD[0]) @ WORLD[2], atol=1e-5
    )
    assert Path("p.png").read_bytes().startswith(b"\x89PNG")
    assert read_map("out.bt").num_occupied > cube_map(0).num_occupied
    assert report["voxel_size"] == read_map("out.bt").voxel_size
    assert files() == [*maps, "out.bt", "p.png", "r.json"]
    shown = capsys.readouterr()
    assert "maps 0 and 1: hypotheses" in shown.err
    assert "m1.npz: x 1.000, y -2.000, z 0.000 m" in shown.out


def test_a_file_that_does_not_reach_so_far_is_refused_before_the_work(monkeypatch, tmp_path, capsys):
    monkeypatch.chdir(tmp_path)
    fake = fake_register(monkeypatch)
    for number in range(2):
        grid = cube_map(number)
        far = VoxelGrid(grid.states, np.asarray(grid.origin) + [4e5, 5e6, 0.0], grid.voxel_size)
        write_map(f"m{number}.npz", far)
    for ending in ("bt", "ot"):
        assert main(["merge", "m0.npz", "m1.npz", "-o", f"out.{ending}", "-q"]) == 2
        shown = capsys.readouterr().err
        assert (
            f"out.{ending} cannot be written: OctoMap files reach 32768 voxels from the frame's origin"
            in shown
        )
    assert fake.calls == []
    assert files() == ["m0.npz", "m1.npz"]


def test_poses_of_far_maps_are_told_by_the_way_of_their_middle(monkeypatch, folder, capsys):
    shift = np.array([4e5, 5e6, 0.0])
    far = [cube_map(n).placed(shift=shift) for n in range(2)]
    for number, grid in enumerate(far):
        write_map(f"m{number}.npz", grid)
    # A turn of 30 degrees about the middle of the second map, (1.5, 1.5, 1.5) m from its corner.
    T = from_local(pose(np.pi / 6, (0.25, 0.0, 0.0)), shift + 1.5, shift + 1.5)
    FakeRegister(far, [np.eye(4), T]).install(monkeypatch)
    assert main(["merge", "m0.npz", "m1.npz", "-o", "out.npz", "-q"]) == 0
    line = next(line for line in capsys.readouterr().out.splitlines() if line.startswith("m1.npz: "))
    # The stand-in keeps poses in float32, which is half a metre off at these coordinates.
    assert line.startswith("m1.npz: its middle (400001.5, 5000001.5, 1.5) moves by x ")
    assert line.endswith("; roll 0.00, pitch 0.00, yaw 30.00 deg")
    assert len(line) < 130


def test_stores_are_merged_into_a_store_that_appears_with_the_other_files(monkeypatch, maps, capsys):
    fake_register(monkeypatch)
    for name in maps:
        assert main(["convert", name, name.replace(".npz", ".zarr")]) == 0
    stores = [name.replace(".npz", ".zarr") for name in maps]
    assert main(["merge", *maps, "-o", "out.npz", "-q"]) == 0
    assert main(["merge", *stores, "-o", "out.zarr", "--report", "r.json", "-q"]) == 0
    assert read_map("out.zarr") == read_map("out.npz")
    kept = sorted(path.name for path in Path().iterdir())
    assert kept == sorted([*maps, *stores, "out.npz", "out.zarr", "r.json"])
    assert f"out.zarr: {read_map('out.npz')!r}" in capsys.readouterr().out
    assert (
        main(["merge", *stores, "-o", "out.zarr", "--memory", "4G", "--picture", "p.png", "-q", "--force"])
        == 0
    )
    assert read_map("out.zarr") == read_map("out.npz")
    assert main(["merge", *stores, "-o", "m.npz", "--processes", "2", "-q"]) == 2
    assert "--processes is for a fused map in a store (.zarr), got m.npz" in capsys.readouterr().err
    # Before any pair is registered.
    fake = fake_register(monkeypatch)
    assert main(["merge", *stores, "-o", "many.zarr", "--processes", "100000", "-q"]) == 2
    assert "a fused map written by 100000 processes needs about" in capsys.readouterr().err
    assert fake.calls == []
    assert main(["merge", *stores, "-o", "small.zarr", "--memory", "50M", "-q"]) == 2
    refusal = capsys.readouterr().err
    assert "GB of memory and 0.05 GB are available" in refusal
    assert refusal.endswith("; --memory grants that much, give it more if the machine has more.\n")
    Path("work.zarr").mkdir()
    assert main(["merge", *stores, "-o", "work.zarr", "-q", "--force"]) == 2
    assert "work.zarr is a folder without a file zarr.json" in capsys.readouterr().err


def test_a_store_that_is_not_to_be_written_leaves_nothing(monkeypatch, maps, capsys):
    fake_register(monkeypatch, verdicts={(0, 2): "no_overlap", (1, 2): "no_overlap"})
    assert main(["merge", *maps, "-o", "out.zarr", "-q"]) == 3
    assert sorted(path.name for path in Path().iterdir()) == sorted(maps)
    assert main(["merge", *maps, "-o", "out.zarr", "-q", "--allow-partial"]) == 0
    assert sorted(path.name for path in Path().iterdir()) == sorted([*maps, "out.zarr"])


@pytest.mark.skipif(find_spec("viser") is None, reason="needs the extra voxjax[view]")
def test_the_page_is_written_with_the_map(monkeypatch, maps):
    fake_register(monkeypatch)
    assert main(["merge", *maps, "-o", "out.bt", "--html", "v.html", "-q"]) == 0
    assert "<html" in Path("v.html").read_text(encoding="utf-8")


def test_a_page_without_its_extra_is_refused_at_once(monkeypatch, maps, capsys):
    fake = fake_register(monkeypatch)
    monkeypatch.setattr(page, "find_spec", lambda name: None)
    assert main(["merge", *maps, "-o", "out.bt", "--html", "v.html", "-q"]) == 2
    assert "voxjax[view]" in one_line(capsys)
    assert fake.calls == []


def test_quiet_shows_no_progress(monkeypatch, maps, capsys):
    fake_register(monkeypatch)
    assert main(["merge", *maps, "-o", "out.npz", "-q"]) == 0
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("verdict", ["ambiguous", "no_overlap"])
def test_without_trust_there_is_a_report_but_no_map_and_the_code_is_3(monkeypatch, maps, capsys, verdict):
    fake_register(monkeypatch, verdicts={(0, 1): verdict})
    code = main(["merge", *maps[:2], "-o", "out.bt", "--picture", "p.png", "--report", "r.json", "-q"])
    assert code == 3
    assert files() == [*maps, "r.json"]
    pair = json.loads(Path("r.json").read_text())["pairs"][0]
    assert not pair["accepted"]
    assert verdict in pair["reason"]
    np.testing.assert_allclose(pair["hypotheses"][0]["T_a_b"], np.linalg.inv(WORLD[0]) @ WORLD[1], atol=1e-5)
    assert verdict in one_line(capsys)


@pytest.mark.parametrize("report", [[], ["--report", "r.json"]])
def test_a_refusal_says_each_thing_once_and_where_the_best_pose_is(monkeypatch, maps, capsys, report):
    fake_register(monkeypatch, verdicts={(0, 1): "ambiguous"})
    assert main(["merge", *maps[:2], "-o", "out.bt", *report, "-q"]) == 3
    shown = capsys.readouterr()
    assert shown.out.splitlines() == [
        "m0.npz: not placed (ambiguous)",
        "m1.npz: not placed (ambiguous)",
        "m0.npz and m1.npz: ambiguous, confidence 0.90. The verdict is ambiguous.",
    ]
    hint = (
        "the best pose of each pair is in the report, pairs[].T_a_b"
        if report
        else "give --report R.json to see the best pose of each pair"
    )
    assert shown.err == f"voxjax: no map written: m0.npz and m1.npz: ambiguous; {hint}.\n"


def test_two_groups_of_maps_say_which_fit_whom(monkeypatch, maps, capsys):
    fake_register(monkeypatch, verdicts={(0, 2): "no_overlap", (1, 2): "ambiguous"})
    assert main(["merge", *maps, "-o", "out.bt", "-q"]) == 3
    shown = capsys.readouterr()
    assert "m2.npz: not placed (ambiguous)" in shown.out
    assert "2 of 3 maps fit together, left out: m2.npz; use --allow-partial" in shown.err


def test_a_disagreement_of_a_loop_names_its_maps(monkeypatch, maps, capsys):
    fake_register(monkeypatch)
    assert main(["merge", *maps, "-o", "out.bt", "-q"]) == 0
    assert "loop check: m1.npz and m2.npz: 0.00 m and 0.00 deg off" in capsys.readouterr().out


def test_a_stranger_needs_allow_partial(monkeypatch, maps, capsys):
    fake_register(monkeypatch, verdicts={(0, 1): "no_overlap", (1, 2): "no_overlap"})
    assert main(["merge", *maps, "-o", "out.bt", "-q"]) == 3
    assert not Path("out.bt").exists()
    assert "--allow-partial" in one_line(capsys)
    assert main(["merge", *maps, "-o", "out.bt", "--report", "r.json", "--allow-partial", "-q"]) == 0
    assert read_map("out.bt").num_occupied > 0
    report = json.loads(Path("r.json").read_text())
    assert report["status"] == "partial"
    assert [entry["T_world_map"] is None for entry in report["maps"]] == [False, True, False]


def test_a_map_beyond_the_limit_of_file_sizes_leaves_no_files(monkeypatch, maps, capsys):
    from voxjax.cli import merge as command

    def write_under_a_limit(contents, *, force):
        with largest_file(len(contents["m.npz"]) - 300):
            write_files(contents, force=force)

    fake_register(monkeypatch)
    monkeypatch.setattr(command, "write_files", write_under_a_limit)
    Path("report").mkdir()
    assert main(["merge", *maps, "-o", "m.npz", "--report", "report/m.json", "-q"]) == 2
    assert files() == [*maps, "report"]
    assert not list(Path("report").iterdir())
    assert "m.npz cannot be written: File too large" in one_line(capsys)


@pytest.mark.parametrize("as_file", [False, True])
def test_an_initial_guess_reaches_the_registration(monkeypatch, maps, as_file):
    fake = fake_register(monkeypatch)
    text = "1 2 3 0 0 0.7071068 0.7071068"
    if as_file:
        Path("guess.txt").write_text(f"# time x y z qx qy qz qw\n17.5 {text}\n")
    assert main(["merge", *maps[:2], "-o", "o.bt", "--init-guess", "guess.txt" if as_file else text]) == 0
    np.testing.assert_allclose(fake.calls[0]["init_guess"], pose(np.pi / 2, (1, 2, 3)), atol=1e-6)


def test_settings_reach_the_registration(monkeypatch, maps):
    fake = fake_register(monkeypatch)
    Path("s.toml").write_text("[source]\ndescriptors = false\n")
    assert main(["merge", *maps[:2], "-o", "o.bt", "--config", "s.toml", "-q"]) == 0
    assert fake.calls[0]["config"].source.descriptors is False
    assert fake.calls[0]["config"].source.corners is True


@pytest.mark.parametrize(("verdict", "code"), [("accepted", 0), ("no_overlap", 3)])
def test_a_merge_keeps_its_exit_code_when_nobody_reads_its_output(
    monkeypatch, maps, pipe_without_reader, verdict, code
):
    fake_register(monkeypatch, verdicts={(0, 1): verdict})
    with open(pipe_without_reader, "w", closefd=False) as nobody, redirect_stdout(nobody):
        assert main(["merge", *maps[:2], "-o", "out.bt", "--report", "r.json", "-q"]) == code
    assert Path("out.bt").exists() == (code == 0)
    assert Path("r.json").exists()
