"""The command line from the outside: exit codes, messages, files."""

import json
import os
import resource
import subprocess
import sys
from contextlib import redirect_stdout
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from fake_register import FakeRegister, cube_map, pose
from voxjax import VoxelGrid, read_map, write_map
from voxjax._runtime.whole_files import write_files
from voxjax.cli.main import main
from voxjax.view import page

WORLD = [pose(0.4 * n, (n, -2.0 * n, 0.0)) for n in range(3)]


@pytest.fixture(autouse=True)
def _in_an_empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("VOXJAX_CACHE", "off")


@pytest.fixture
def maps():
    """Three map files, and the fake that knows their poses."""
    for number in range(3):
        write_map(f"m{number}.npz", cube_map(number))
    return ["m0.npz", "m1.npz", "m2.npz"]


def _fake(monkeypatch, **tables):
    return FakeRegister([cube_map(n) for n in range(3)], WORLD, **tables).install(monkeypatch)


def _files():
    return sorted(path.name for path in Path().iterdir())


def _content():
    return {path: path.read_bytes() if path.is_file() else None for path in Path().iterdir()}


def _one_line(capsys):
    """The only line on stderr."""
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1, lines
    assert lines[0].startswith("voxjax: ")
    assert len(lines[0]) < 1300
    return lines[0]


def _run(*arguments, stdout):
    """A Python process of its own."""
    command = [sys.executable, *arguments]
    return subprocess.run(command, stdout=stdout, stderr=subprocess.PIPE, text=True, check=False)


def test_help_imports_neither_jax_nor_numpy():
    code = (
        "import sys; from voxjax.cli.main import main; code = main(sys.argv[1:]); "
        "sys.exit(code or sum(name in sys.modules for name in ('jax', 'numpy', 'equinox', 'scipy')))"
    )
    for arguments in (["--help"], ["merge", "--help"], ["--version"]):
        done = subprocess.run(
            [sys.executable, "-c", code, *arguments], capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
        assert "voxjax" in done.stdout


def test_merge_writes_all_outputs_and_exits_with_0(monkeypatch, maps, capsys):
    fake = _fake(monkeypatch)
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
    assert _files() == [*maps, "out.bt", "p.png", "r.json"]
    shown = capsys.readouterr()
    assert "maps 0 and 1: hypotheses" in shown.err
    assert "m1.npz: x 1.000, y -2.000, z 0.000 m" in shown.out


@pytest.mark.skipif(find_spec("viser") is None, reason="needs the extra voxjax[view]")
def test_the_page_is_written_with_the_map(monkeypatch, maps):
    _fake(monkeypatch)
    assert main(["merge", *maps, "-o", "out.bt", "--html", "v.html", "-q"]) == 0
    assert "<html" in Path("v.html").read_text(encoding="utf-8")


def test_a_page_without_its_extra_is_refused_at_once(monkeypatch, maps, capsys):
    fake = _fake(monkeypatch)
    monkeypatch.setattr(page, "find_spec", lambda name: None)
    assert main(["merge", *maps, "-o", "out.bt", "--html", "v.html", "-q"]) == 2
    assert "voxjax[view]" in _one_line(capsys)
    assert fake.calls == []


def test_quiet_shows_no_progress(monkeypatch, maps, capsys):
    _fake(monkeypatch)
    assert main(["merge", *maps, "-o", "out.npz", "-q"]) == 0
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("verdict", ["ambiguous", "no_overlap"])
def test_without_trust_there_is_a_report_but_no_map_and_the_code_is_3(monkeypatch, maps, capsys, verdict):
    _fake(monkeypatch, verdicts={(0, 1): verdict})
    code = main(["merge", *maps[:2], "-o", "out.bt", "--picture", "p.png", "--report", "r.json", "-q"])
    assert code == 3
    assert _files() == [*maps, "r.json"]
    pair = json.loads(Path("r.json").read_text())["pairs"][0]
    assert not pair["accepted"]
    assert verdict in pair["reason"]
    np.testing.assert_allclose(pair["hypotheses"][0]["T_a_b"], np.linalg.inv(WORLD[0]) @ WORLD[1], atol=1e-5)
    assert verdict in _one_line(capsys)


def test_a_stranger_needs_allow_partial(monkeypatch, maps, capsys):
    _fake(monkeypatch, verdicts={(0, 1): "no_overlap", (1, 2): "no_overlap"})
    assert main(["merge", *maps, "-o", "out.bt", "-q"]) == 3
    assert not Path("out.bt").exists()
    assert "--allow-partial" in _one_line(capsys)
    assert main(["merge", *maps, "-o", "out.bt", "--report", "r.json", "--allow-partial", "-q"]) == 0
    assert read_map("out.bt").num_occupied > 0
    report = json.loads(Path("r.json").read_text())
    assert report["status"] == "partial"
    assert [entry["T_world_map"] is None for entry in report["maps"]] == [False, True, False]


UNUSABLE = {
    "missing file": (["merge", "m0.npz", "nowhere.bt", "-o", "o.bt"], "nowhere.bt"),
    "one map": (["merge", "m0.npz", "-o", "o.bt"], "two maps"),
    "unknown ending in": (["info", "text.txt"], "text.txt"),
    "unknown ending out": (["merge", "m0.npz", "m1.npz", "-o", "o.xyz"], "o.xyz"),
    "unknown picture": (["merge", "m0.npz", "m1.npz", "-o", "o.bt", "--picture", "p.gif"], ".png"),
    "missing folder": (["merge", "m0.npz", "m1.npz", "-o", "no/o.bt"], "folder no does not exist"),
    "existing output": (["convert", "m0.npz", "m1.npz"], "--force"),
    "same output twice": (["merge", "m0.npz", "m1.npz", "-o", "o.npz", "--report", "o.npz"], ".json"),
    "garbage": (["info", "garbage.bt"], "garbage.bt"),
    "empty map": (["merge", "empty.npz", "m0.npz", "-o", "o.bt"], "empty.npz"),
    "no voxel size": (["info", "cloud.ply"], "--voxel-size"),
    "bad voxel size": (["info", "m0.npz", "--voxel-size", "-1"], "above 0"),
    "bad config": (["merge", "m0.npz", "m1.npz", "-o", "o.bt", "--config", "bad.toml"], "bad.toml"),
    "unknown key": (["merge", "m0.npz", "m1.npz", "-o", "o.bt", "--config", "key.toml"], "speed"),
    "endless config": (["merge", "m0.npz", "m1.npz", "-o", "o.bt", "--config", "/dev/zero"], "is a device"),
    "no config": (["merge", "m0.npz", "m1.npz", "-o", "o.bt", "--config", "no.toml"], "no.toml"),
    "bad guess": (["merge", "m0.npz", "m1.npz", "-o", "o.bt", "--init-guess", "1 2 3"], "3 numbers"),
    "guess for three": (["merge", *["m0.npz"] * 3, "-o", "o.bt", "--init-guess", "1"], "two maps"),
    "no command": ([], "COMMAND"),
    "unknown command": (["fuse"], "fuse"),
    "unknown option": (["info", "m0.npz", "--colour"], "--colour"),
    "resolution": (["convert", "m0.npz", "o.bt", "--voxel-size", "1e-9"], "larger voxel size"),
    "resolution of a cloud": (["info", "cloud.ply", "--voxel-size", "1e-9"], "larger voxel_size"),
    "voxels beyond reason": (["info", "m0.npz", "--voxel-size", "1e300"], "between 1e-12 and 1e+12 m"),
    "NaN voxel size": (["info", "m0.npz", "--voxel-size", "nan"], "above 0"),
    "endless voxel size": (["info", "m0.npz", "--voxel-size", "9" * 5000], "above 0"),
    "long name in": (["merge", "m0.npz", "x" * 300 + ".bt", "-o", "o.bt"], "File name too long"),
    "long name out": (["convert", "m0.npz", "x" * 300 + ".bt"], "File name too long"),
    "NUL in a name": (["info", "a\0b.npz"], "embedded null byte"),
    "no name": (["info", ""], "is not known"),
    "folder in": (["merge", "m0.npz", ".", "-o", "o.bt"], "is a folder"),
    "folder out": (["merge", "m0.npz", "m1.npz", "-o", "folder.bt"], "is a folder"),
    "dangling out": (["convert", "m0.npz", "dangling.bt"], "leads nowhere"),
    "no value": (["merge", "m0.npz", "m1.npz", "-o", "o.bt", "--report=--"], "--report"),
    "no seed": (["demo", "--seed", "nan"], "--seed"),
    "negative seed": (["demo", "--seed=-1"], "from 0"),
    "endless seed": (["demo", "--seed", "9" * 5000], "from 0"),
    "no folder": (["demo", "--out", "m0.npz/x"], "cannot be made"),
    "NUL in a folder": (["demo", "--out", "a\0b"], "cannot be made"),
    "nothing to draw": (["render", "void.npz", "-o", "p.png"], "no voxels"),
    "no such rule": (["merge", "m0.npz", "m1.npz", "-o", "o.bt", "--rule", "best"], "best"),
}  # fmt: skip


@pytest.mark.parametrize("case", UNUSABLE)
def test_unusable_input_is_one_line_and_code_2(monkeypatch, maps, capsys, case):
    _fake(monkeypatch)
    Path("text.txt").write_text("hello")
    Path("garbage.bt").write_bytes(b"\x00\x01 not a map")
    Path("bad.toml").write_text("= 3")
    Path("key.toml").write_text("speed = 3")
    write_map("cloud.ply", cube_map(0))
    write_map("empty.npz", VoxelGrid(np.ones((3, 3, 3), np.uint8), np.zeros(3, np.float32), 0.5))
    write_map("void.npz", VoxelGrid(np.ones((0, 3, 3), np.uint8), np.zeros(3, np.float32), 0.5))
    Path("folder.bt").mkdir()
    Path("dangling.bt").symlink_to("nowhere")
    before = _content()
    arguments, words = UNUSABLE[case]
    assert main([*arguments, *(["-q"] if arguments[:1] == ["merge"] else [])]) == 2
    assert words in _one_line(capsys)
    assert _content() == before


def test_outputs_are_refused_before_the_maps_are_registered(monkeypatch, maps):
    fake = _fake(monkeypatch)
    Path("r.json").write_text("mine")
    assert main(["merge", *maps, "-o", "out.bt", "--report", "r.json"]) == 2
    assert fake.calls == []
    assert Path("r.json").read_text() == "mine"
    assert main(["merge", *maps, "-o", "out.bt", "--report", "r.json", "--force"]) == 0
    assert Path("r.json").read_text() != "mine"


def test_a_fault_leaves_no_files_and_says_where_to_report(monkeypatch, maps, capsys):
    from voxjax.cli import merge as command

    _fake(monkeypatch)
    monkeypatch.setattr(command, "draw_merge", lambda *a, **k: 1 // 0)
    arguments = ["merge", *maps, "-o", "out.bt", "--report", "r.json", "--picture", "p.png", "-q"]
    assert main(arguments) == 1
    assert _files() == maps
    line = _one_line(capsys)
    assert "ZeroDivisionError" in line
    assert "--debug" in line
    assert main([*arguments, "--debug"]) == 1
    assert "Traceback" in capsys.readouterr().err


def test_a_map_beyond_the_limit_of_file_sizes_leaves_no_files(monkeypatch, maps, capsys):
    from voxjax.cli import merge as command

    def write_under_a_limit(contents, *, force):
        before = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (len(contents["m.npz"]) - 300, before[1]))
        try:
            write_files(contents, force=force)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, before)

    _fake(monkeypatch)
    monkeypatch.setattr(command, "write_files", write_under_a_limit)
    Path("report").mkdir()
    assert main(["merge", *maps, "-o", "m.npz", "--report", "report/m.json", "-q"]) == 2
    assert _files() == [*maps, "report"]
    assert not list(Path("report").iterdir())
    assert "m.npz cannot be written: File too large" in _one_line(capsys)


@pytest.mark.parametrize("as_file", [False, True])
def test_an_initial_guess_reaches_the_registration(monkeypatch, maps, as_file):
    fake = _fake(monkeypatch)
    text = "1 2 3 0 0 0.7071068 0.7071068"
    if as_file:
        Path("guess.txt").write_text(f"# time x y z qx qy qz qw\n17.5 {text}\n")
    assert main(["merge", *maps[:2], "-o", "o.bt", "--init-guess", "guess.txt" if as_file else text]) == 0
    np.testing.assert_allclose(fake.calls[0]["init_guess"], pose(np.pi / 2, (1, 2, 3)), atol=1e-6)


def test_settings_reach_the_registration(monkeypatch, maps):
    fake = _fake(monkeypatch)
    Path("s.toml").write_text("[source]\ndescriptors = false\n")
    assert main(["merge", *maps[:2], "-o", "o.bt", "--config", "s.toml", "-q"]) == 0
    assert fake.calls[0]["config"].source.descriptors is False
    assert fake.calls[0]["config"].source.corners is True


def test_info_counts_voxels(maps, capsys):
    assert main(["info", "m0.npz", "m1.npz", "--json"]) == 0
    entries = json.loads(capsys.readouterr().out)
    grid = read_map("m1.npz")
    assert [entry["path"] for entry in entries] == ["m0.npz", "m1.npz"]
    assert entries[1]["counts"]["occupied"] == grid.num_occupied
    assert sum(entries[1]["counts"].values()) == np.prod(grid.shape)
    assert entries[1]["memory_bytes"] == grid.states.nbytes
    assert main(["info", "m0.npz"]) == 0
    assert f"{cube_map(0).num_occupied:,}" in capsys.readouterr().out


def test_names_that_no_terminal_should_see_are_escaped(maps, capsys):
    names = ["two\nlines.npz", "\x1b[31mred.npz", "\udcff.npz"]
    for name in names:
        write_map(name, cube_map(0))
    assert main(["info", *names]) == 0
    shown = capsys.readouterr().out
    assert all(line.isprintable() for line in shown.splitlines())
    assert [line for line in shown.splitlines() if not line.startswith(" ")] == [
        "two\\nlines.npz",
        "\\x1b[31mred.npz",
        "\\udcff.npz",
    ]
    assert main(["info", "--json", *names]) == 0
    assert [entry["path"] for entry in json.loads(capsys.readouterr().out)] == names
    assert main(["convert", names[0], names[2], "--force"]) == 0
    assert main(["info", "\x1b[31mnowhere.npz"]) == 2
    assert "\\x1b[31mnowhere.npz" in capsys.readouterr().err


@pytest.mark.parametrize("voxel_size", ["1e12", "1e-9", "0.5"])
def test_json_holds_numbers_alone(maps, capsys, voxel_size):
    grid = cube_map(0)
    write_map("far.npz", VoxelGrid(grid.states, np.full(3, -9e11, np.float32), grid.voxel_size))
    code = main(["info", "--json", "far.npz", "m0.npz", "--voxel-size", voxel_size])
    shown = capsys.readouterr()
    if code == 2:
        assert len(shown.err.splitlines()) == 1
    else:
        assert "Infinity" not in shown.out
        assert "NaN" not in shown.out
        assert len(json.loads(shown.out)) == 2


def test_a_map_can_be_converted_in_place(maps):
    assert main(["convert", "m0.npz", "m0.npz"]) == 2
    assert main(["convert", "m0.npz", "m0.npz", "--voxel-size", "1.0", "--force"]) == 0
    assert read_map("m0.npz").equals(cube_map(0).with_voxel_size(1.0))


def test_convert_and_back_gives_the_same_map(maps):
    assert main(["convert", "m0.npz", "a.bt"]) == 0
    assert main(["convert", "a.bt", "b.npz"]) == 0
    first, second = read_map("m0.npz").crop_to_known(), read_map("b.npz")
    np.testing.assert_array_equal(first.states, second.states)
    np.testing.assert_allclose(first.origin, second.origin)


def test_render_draws_all_maps(maps):
    assert main(["render", *maps, "-o", "p.png"]) == 0
    assert Path("p.png").read_bytes().startswith(b"\x89PNG")
    assert main(["render", maps[0], "-o", "p.png"]) == 2
    assert main(["render", maps[0], "-o", "p.png", "--force", "--keep-ceiling"]) == 0


def test_corners_are_listed_with_normals_that_point_into_the_room(capsys):
    states = np.ones((24, 22, 20), np.uint8)
    states[[0, -1]] = states[:, [0, -1]] = states[:, :, [0, -1]] = 2
    write_map("room.npz", VoxelGrid(states, np.zeros(3, np.float32), 0.1))
    assert main(["corners", "room.npz", "-o", "c.csv", "--virtual"]) == 0
    header, *rows = Path("c.csv").read_text().splitlines()
    assert header == "x,y,z,n1x,n1y,n1z,n2x,n2y,n2z,n3x,n3y,n3z,kind"
    assert len(rows) >= 8
    middle = np.asarray([1.2, 1.1, 1.0])
    for row in rows:
        *numbers, kind = row.split(",")
        numbers = np.asarray(numbers, float)
        assert kind in ("observed", "virtual")
        assert (numbers[3:].reshape(3, 3) @ (middle - numbers[:3]) > 0).all()
    assert f"{sum(row.endswith('observed') for row in rows)} observed" in capsys.readouterr().out


@pytest.fixture
def pipe_without_reader():
    reader, writer = os.pipe()
    os.close(reader)
    yield writer
    os.close(writer)


@pytest.mark.parametrize(
    ("arguments", "code"),
    [(["info", "m0.npz"], 0), (["info", "m9.npz"], 2), (["--help"], 0), (["--version"], 0)],
)
def test_a_closed_pipe_changes_no_exit_code(maps, pipe_without_reader, arguments, code):
    done = _run("-m", "voxjax", *arguments, stdout=pipe_without_reader)
    assert done.returncode == code
    assert len(done.stderr.splitlines()) == (code == 2)


@pytest.mark.parametrize(("verdict", "code"), [("accepted", 0), ("no_overlap", 3)])
def test_a_merge_keeps_its_exit_code_when_nobody_reads_its_output(
    monkeypatch, maps, pipe_without_reader, verdict, code
):
    _fake(monkeypatch, verdicts={(0, 1): verdict})
    with open(pipe_without_reader, "w", closefd=False) as nobody, redirect_stdout(nobody):
        assert main(["merge", *maps[:2], "-o", "out.bt", "--report", "r.json", "-q"]) == code
    assert Path("out.bt").exists() == (code == 0)
    assert Path("r.json").exists()


def test_a_full_disk_behind_the_standard_output_is_said(maps, capsys):
    with open("/dev/full", "w") as full, redirect_stdout(full):
        assert main(["info", *maps]) == 2
    assert "No space left" in _one_line(capsys)
