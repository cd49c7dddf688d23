"""The table of real pairs one by one, with their variants."""

from bench.variant_table import variant_table
from summary_rows import row


def variants(pair, method="ours", **half):
    return [
        row(method, case=f"real/{pair}", source="real", overlap=0.7),
        row(method, case=f"real/{pair}~frame_1_0", source="re-framed", accepted=False),
        row(method, case=f"real/{pair}~frame_1_1", source="re-framed", seconds=3.0),
        row(method, case=f"real/{pair}~half", source="half", **half),
    ]


def test_each_pair_has_a_line_with_what_is_right_and_accepted():
    text = variant_table([row(), *variants("one", right=False), *variants("two", accepted=False)])
    assert "| one | 0.70 | 1/1, 1 | 2/2, 1 | 0/1, 0 | 1 | 3.0 |" in text
    assert "| two | 0.70 | 1/1, 1 | 2/2, 1 | 1/1, 0 | 0 | 3.0 |" in text
    assert "| all |  | 2/2, 2 | 4/4, 2 | 1/2, 0 | 1 | 3.0 |" in text
    assert "Of 2 pairs 1 are right in all variants, and 0 accepted in all." in text
    assert "\nnot right: one~half\n" in text
    assert text.endswith("right and not accepted: one~frame_1_0, two~frame_1_0, two~half")
    assert "sim" not in text


def test_methods_have_tables_of_their_own_and_what_was_not_run_is_left_empty():
    text = variant_table([*variants("one")[:3], *variants("one", "theirs", right=False)])
    ours, theirs = text.split("| theirs |")
    assert "| one | 0.70 | 1/1, 1 | 2/2, 1 | - | 0 | 3.0 |" in ours
    assert "| one | 0.70 | 1/1, 1 | 2/2, 1 | 0/1, 0 | 1 | 3.0 |" in theirs
    assert "not right" not in ours


def test_without_variants_there_is_no_table():
    assert variant_table([row(), row(case="real/one", source="real")]) == ""
