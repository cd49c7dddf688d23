"""Damaged map files: each is a map or one sentence, in little memory and time."""

import resource
import warnings
from collections import Counter
from pathlib import Path

import fuzz_server
import numpy as np
import pytest
from bench.fuzz_cases import KINDS, READERS, Edit, damaged, draw, put, right_files
from hypothesis import given, settings
from hypothesis import strategies as st

from bench import fuzz
from voxjax import InputError

EDIT = st.builds(
    Edit,
    kind=st.sampled_from(KINDS),
    place=st.floats(0.0, 1.0, exclude_max=True),
    size=st.integers(0, 64),
    value=st.integers(0, 2**32 - 1),
    is_inside=st.booleans(),
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("fuzz")


@pytest.fixture(scope="module")
def _one_gigabyte_more():
    """Allocations beyond it fail, and what fails is no `InputError`."""
    before = resource.getrlimit(resource.RLIMIT_DATA)
    status = dict(line.split(":", 1) for line in Path("/proc/self/status").read_text().splitlines())
    resource.setrlimit(resource.RLIMIT_DATA, (int(status["VmData"].split()[0]) * 1024 + 10**9, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_DATA, before)


@pytest.mark.usefixtures("_one_gigabyte_more")
@pytest.mark.parametrize("reader", [reader for reader in READERS if reader != "zarr"])
@given(number=st.integers(0, 2), edits=st.lists(EDIT, min_size=1, max_size=4))
@settings(derandomize=True, max_examples=250, deadline=10_000)
def test_a_damaged_file_is_a_map_or_one_sentence(folder, reader, number, edits):
    path = folder / f"map.{reader}"
    put(path, damaged(reader, number, edits))
    assert fuzz.read_case(path) in ("read", "refused")


@pytest.mark.usefixtures("_one_gigabyte_more")
@given(number=st.integers(0, 2), edits=st.lists(EDIT, min_size=1, max_size=3))
@settings(derandomize=True, max_examples=60, deadline=10_000)
def test_a_store_with_damaged_files_is_a_map_or_one_sentence(folder, number, edits):
    put(folder / "map.zarr", damaged("zarr", number, edits))
    assert fuzz.read_case(folder / "map.zarr") in ("read", "refused")


@pytest.mark.parametrize("reader", READERS)
def test_the_files_are_right_before_they_are_damaged(folder, reader):
    path = folder / f"right.{reader}"
    for data in right_files(reader):
        put(path, data)
        assert fuzz.read_case(path) == "read"


def test_the_same_seed_draws_the_same_files():
    first, second = (
        [damaged(reader, 0, draw(rng)) for reader in READERS for _ in range(5)]
        for rng in (np.random.default_rng(3), np.random.default_rng(3))
    )
    assert first == second
    assert len(set(first)) > 18


@pytest.mark.parametrize(
    ("error", "outcome"),
    [
        (InputError("m.bt cannot be read: it is damaged."), "refused"),
        (InputError("two\nlines."), "no sentence"),
        (IndexError("too far"), "IndexError: too far"),
        (MemoryError(), "MemoryError"),
    ],
)
def test_only_a_sentence_is_a_refusal(monkeypatch, error, outcome):
    def describe_map(path, *, voxel_size):
        raise error

    monkeypatch.setattr(fuzz, "describe_map", describe_map)
    assert outcome in fuzz.read_case(Path("m.bt"))


def test_memory_that_was_not_granted_is_a_failure(monkeypatch):
    def describe_map(path, *, voxel_size):
        raise InputError("m.bt cannot be read: no memory.") from MemoryError()

    monkeypatch.setattr(fuzz, "describe_map", describe_map)
    assert "took too much memory" in fuzz.read_case(Path("m.bt"))


def test_a_warning_is_a_failure(monkeypatch):
    monkeypatch.setattr(
        fuzz, "describe_map", lambda *a, **k: warnings.warn("overflow", RuntimeWarning, stacklevel=1)
    )
    assert "RuntimeWarning: overflow" in fuzz.read_case(Path("m.bt"))


def test_processes_that_die_or_take_too_much_are_failures_and_begin_anew(monkeypatch, tmp_path, capsys):
    files = iter([b"right", b"hangs", b"dies", b"large", b"slow", b"right"])
    monkeypatch.setattr(fuzz, "serve", fuzz_server.serve)
    monkeypatch.setattr(fuzz, "damaged", lambda *a: next(files))
    clock = iter(range(8)).__next__  # one tick for the end, and one before each file
    result = fuzz.fuzz("bt", seconds=7, seed=0, out=tmp_path, limits=fuzz.Limits(patience=0.5), clock=clock)
    assert result.counts["read"] == 2
    assert sorted(result.failures) == [
        "no answer in 0.5 s",
        "the process died with exit code 7",
        "took 12 s; read",
        "took 2000 MB; read",
    ]
    assert (result.seconds, result.megabytes) == (12.0, 2000.0)
    assert sorted(path.read_bytes() for path in tmp_path.glob("*.bt")) == [
        b"dies",
        b"hangs",
        b"large",
        b"slow",
    ]
    assert capsys.readouterr().out.count("\n") == 4


def test_the_command_gives_one_line_for_each_reader_and_fails_with_any(monkeypatch, capsys):
    results = {
        "bt": fuzz.Result(Counter(read=2, refused=1000), 0.25, 300.0),
        "ply": fuzz.Result(Counter({"read": 1, "IndexError": 2}), 0.5, 200.0),
    }
    monkeypatch.setattr(fuzz, "fuzz", lambda reader, **options: results[reader])
    assert fuzz.main(["--reader", "bt"]) == 0
    assert capsys.readouterr().out.split(":")[1] == (
        " 2 read, 1,000 refused, 0 failures of 0 kinds; slowest 0.25 s, most 300 MB\n"
    )
    assert fuzz.main(["--reader", "ply", "--reader", "bt"]) == 1
    assert "2 failures of 1 kinds" in capsys.readouterr().out
