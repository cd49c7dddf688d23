"""A table of the registration benchmark's real pairs one by one: as they are, re-framed, at half resolution."""

from collections.abc import Sequence

from bench.reports import markdown_table
from bench.summary import Row, methods_of

SOURCES = ("real", "re-framed", "half")
"""Where rows of a real pair and of its variants come from."""


def variant_table(rows: Sequence[Row]) -> str:
    """Lines for people and for Markdown, a table for each method; nothing without rows of variants of real pairs.

    Each cell has how many are right with their first pose, and how many of these are accepted. Below a table stands how
    many pairs are right, and accepted, in all that was run, and what is not, by name.
    """
    mine = [row for row in rows if row["source"] in SOURCES]
    if not any(row["source"] != "real" for row in mine):
        return ""
    return "\n\n".join(
        _table(method, [r for r in mine if r["method"] == method]) for method in methods_of(mine)
    )


def _table(method: str, rows: list[Row]) -> str:
    """The table of one method."""
    pairs: dict[str, list[Row]] = {}
    for row in rows:
        pairs.setdefault(row["case"].partition("~")[0].partition("/")[2], []).append(row)
    table = []
    for name, mine in (pairs | {"all": rows}).items():
        cells = [_right_and_accepted([row for row in mine if row["source"] == source]) for source in SOURCES]
        overlap = f"{mine[0]['overlap']:.2f}" if name != "all" else ""
        wrong = sum(bool(row["accepted"] and not row["right"]) for row in mine)
        table.append((name, overlap, *cells, str(wrong), f"{max(row['seconds'] for row in mine):.1f}"))
    head = (method, "overlap", *(f"{source}: right, accepted" for source in SOURCES))
    right = sum(all(row["right"] for row in mine) for mine in pairs.values())
    accepted = sum(all(row["right"] and row["accepted"] for row in mine) for mine in pairs.values())
    ends = [f"Of {len(pairs)} pairs {right} are right in all variants, and {accepted} accepted in all."]
    for label, chosen in (
        ("not right", [row for row in rows if not row["right"]]),
        ("right and not accepted", [row for row in rows if row["right"] and not row["accepted"]]),
    ):
        ends += [f"{label}: {', '.join(row['case'].partition('/')[2] for row in chosen)}"] if chosen else []
    return "\n\n".join([markdown_table((*head, "accepted and wrong", "seconds, at most"), table), *ends])


def _right_and_accepted(rows: list[Row]) -> str:
    """How many are right, and how many of these accepted."""
    right = [row for row in rows if row["right"]]
    return f"{len(right)}/{len(rows)}, {sum(bool(row['accepted']) for row in right)}" if rows else "-"
