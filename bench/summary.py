"""Summary of the registration benchmark's rows: a table with a column for each method, and the numbers behind it.

A row is a dict of one method on one case: "case", "source", "kind", "rotation", "overlap", "method", "right", "rank",
"degrees", "metres", "accepted" (None where the method has no verdict), "seconds", "refine_seconds" (peers only).
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

OVERLAP_BINS = ((0.0, 0.1), (0.1, 0.2), (0.2, 0.35), (0.35, 0.6), (0.6, 1.0 + 1e-9))
ROTATIONS = ("yaw", "tilt", "so3")
SOURCES = ("sim", "generated", "real", "re-framed", "half")

Row = dict[str, Any]


def methods_of(rows: Sequence[Row]) -> list[str]:
    """Names of the methods, in the order of their first row."""
    return list(dict.fromkeys(row["method"] for row in rows))


def bin_label(low: float, high: float) -> str:
    """Name of an overlap bin."""
    return f"< {high:g}" if low == 0.0 else f"> {low:g}" if high > 1.0 else f"{low:g} to {high:g}"


def in_bin(row: Row, low: float, high: float) -> bool:
    """Return whether the row is of a pair of one place whose overlap falls into the bin."""
    return row["kind"] == "pair" and low <= row["overlap"] < high


def summarize(rows: Sequence[Row]) -> list[tuple[str, dict[str, str | None]]]:
    """Lines of the summary: what is counted, and for each method the entry; None where it has none.

    Lines that no row belongs to are left out.
    """
    lines: list[tuple[str, dict[str, str | None]]] = []
    methods = methods_of(rows)

    def line(label: str, chosen: Callable[[Row], bool], entry: Callable[[list[Row]], str | None]) -> None:
        by_method = {m: [r for r in rows if r["method"] == m and chosen(r)] for m in methods}
        if any(by_method.values()):
            lines.append((label, {m: entry(mine) if mine else None for m, mine in by_method.items()}))

    for low, high in OVERLAP_BINS:
        line(
            f"right, overlap {bin_label(low, high)}",
            lambda r, low=low, high=high: in_bin(r, low, high),
            _right,
        )
    for rotation in ROTATIONS:
        line(f"right, {rotation}", lambda r, k=rotation: r["kind"] == "pair" and r["rotation"] == k, _right)
    others = dict.fromkeys(row["source"] for row in rows)
    for source in [*SOURCES, *(s for s in others if s not in SOURCES)]:
        line(
            f"right, one place, {source}",
            lambda r, s=source: r["kind"] == "pair" and r["source"] == s,
            _right,
        )
    for kind, label in (("pair", "one place"), ("hotel", "repeated rooms")):
        line(f"right and accepted, {label}", lambda r, k=kind: r["kind"] == k, _right_and_accepted)
        line(f"wrong accepts, {label}", lambda r, k=kind: r["kind"] == k, _wrong_accepts)
    line("accepted, different buildings", lambda r: r["kind"] == "none", _wrong_accepts)
    line("right, repeated rooms", lambda r: r["kind"] == "hotel", _right)
    line("truth in the first 5, repeated rooms", lambda r: r["kind"] == "hotel", _among_leaders)
    line("truth among the hypotheses, one place", lambda r: r["kind"] == "pair", _ranked)
    for key, unit in (("degrees", "deg"), ("metres", "m")):
        line(
            f"error of the right, median / 90 % [{unit}]",
            lambda r: bool(r["right"]),
            lambda mine, k=key: _quantiles([r[k] for r in mine], (50, 90)),
        )
    line(
        "seconds, median / 95 %",
        lambda r: True,
        lambda mine: _quantiles([r["seconds"] for r in mine], (50, 95)),
    )
    line(
        "of them small_gicp's refinement, median", lambda r: r.get("refine_seconds") is not None, _refinement
    )
    line("seconds of a first call, median", lambda r: r.get("first_seconds") is not None, _first_call)
    return lines


def wrong_accepts(rows: Sequence[Row], method: str) -> list[str]:
    """Cases where the method accepted a wrong pose, or one between different buildings."""
    return [r["case"] for r in rows if r["method"] == method and r["accepted"] and not r["right"]]


def markdown(rows: Sequence[Row]) -> str:
    """The summary as a Markdown table, and below it the cases of wrong accepts by name."""
    methods = methods_of(rows)
    table = [f"| | {' | '.join(methods)} |", "|---" * (len(methods) + 1) + "|"]
    for label, entries in summarize(rows):
        table.append(f"| {label} | {' | '.join(entries[m] or '-' for m in methods)} |")
    named = [(m, wrong_accepts(rows, m)) for m in methods]
    notes = [f"wrong accepts of {m}: {', '.join(cases)}" for m, cases in named if cases]
    return "\n".join([*table, *([""] if notes else []), *notes])


def _share(count: int, rows: list[Row]) -> str:
    return f"{count}/{len(rows)}"


def _right(rows: list[Row]) -> str:
    return _share(sum(bool(r["right"]) for r in rows), rows)


def _judged(rows: list[Row]) -> bool:
    return any(r["accepted"] is not None for r in rows)


def _right_and_accepted(rows: list[Row]) -> str | None:
    return _share(sum(bool(r["right"] and r["accepted"]) for r in rows), rows) if _judged(rows) else None


def _wrong_accepts(rows: list[Row]) -> str | None:
    return _share(sum(bool(r["accepted"] and not r["right"]) for r in rows), rows) if _judged(rows) else None


def _among_leaders(rows: list[Row]) -> str:
    return _share(sum(r["rank"] is not None and r["rank"] < 5 for r in rows), rows)


def _ranked(rows: list[Row]) -> str:
    return _share(sum(r["rank"] is not None for r in rows), rows)


def _quantiles(values: list[float], percent: tuple[int, int]) -> str:
    low, high = np.percentile(values, percent)
    return f"{low:.3g} / {high:.3g}"


def _refinement(rows: list[Row]) -> str:
    return f"{np.median([r['refine_seconds'] for r in rows]):.3g}"


def _first_call(rows: list[Row]) -> str:
    return f"{np.median([r['first_seconds'] for r in rows]):.3g}"
