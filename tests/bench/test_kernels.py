"""The driver of the benchmark of kernels, on rows made up here: nothing in it depends on how fast this machine is."""

import json
import types

import pytest
from bench.kernel_row import Target
from kernel_rows_made_up import SETTING, judged, made_row

from bench import kernel_results, kernel_setting, kernels


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
