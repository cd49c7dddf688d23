"""A folder of their own for tests of the command line."""

import os

import pytest

from fake_register import cube_map
from voxjax import write_map


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The working folder, empty; no kernels are kept."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("VOXJAX_CACHE", "off")
    return tmp_path


@pytest.fixture
def maps(folder):
    """Three map files in the working folder."""
    for number in range(3):
        write_map(f"m{number}.npz", cube_map(number))
    return ["m0.npz", "m1.npz", "m2.npz"]


@pytest.fixture
def pipe_without_reader():
    """A descriptor to write to, whose reader has gone."""
    reader, writer = os.pipe()
    os.close(reader)
    yield writer
    os.close(writer)
