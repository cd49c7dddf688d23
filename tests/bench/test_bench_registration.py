"""The command of the benchmark of registration: refusals, and resuming."""

import json

import numpy as np
import pytest
from bench.cases import Case
from bench.summary import markdown
from bench.variant_table import variant_table
from bench.worlds import MapPair
from hidden_packages import hide
from summary_rows import row as summary_row

from bench import registration
from voxjax import VoxelGrid


def test_a_missing_peer_is_refused_with_the_way_to_install_it(monkeypatch, capsys):
    hide(monkeypatch, "open3d")
    assert registration.main(["--peers", "open3d"]) == 2
    message = capsys.readouterr().err
    assert message.count("\n") == 1
    assert "pip install open3d-cpu" in message


@pytest.mark.parametrize(
    ("argv", "said"),
    [
        (["--peers", "nonsense"], "peer 'nonsense' is not known"),
        (["--presets", "fast"], "preset 'fast' is not known"),
        (["--maps", "no/such/folder"], "is no folder"),
        (["--only", "", "--generated", "0"], "no pair to run"),
    ],
)
def test_what_cannot_be_run_is_refused(argv, said, capsys):
    assert registration.main(argv) == 2
    assert said in capsys.readouterr().err


def test_resume_runs_only_what_is_missing(tmp_path, monkeypatch, capsys):
    grid = VoxelGrid(np.full((2, 2, 2), 2, np.uint8), np.zeros(3, np.float32), 0.1)
    calls = []

    def method(case, pair):
        calls.append(case.name)
        return {"seconds": 1.0, "verdict": "accepted", "accepted": True} | case.judge(
            [np.eye(4)], pair.T_a_b, np.zeros(3)
        )

    def case(name):
        return Case(name, "sim", "pair", "yaw", 3.0, 0.4, lambda: MapPair(grid, grid, np.eye(4), 1.0), {})

    names = ["sim/one"]
    monkeypatch.setattr(registration, "_voxjax", lambda preset: method)
    monkeypatch.setattr(registration, "_cases", lambda args: [case(name) for name in names])
    out = tmp_path / "rows.json"
    assert registration.main(["--out", str(out)]) == 0
    names.append("sim/two")
    assert registration.main(["--out", str(out), "--resume"]) == 0
    assert calls == ["sim/one", "sim/two"]
    assert [row["case"] for row in json.loads(out.read_text())["rows"]] == ["sim/one", "sim/two"]
    assert registration.main(["--out", str(out), "--resume", "--warm"]) == 2
    assert "leave out --resume" in capsys.readouterr().err


def test_the_table_is_that_of_the_kept_rows(tmp_path, capsys):
    out = tmp_path / "rows.json"
    assert registration.main(["--table", "--out", str(out)]) == 2
    assert "there is no file" in capsys.readouterr().err
    rows = [summary_row(), summary_row("theirs", right=False)]
    out.write_text(json.dumps({"rows": rows, "settings": {}}))
    assert registration.main(["--table", "--out", str(out)]) == 0
    assert capsys.readouterr().out.strip() == markdown(rows)
    rows.append(summary_row(case="real/one~half", source="half"))
    out.write_text(json.dumps({"rows": rows, "settings": {}}))
    assert registration.main(["--table", "--out", str(out)]) == 0
    assert capsys.readouterr().out.strip() == f"{markdown(rows)}\n\n{variant_table(rows)}"
    out.write_text(json.dumps([1, 2]))
    assert registration.main(["--table", "--out", str(out)]) == 2
    assert "no result of this benchmark" in capsys.readouterr().err
