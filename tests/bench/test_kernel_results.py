"""Results of the benchmark of kernels, of rows made up here: judged, kept in a file, held against earlier ones."""

import pytest
from bench.kernel_row import Target
from kernel_rows_made_up import SETTING, judged, made_row

from bench import kernel_results


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


def test_results_of_a_gpu_are_found_and_those_of_other_benchmarks_left_out(tmp_path):
    kernel_results.write(tmp_path / "cpu.json", [judged(made_row())])
    kernel_results.write(tmp_path / "gpu" / "gpu.json", [judged(made_row(name="other"))])
    (tmp_path / "gpu" / "registration.json").write_text('{"rows": [{"case": "one"}]}')
    (tmp_path / "gpu" / "versions.json").write_text('{"jax": "1"}')
    names = [[row["name"] for row in rows] for rows in kernel_results.read_all(tmp_path)]
    assert names == [["kernel, 4^3"], ["other"]]
