"""The table of peers beside voxjax."""

from bench.family_peer_table import peer_table, peers_of
from family_rows_made_up import made_up


def row(name, *, valid, peer_right=False, **other):
    peers = {"theirs": {"valid": valid, "right": peer_right, "seconds": 2.0}}
    return made_up(name, seconds=1.0, peers=peers, **other)


def line_of(rows, start):
    return (
        next(line for line in peer_table(rows).splitlines() if line.startswith(start))
        .strip("| ")
        .split(" | ")
    )


def test_each_system_is_counted_on_the_same_pairs():
    none = {"role": "elsewhere", "right": False, "verdict": "no_overlap"}
    rows = [
        row("room_same_0", valid=True, peer_right=True),
        row("room_same_1", valid=False, peer_right=True, verdict="ambiguous"),
        row("room_changed_0", role="changed", valid=True),
        row("room_elsewhere_0", valid=True, **none),
        row("room_elsewhere_1", valid=False, **none),
        # A map of nearly the same size has no true pose, but is nobody's fault.
        row("room_scaled_0", role="scaled", factor=0.98, valid=True, right=False),
        # The peer was not asked about this one.
        made_up("hall_same_0", kind="hall", seconds=9.0),
    ]
    assert peers_of(rows) == ["theirs"]
    ours = ["0 of 2 (<= 77.6 %)", "3 of 3", "2 of 3 (>= 14 %)", "0", "1 / 1"]
    assert line_of(rows, "| room | voxjax |")[2:] == ours
    theirs = ["1 of 2 (<= 97.5 %)", "2 of 3", "1 of 2 (>= 3 %)", "1", "2 / 2"]
    assert line_of(rows, "| room | theirs |")[2:] == theirs
    assert line_of(rows, "| all | theirs |")[2:] == theirs
    assert "hall" not in peer_table(rows)


def test_a_system_without_a_verdict_has_what_is_right_alone():
    rows = [
        row("room_same_0", valid=None, peer_right=True),
        row("room_elsewhere_0", role="elsewhere", valid=None),
    ]
    assert line_of(rows, "| room | theirs |")[2:] == ["-", "1 of 1", "-", "-", "2 / 2"]


def test_pairs_of_one_kind_alone_leave_the_other_cells_empty():
    rows = [row("room_elsewhere_0", role="elsewhere", right=False, valid=False)]
    assert line_of(rows, "| room | theirs |")[2:] == ["0 of 1 (<= 95.0 %)", "-", "-", "-", "2 / 2"]
