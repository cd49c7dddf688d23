"""Results of the benchmark of refinement: basins, targets, the file that keeps them."""

import pytest
from bench.refinement_table import FILE, OURS, markdown, read, targets, width, write
from refinement_rows import accuracy_row, basin_row


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
