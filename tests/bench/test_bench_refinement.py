"""The command of the benchmark of refinement: refusals, what it writes, draws and prints."""

import json

import pytest
from bench.refinement_parts import Plan
from bench.refinement_table import FILE, OURS
from refinement_rows import made_case, made_pair, refiner

from bench import refinement


@pytest.mark.parametrize(
    ("argv", "said"),
    [
        (["--peers", "nonsense"], "peer 'nonsense' is not known"),
        (["--only", "speed"], "part 'speed' is not known"),
        (["--maps", "no/such/folder"], "is no folder"),
        (["--table", "--results", "no/such/folder"], "there is no file"),
    ],
)
def test_what_cannot_be_run_is_refused(argv, said, capsys):
    assert refinement.main(argv) == 2
    message = capsys.readouterr().err
    assert said in message
    assert message.count("\n") == 1


def test_the_command_writes_draws_and_prints_its_results(tmp_path, monkeypatch, capsys):
    pair = made_pair()
    plan = Plan([made_case(pair)], [made_case(pair)], starts=1, levels=2, seed=1)
    methods = [refiner(OURS, lambda pair, T: pair.T_a_b), refiner("peer", lambda pair, T: T)]
    monkeypatch.setattr(refinement, "_plan", lambda args: plan)
    monkeypatch.setattr(refinement, "load_refiners", lambda names: methods)
    folder = ["--results", str(tmp_path)]
    quick = ["--only", "accuracy,basin", "--plot", str(tmp_path / "img")]
    assert refinement.main([*folder, *quick]) == 0
    assert {p.name for p in (tmp_path / "img").iterdir()} == {
        "refinement_basin.png",
        "refinement_accuracy.png",
    }
    assert set(json.loads((tmp_path / FILE).read_text())) == {"accuracy", "basin"}
    capsys.readouterr()
    assert refinement.main([*folder, "--table"]) == 0
    printed = capsys.readouterr().out
    assert "| basin, both: as wide as any peer's | 2 m, 30°, peer 0 m, 0° | met |" in printed
