"""The command of the calibration: parts, resuming, and tables of kept rows."""

import json

import pytest
from bench.families import FAMILIES
from bench.peers import Peer
from family_rows_made_up import made_up

from bench import calibration


def no_answer(points_a, points_b, working):
    raise AssertionError


@pytest.fixture
def registered(monkeypatch):
    """Names of the pairs that were registered; they are not, in truth."""
    names = []

    def row(job, peers=(), earlier=None):
        names.append(job.name)
        said = {peer.name: {"valid": True, "right": True, "seconds": 1.0} for peer in peers}
        found = made_up(job.name, kind=job.family, role=job.role, factor=1.07, seconds=1.0)
        return (found if earlier is None else earlier) | ({"peers": said} if said else {})

    monkeypatch.setattr(calibration, "family_row", row)
    return names


def test_the_table_is_that_of_the_kept_rows(tmp_path, capsys):
    out = tmp_path / "rows.json"
    assert calibration.main(["--rows", str(out)]) == 2
    assert "there is no file" in capsys.readouterr().err
    row = {
        "name": "cross_1_2",
        "kind": "cross",
        "verdict": "no_overlap",
        "confidence": 0.0,
        "right": False,
        "rank": None,
    }
    out.write_text(json.dumps({"rows": [row]}))
    assert calibration.main(["--rows", str(out)]) == 0
    assert "| different buildings (1) | - | - | 0 | 0 (" in capsys.readouterr().out
    out.write_text(json.dumps([1]))
    assert calibration.main(["--rows", str(out)]) == 2
    assert "is no result of this benchmark" in capsys.readouterr().err


def test_parts_share_the_pairs_and_their_files_are_put_together(tmp_path, registered, capsys):
    files = [tmp_path / f"{part}.json" for part in (1, 2)]
    for part, path in enumerate(files, 1):
        argv = ["--families", "1", "--role", "negatives", "--part", f"{part}/2", "--out", str(path)]
        assert calibration.main(argv) == 0
    assert len(registered) == len(set(registered)) == 92
    assert all(name.split("_")[1] in ("elsewhere", "mirrored", "scaled", "storey") for name in registered)
    # Each part has some of each.
    part = registered[:46]
    assert {name.split("_")[0] for name in part} == set(FAMILIES)
    assert 0.3 < sum(name.endswith("_cloud") for name in part) / 46 < 0.7
    capsys.readouterr()
    plot = tmp_path / "plots" / "families.png"
    assert calibration.main(["--rows", *map(str, files), "--plot", str(plot)]) == 0
    assert "| pairs without a true pose: at least 1500 | 92 | missed |" in capsys.readouterr().out
    assert plot.stat().st_size > 10_000
    assert calibration.main(["--rows", str(files[0]), str(files[0])]) == 2
    assert "is there twice" in capsys.readouterr().err


def test_a_stopped_run_goes_on_where_it_was(tmp_path, monkeypatch, registered):
    out = tmp_path / "rows.json"
    argv = ["--families", "1", "--family", "room", "--role", "same", "mirrored", "--out", str(out)]
    row = calibration.family_row

    def stopped(job, peers, earlier):
        if len(registered) == 2:
            raise KeyboardInterrupt
        return row(job, peers, earlier)

    monkeypatch.setattr(calibration, "family_row", stopped)
    with pytest.raises(KeyboardInterrupt):
        calibration.main(argv)
    assert len(json.loads(out.read_text())["rows"]) == 2
    monkeypatch.setattr(calibration, "family_row", row)
    assert calibration.main(argv) == 0
    assert len(registered) == len(set(registered)) == 4
    assert [each["name"] for each in json.loads(out.read_text())["rows"]] == registered


def test_clouds_alone_can_be_chosen(tmp_path, registered):
    argv = [
        "--families",
        "2",
        "--family",
        "room",
        "--role",
        "same",
        "--clouds",
        "--out",
        str(tmp_path / "rows.json"),
    ]
    assert calibration.main(argv) == 0
    assert sorted(registered) == ["room_same_300000_cloud", "room_same_300001_cloud"]


def test_peers_are_asked_about_rows_that_are_there(tmp_path, monkeypatch, registered, capsys):
    monkeypatch.setattr(
        calibration, "load_peers", lambda names: [Peer(name, (), "", no_answer) for name in names]
    )
    out = tmp_path / "rows.json"
    argv = ["--families", "1", "--family", "room", "--role", "same", "--out", str(out)]
    assert calibration.main(argv) == 0
    assert "| room | voxjax |" not in capsys.readouterr().out
    plot = tmp_path / "families.png"
    assert calibration.main([*argv, "--peers", "theirs", "--plot", str(plot)]) == 0
    assert len(registered) == 4
    rows = json.loads(out.read_text())["rows"]
    assert [list(row["peers"]) for row in rows] == [["theirs"], ["theirs"]]
    assert "| room | theirs | - | 2 of 2 |" in capsys.readouterr().out
    assert plot.stat().st_size > 5_000
    assert calibration.main([*argv, "--peers", "theirs"]) == 0
    assert len(registered) == 4


def test_peers_of_buildings_are_refused(capsys, monkeypatch):
    monkeypatch.setattr(
        calibration, "load_peers", lambda names: [Peer(name, (), "", no_answer) for name in names]
    )
    assert calibration.main(["--peers", "theirs"]) == 2
    assert "--peers takes part in --families alone" in capsys.readouterr().err


def test_parts_do_not_share_a_file_by_default(tmp_path, monkeypatch, registered):
    monkeypatch.chdir(tmp_path)
    for part in ("1/2", "2/2"):
        assert (
            calibration.main(["--families", "1", "--family", "room", "--role", "same", "--part", part]) == 0
        )
    assert len(registered) == 2
    written = sorted(path.name for path in (tmp_path / "bench" / "out").iterdir())
    assert written == ["calibration_families_1_of_2.json", "calibration_families_2_of_2.json"]


def test_no_pair_and_no_part_are_refused(tmp_path, registered, capsys):
    out = tmp_path / "rows.json"
    argv = ["--families", "1", "--family", "room", "--role", "storey", "--out", str(out)]
    assert calibration.main(argv) == 2
    assert "there is no pair to run" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        calibration.main([*argv, "--part", "3/2"])
    assert "must be like 1/2, got '3/2'" in capsys.readouterr().err
    assert not registered


def test_one_picture_is_of_families_or_of_buildings(tmp_path, capsys):
    out = tmp_path / "rows.json"
    building = {"name": "hotel_1", "kind": "hotel", "verdict": "accepted", "confidence": 1.0, "right": True}
    building |= {
        "rank": 0,
        "tangent": [0.0] * 6,
        "covariance": [[float(i == j) for i in range(6)] for j in range(6)],
    }
    out.write_text(json.dumps({"rows": [building, made_up("room_same_0")]}))
    assert calibration.main(["--rows", str(out), "--plot", str(tmp_path / "a.png")]) == 2
    said = capsys.readouterr()
    assert "one of them" in said.err
    assert "| equal rooms (1) |" in said.out
    assert "| room | 1 |" in said.out
