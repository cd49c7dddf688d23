"""The driver of the benchmark of kernels, on rows made up here: nothing in it depends on how fast this machine is."""

import json
import types

import numpy as np
import pytest
from bench.kernel_plots import constant_surface
from bench.kernel_row import KernelRow, Target
from bench.kernel_rows import box as box_rows
from bench.timing import Timing

from bench import kernel_results, kernel_setting, kernels
from oracles import sliding_window

SETTING = {
    "device": "Some Processor (R), 2 cores",
    "allocator": "default",
    "jax": "1",
    "numpy": "2",
    "scipy": "3",
}


def made_row(**changes) -> KernelRow:
    calls = {"ours": lambda: np.zeros(1), "theirs": lambda: np.zeros(1)}
    options = {"name": "kernel, 4^3", "ours": "ours", "candidates": calls, "count": 1000, "unit": "voxel"}
    return KernelRow(**(options | changes))


def judged(row, ours=1e-3, theirs=4e-3, limit=0.0):
    timings = [Timing(name, 0.5, s, s, s, 3) for name, s in (("ours", ours), ("theirs", theirs))]
    return kernel_results.result_of(row, timings, limit, SETTING, quick=True)


@pytest.mark.parametrize(
    ("changes", "met"),
    [
        ({}, None),
        ({"targets": (Target("theirs", 4.0),)}, True),
        ({"targets": (Target("theirs", 4.1),)}, False),
        ({"targets": (Target("not installed", 9.0),)}, None),
        ({"max_ns": 1000.0}, True),
        ({"max_ns": 999.0}, False),
        ({"temporary_bytes": 2000, "max_temporary": 2.0}, True),
        ({"temporary_bytes": 2001, "max_temporary": 2.0}, False),
        ({"targets": (Target("theirs", 1.0),), "max_ns": 1.0}, False),
    ],
)
def test_a_row_meets_its_target_only_if_all_of_it_holds(changes, met):
    result = judged(made_row(**changes))
    assert result["met"] is met
    text = "\n".join(kernel_results.lines_of(result))
    assert ("MISSED" in text) == (met is False)


def test_the_share_of_the_limit_is_that_of_the_bytes_moved():
    result = judged(made_row(bytes_moved=3e6), limit=12e9)
    assert result["bytes_per_s"] == pytest.approx(3e9)
    assert result["share_of_limit"] == pytest.approx(0.25)
    assert judged(made_row())["share_of_limit"] is None


def test_results_of_other_rows_and_allocators_stay_in_the_file(tmp_path):
    path = tmp_path / "device.json"
    first = judged(made_row())
    kernel_results.write(path, [first, judged(made_row(name="other"))])
    tuned = first | {"setting": SETTING | {"allocator": "tuned"}}
    kernel_results.write(path, [first | {"seconds": 5.123456}, tuned])
    rows = {(r["name"], r["setting"]["allocator"]): r["seconds"] for r in kernel_results.read(path)}
    assert rows == {
        ("kernel, 4^3", "default"): 5.123,
        ("kernel, 4^3", "tuned"): 0.001,
        ("other", "default"): 0.001,
    }


def test_the_gate_names_ratios_that_fell_and_only_those():
    row = made_row(targets=(Target("theirs", 1.0),))
    before = [judged(row, theirs=10e-3)]
    assert kernel_results.falls([judged(row, theirs=7.1e-3)], before) == []
    (line,) = kernel_results.falls([judged(row, theirs=6.9e-3)], before)
    assert "6.90" in line
    assert "10.00" in line
    assert kernel_results.falls([judged(row, theirs=1e-3)], []) == []


@pytest.fixture
def driver(monkeypatch):
    """The driver with one module of two made-up rows."""
    row = made_row(targets=(Target("theirs", 1e-9),), bytes_moved=1.0)
    module = types.SimpleNamespace(rows=lambda *, quick: iter([row, made_row(name=f"quick {quick}")]))
    monkeypatch.setattr(kernels, "module_names", lambda: ["made"])
    monkeypatch.setattr(kernels.importlib, "import_module", lambda name: module)
    monkeypatch.setattr(kernels, "widening_copy", lambda: lambda: None)
    return module


def test_a_run_prints_judges_and_writes_every_row(driver, tmp_path, capsys):
    assert kernels.main(["--quick", "--rounds", "1", "--results", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert "2 rows, 1 of 1 with a target met it, 0 modules failed" in printed
    (path,) = tmp_path.glob("*.json")
    assert path.name == kernel_setting.file_name(kernel_setting.device_name())
    names = [row["name"] for row in json.loads(path.read_text())["rows"]]
    assert names == ["kernel, 4^3", "quick True"]


def test_only_rows_whose_name_contains_the_substring_run(driver, tmp_path, capsys):
    assert kernels.main(["--only", "quick", "--rounds", "1", "--results", str(tmp_path)]) == 0
    assert "\n1 rows" in capsys.readouterr().out


def test_the_gate_writes_nothing_and_fails_without_a_baseline(driver, tmp_path, capsys):
    options = ["--rounds", "1", "--results", str(tmp_path)]
    assert kernels.main([*options, "--gate"]) == 2
    assert not list(tmp_path.iterdir())
    assert kernels.main(options) == 0
    (path,) = tmp_path.glob("*.json")
    rows = kernel_results.read(path)
    for row in rows:
        for target in row["targets"]:
            target["ratio"] *= 1e6
    path.write_text(json.dumps({"rows": rows}))
    before = path.read_text()
    assert kernels.main([*options, "--gate"]) == 1
    assert "was" in capsys.readouterr().err
    assert path.read_text() == before


def test_a_module_that_fails_is_named_and_the_others_run(driver, monkeypatch, tmp_path, capsys):
    def broken(*, quick):
        raise RuntimeError("these results differ")

    modules = {"bad": types.SimpleNamespace(rows=broken), "made": driver}
    monkeypatch.setattr(kernels, "module_names", lambda: list(modules))
    monkeypatch.setattr(kernels.importlib, "import_module", lambda name: modules[name.rsplit(".", 1)[1]])
    assert kernels.main(["--rounds", "1", "--results", str(tmp_path)]) == 1
    captured = capsys.readouterr()
    assert "bad.py FAILED" in captured.err
    assert "these results differ" in captured.err
    assert "\n2 rows" in captured.out


def test_the_table_is_made_from_the_files_and_says_what_is_missing(tmp_path, capsys):
    kernel_results.write(tmp_path / "a.json", [judged(made_row(targets=(Target("theirs", 4.0),)))])
    assert kernels.main(["--table", "--results", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert "| kernel, 4^3 | default | 1 ms | 1e+03 ns | 4 x theirs (>= 4) | - | - | met |" in printed
    assert "**GPU**: not yet measured." in printed
    kernel_results.write(
        tmp_path / "b.json", [judged(made_row()) | {"setting": SETTING | {"allocator": "device"}}]
    )
    kernels.main(["--table", "--results", str(tmp_path)])
    assert "not yet measured" not in capsys.readouterr().out


def test_every_module_of_rows_is_found():
    assert {"window", "compaction"} <= set(kernels.module_names())
    assert "scene" not in kernels.module_names()


@pytest.mark.parametrize(
    ("variable", "value", "expected"),
    [
        ("GLIBC_TUNABLES", "glibc.malloc.hugetlb=1:glibc.malloc.mmap_max=0", "tuned"),
        ("LD_PRELOAD", "/some/where/libjemalloc.so.2", "tuned"),
        ("GLIBC_TUNABLES", "glibc.malloc.perturb=0", "default"),
    ],
)
def test_the_allocator_is_told_from_the_environment(monkeypatch, variable, value, expected):
    for name in ("GLIBC_TUNABLES", "LD_PRELOAD"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv(variable, value)
    assert kernel_setting.allocator() == expected
    assert "/some/where" not in str(kernel_setting.describe())


def test_names_of_files_are_plain():
    assert kernel_setting.file_name("AMD EPYC(TM) 9B45, 2 cores") == "amd-epyc-tm-9b45-2-cores.json"


def test_points_of_constant_surface_are_told_by_name_and_sorted():
    rows = [made_row(name=f"box_count 7 at constant surface, {s}") for s in ("512x512x256", "256x256x128")]
    curves = constant_surface([judged(row) for row in (*rows, made_row())])
    assert curves["ours"] == [(2.0**23, 1e-3), (2.0**26, 1e-3)]


def test_references_of_the_count_equal_the_oracle():
    occupied = (np.random.default_rng(0).random((9, 10, 11)) < 0.4).astype(np.uint8)
    for size in (3, 7, 15):
        np.testing.assert_array_equal(
            box_rows.numpy_adds(occupied, size), sliding_window.window_count(occupied, size)
        )
