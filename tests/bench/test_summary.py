"""Summary of the registration benchmark's rows."""

from bench.summary import markdown, methods_of, summarize, wrong_accepts
from summary_rows import row


def entries(rows):
    return dict(summarize(rows))


def test_overlap_bins_hold_their_lower_limit_and_only_pairs_of_one_place():
    rows = [row(overlap=value) for value in (0.0, 0.0999, 0.1, 0.2, 0.35, 0.6, 1.0)]
    rows += [row(kind="hotel", overlap=0.5), row(kind="none", overlap=0.0, right=None, accepted=False)]
    found = entries(rows)
    counts = [
        found[f"right, overlap {label}"]["ours"]
        for label in ("< 0.1", "0.1 to 0.2", "0.2 to 0.35", "0.35 to 0.6", "> 0.6")
    ]
    assert counts == ["2/2", "1/1", "1/1", "1/1", "2/2"]


def test_wrong_accepts_of_all_kinds():
    rows = [
        row(),
        row(case="sim/wrong", right=False, rank=3, degrees=90.0),
        row(case="sim/doubted", right=False, rank=None, accepted=False),
        row(case="sim/none", kind="none", right=None, rank=None, degrees=None, metres=None),
        row(case="sim/hotel", kind="hotel", right=False, rank=4, accepted=False),
    ]
    found = entries(rows)
    assert found["wrong accepts, one place"]["ours"] == "1/3"
    assert found["right and accepted, one place"]["ours"] == "1/3"
    assert found["accepted, different buildings"]["ours"] == "1/1"
    assert found["wrong accepts, repeated rooms"]["ours"] == "0/1"
    assert found["truth in the first 5, repeated rooms"]["ours"] == "1/1"
    assert found["truth among the hypotheses, one place"]["ours"] == "2/3"
    assert wrong_accepts(rows, "ours") == ["sim/wrong", "sim/none"]


def test_errors_are_of_the_right_poses_and_times_of_all():
    rows = [row(degrees=1.0, seconds=1.0), row(degrees=3.0, seconds=2.0)]
    rows.append(row(degrees=170.0, right=False, seconds=9.0))
    found = entries(rows)
    assert found["error of the right, median / 90 % [deg]"]["ours"] == "2 / 2.8"
    assert found["seconds, median / 95 %"]["ours"] == "2 / 8.3"


def test_a_peer_without_a_verdict_has_no_entry_rather_than_no_wrong_accepts():
    rows = [row(), row("peer", accepted=None, right=False, refine_seconds=0.25)]
    assert methods_of(rows) == ["ours", "peer"]
    assert entries(rows)["wrong accepts, one place"] == {"ours": "0/1", "peer": None}
    table = markdown(rows)
    assert "| wrong accepts, one place | 0/1 | - |" in table
    assert "| of them small_gicp's refinement, median | - | 0.25 |" in table
