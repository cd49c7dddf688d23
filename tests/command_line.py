"""The command line called in this process, with a registration that knows the answer."""

from pathlib import Path

from fake_register import FakeRegister, cube_map, pose

WORLD = [pose(0.4 * n, (n, -2.0 * n, 0.0)) for n in range(3)]
"""Poses `T_world_map` of the maps m0.npz, m1.npz and m2.npz of the fixture `maps`."""


def fake_register(monkeypatch, **tables):
    """Let `merge` find the true poses of `cube_map`s, with verdicts from a table."""
    return FakeRegister([cube_map(n) for n in range(3)], WORLD, **tables).install(monkeypatch)


def files():
    """Names of all files in the working folder."""
    return sorted(path.name for path in Path().iterdir())


def content():
    """What each file in the working folder holds; None for folders and links that lead nowhere."""
    return {path: path.read_bytes() if path.is_file() else None for path in Path().iterdir()}


def one_line(capsys):
    """The only line on stderr."""
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1, lines
    assert lines[0].startswith("voxjax: ")
    assert len(lines[0]) < 1300
    return lines[0]
