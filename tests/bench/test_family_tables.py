"""Tables of rows of the families: what is counted, and what is enough."""

import pytest
from bench.family_tables import Share, family_tables, is_negative, shares
from family_rows_made_up import made_up


def lines_of(rows):
    return "\n".join(family_tables(rows)).splitlines()


def test_pairs_of_one_place_are_counted_by_overlap():
    rows = [made_up(f"room_same_{k}") for k in range(19)]
    rows += [made_up("room_same_19", verdict="ambiguous")]
    rows += [made_up("room_same_20", overlap=0.15), made_up("room_same_21", overlap=0.15, right=False)]
    rows += [made_up("room_same_22", overlap=0.07, right=False, verdict="no_overlap", confidence=0.0)]
    rows += [made_up("room_same_23", overlap=0.01)]
    found = shares(rows, has_free_space=True)
    assert list(found.values()) == [Share(19, 20, 0.95), Share(1, 1, 0.8), Share(0, 1, 0.6)]
    assert [share.is_met for share in found.values()] == [True, True, False]
    assert shares(rows, has_free_space=False)["accepted of the right, overlap 0.2 and more"].asked == 0.9
    cells = next(line for line in lines_of(rows) if line.startswith("| room ")).strip("| ").split(" | ")
    assert cells[1:4] == ["24", "20/20; 1/2; 0/1; 1/1", "19 of 20, 95 % (>= 78 %), met"]
    assert cells[5:8] == ["0 of 1, 0 % (>= 0 %), missed", "-", "1"]


def test_a_share_of_nothing_is_not_met():
    assert not Share(0, 0, 0.9).is_met
    assert Share(0, 0, 0.9).cells == ("-", "-")
    assert Share(9, 10, 0.9).cells == ("9 of 10, 90 % (>= 61 %)", "met")


def test_what_must_not_be_accepted_is_counted_with_its_bound():
    rows = [
        made_up(f"room_elsewhere_{k}", role="elsewhere", right=False, verdict="no_overlap") for k in range(3)
    ]
    text = "\n".join(lines_of(rows))
    assert "| none of them accepted | 0 of 3 (<= 63.2 %) | met |" in text
    assert "accepted and wrong: none" in text
    rows.append(made_up("room_mirrored_0_cloud", role="mirrored", right=False))
    text = "\n".join(lines_of(rows))
    assert "| none of them accepted | 1 of 4 (<= 75.1 %) | missed |" in text
    assert "accepted and wrong: room_mirrored_0_cloud" in text
    # Each table counts its own: the accepted one is a cloud.
    assert "| all | 3 | 0/0; 0/0; 0/0; 0/0 | - | - | - | 0 of 3 (<= 63.2 %), met | 0 |" in text
    assert "| all | 1 | 0/0; 0/0; 0/0; 0/0 | - | - | - | 1 of 1 (<= 100.0 %), missed | 0 |" in text


def test_maps_of_nearly_the_same_size_are_told_apart_from_the_others():
    little = made_up("room_scaled_0", role="scaled", factor=0.98, right=False)
    much = made_up("room_scaled_1", role="scaled", factor=1.05, right=False, verdict="ambiguous")
    assert [is_negative(row) for row in (little, much, made_up("room_same_0"))] == [False, True, False]
    text = "\n".join(lines_of([little, much]))
    assert "| scaled by 5 % and more | 1 | 0 | 0 (<= 95.0 %) | 0 |" in text
    assert "| scaled by less | 1 | 0 | 1 (<= 100.0 %) | 0 |" in text
    assert "| none of them accepted | 0 of 1 (<= 95.0 %) | met |" in text


@pytest.mark.parametrize(
    ("role", "reason", "is_named"),
    [
        ("mirrored", "Map b seems to be mirrored: ...", True),
        ("scaled", "Map b seems to be smaller by 5 %: ...", True),
        ("scaled", "Map b seems to be mirrored: ...", False),
        ("storey", "... another storey of one plan ...", True),
        ("storey", "No pose stands out.", False),
    ],
)
def test_causes_are_named_in_reasons(role, reason, is_named):
    row = made_up("room_x_0", role=role, reason=reason, verdict="ambiguous", right=False, factor=1.07)
    line = next(line for line in lines_of([row]) if line.startswith(f"| {role}: the reason"))
    assert line.endswith(
        "| 1 of 1, 100 % (>= 5 %) | met |" if is_named else "| 0 of 1, 0 % (>= 0 %) | missed |"
    )


def test_every_family_must_be_calibrated_and_accepted():
    rows = [made_up(f"room_same_{k}", confidence=1.0) for k in range(4)]
    rows += [made_up(f"hall_same_{k}", kind="hall", confidence=0.5, verdict="ambiguous") for k in range(4)]
    text = "\n".join(lines_of(rows))
    assert "| free space, the same from 0.2 on in every family | 1 of 2 families | missed |" in text
    assert "| 1 of 2 families, largest 0.500 (hall) | missed |" in text
    assert "| 0.000; 0.000, met |" in text
    assert "Clouds" not in text
