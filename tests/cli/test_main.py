"""Exit codes of all commands, and what they say when they cannot go on."""

import errno
import subprocess
import sys
import warnings
from contextlib import redirect_stdout
from pathlib import Path

import jax
import numpy as np
import pytest

from clouds import write_cloud
from command_line import content, fake_register, files, one_line
from fake_register import cube_map
from voxjax import VoxelGrid, write_map
from voxjax.cli.main import main
from voxjax.io import DescribedMap
from voxjax.io.kept_memory import memory_of_grid
from voxjax.io.map_facts import facts_of_grid

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
    "no surface": (["info", "three.ply"], "give voxel_size= (--voxel-size) in metres"),
    "NaN alone": (["info", "nan.ply"], "all 2 points of the cloud are NaN or infinite"),
    "strict": (
        ["info", "some.ply", "--strict"],
        "1 of 2 points are NaN or infinite, which strict (--strict)",
    ),
    "crop of five": (["info", "m0.npz", "--crop", "0,0,0,1,1"], "must be six numbers"),
    "crop inside out": (["info", "m0.npz", "--crop", "0,0,2,1,1,1"], "first three lie below the last three"),
    "endless crop": (["info", "m0.npz", "--crop", "0,0,0,1,1,inf"], "must be six numbers"),
    "crop elsewhere": (["convert", "m0.npz", "o.bt", "--crop", "7,7,7,8,8,8"], "m0.npz cannot be read"),
    "bad voxel size": (["info", "m0.npz", "--voxel-size", "-1"], "above 0"),
    "bad config": (["merge", "m0.npz", "m1.npz", "-o", "o.bt", "--config", "bad.toml"], "bad.toml"),
    "unknown key": (["merge", "m0.npz", "m1.npz", "-o", "o.bt", "--config", "key.toml"], "speed"),
    "endless config": (["merge", "m0.npz", "m1.npz", "-o", "o.bt", "--config", "/dev/zero"], "is a device"),
    "confidence": (
        ["merge", "m0.npz", "m1.npz", "-o", "o.bt", "--config", "sure.toml"],
        "min_confidence must be",
    ),
    "no leaders": (
        ["merge", "m0.npz", "m1.npz", "-o", "o.bt", "--config", "none.toml"],
        "num_leaders must be",
    ),
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
    "no name": (["info", ""], "is a folder; give the name of a file"),
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
}


@pytest.mark.parametrize("case", UNUSABLE)
def test_unusable_input_is_one_line_and_code_2(monkeypatch, maps, capsys, case):
    fake_register(monkeypatch)
    Path("text.txt").write_text("hello")
    Path("garbage.bt").write_bytes(b"\x00\x01 not a map")
    Path("bad.toml").write_text("= 3")
    Path("sure.toml").write_text("[verdict]\nmin_confidence = nan")
    Path("none.toml").write_text("[leader]\nnum_leaders = 0")
    Path("key.toml").write_text("speed = 3")
    write_map("cloud.ply", cube_map(0))
    write_cloud("three.ply", [[0, 0, 0], [1.2, 0.3, 0], [0, 0.77, 0.11]])
    write_cloud("nan.ply", [[np.nan, 0, 0], [0, np.inf, 0]])
    write_cloud("some.ply", [[np.nan, 0, 0], [0, 0, 0]])
    write_map("empty.npz", VoxelGrid(np.ones((3, 3, 3), np.uint8), np.zeros(3, np.float32), 0.5))
    write_map("void.npz", VoxelGrid(np.ones((0, 3, 3), np.uint8), np.zeros(3, np.float32), 0.5))
    Path("folder.bt").mkdir()
    Path("dangling.bt").symlink_to("nowhere")
    before = content()
    arguments, words = UNUSABLE[case]
    assert main([*arguments, *(["-q"] if arguments[:1] == ["merge"] else [])]) == 2
    assert words in one_line(capsys)
    assert content() == before


def test_a_fault_leaves_no_files_and_says_where_to_report(monkeypatch, maps, capsys):
    from voxjax.cli import merge as command

    fake_register(monkeypatch)
    monkeypatch.setattr(command, "draw_merge", lambda *a, **k: 1 // 0)
    arguments = ["merge", *maps, "-o", "out.bt", "--report", "r.json", "--picture", "p.png", "-q"]
    assert main(arguments) == 1
    assert files() == maps
    line = one_line(capsys)
    assert "ZeroDivisionError" in line
    assert "--debug" in line
    assert main([*arguments, "--debug"]) == 1
    assert "Traceback" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "code"),
    [(["info", "m0.npz"], 0), (["info", "m9.npz"], 2), (["--help"], 0), (["--version"], 0)],
)
def test_a_closed_pipe_changes_no_exit_code(maps, pipe_without_reader, arguments, code):
    command = [sys.executable, "-m", "voxjax", *arguments]
    done = subprocess.run(command, stdout=pipe_without_reader, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == code
    assert len(done.stderr.splitlines()) == (code == 2)


def test_a_full_disk_behind_the_standard_output_is_said(maps, capsys):
    with open("/dev/full", "w") as full, redirect_stdout(full):
        assert main(["info", *maps]) == 2
    assert "No space left" in one_line(capsys)


def test_warnings_are_sentences(monkeypatch, maps, capsys):
    from voxjax.cli import info

    def describe_map(path, **options):
        warnings.warn("something\n is odd", RuntimeWarning, stacklevel=1)
        return DescribedMap(facts_of_grid(cube_map(0)), (), memory_of_grid(cube_map(0)))

    monkeypatch.setattr(info, "describe_map", describe_map)
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        assert main(["info", maps[0]]) == 0
    assert one_line(capsys).startswith("voxjax: something is odd (RuntimeWarning, test_main.py:")


@pytest.mark.parametrize(
    "error",
    [
        MemoryError(),
        OSError(errno.ENOMEM, "Cannot allocate memory"),
        RuntimeError("RESOURCE_EXHAUSTED: Out of memory allocating 9 GB"),
        jax.errors.JaxRuntimeError("INTERNAL: Generated function failed: Out of memory allocating 9 bytes."),
    ],
)
def test_too_little_memory_is_said_and_no_fault(monkeypatch, maps, capsys, error):
    from voxjax.cli import info

    def describe_map(path, **options):
        raise error

    monkeypatch.setattr(info, "describe_map", describe_map)
    assert main(["info", *maps]) == 2
    assert "memory does not suffice" in one_line(capsys)
