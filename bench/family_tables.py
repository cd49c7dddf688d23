"""Tables of rows of the families of places: by family with bounds, by what a pair is, and what was asked.

Pairs of one place are reported by their overlap; the others, with moved things, of other places, mirrored, scaled and
of other storeys, by what they are. Shares have a 95 % bound (Clopper-Pearson, one-sided): the least that the share of
all such pairs may be, or the most where none is wanted.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from bench.families import ROLES
from bench.family_rows import NEGATIVES
from bench.reliability import calibration_error, confidences, error_of_exact, lower_bound, upper_bound
from bench.reports import markdown_table

Row = dict[str, Any]

MOST_ERROR = 0.05
"""Expected calibration error that is asked of each family."""


class Share(NamedTuple):
    """How many of some pairs are as they should be, and what share of them was asked."""

    count: int
    total: int
    asked: float

    @property
    def is_met(self) -> bool:
        """Whether there are such pairs, and enough of them are as they should be."""
        # 95 % of 20 pairs is 19, whatever floating point makes of it.
        return self.total > 0 and self.count >= self.asked * self.total - 1e-9

    @property
    def cells(self) -> tuple[str, str]:
        """Numbers, share and bound; whether it is enough."""
        if not self.total:
            return "-", "-"
        share, least = 100 * self.count / self.total, 100 * lower_bound(self.count, self.total)
        return f"{self.count} of {self.total}, {share:.0f} % (>= {least:.0f} %)", _met(self.is_met)


def family_tables(rows: list[Row]) -> list[str]:
    """Lines for people and for Markdown: tables with free space and without, what was asked, wrong accepts by name."""
    lines = []
    for has_free_space in (True, False):
        mine = [row for row in rows if _is_cloud(row) != has_free_space]
        if mine:
            lines += ["", "With free space:" if has_free_space else "Clouds, without free space:", ""]
            lines += [_by_family(mine, has_free_space=has_free_space), "", _by_role(mine)]
    wrong = [row["name"] for row in rows if _is_wrong_accept(row)]
    return [*lines, "", _asked(rows), "", f"accepted and wrong: {', '.join(wrong) or 'none'}"]


def shares(rows: Sequence[Row], *, has_free_space: bool) -> dict[str, Share]:
    """What was asked of pairs of one place, by overlap.

    Args:
        rows: Rows of any pairs; those of one place as it was count.
        has_free_space: Whether they know free space: of clouds less is asked.
    """
    same = [row for row in rows if row["role"] == "same"]
    large, middle, small = (
        [row for row in same if low <= row["overlap"] < high]
        for low, high in ((0.2, np.inf), (0.1, 0.2), (0.05, 0.1))
    )
    return {
        "accepted of the right, overlap 0.2 and more": _accepted(large, 0.95 if has_free_space else 0.9),
        "accepted of the right, 0.1 to 0.2": _accepted(middle, 0.8),
        "right, 0.05 to 0.1": Share(sum(row["right"] for row in small), len(small), 0.6),
    }


def is_negative(row: Row) -> bool:
    """Whether a pair must not be accepted: no pose is right, nor nearly so, as for maps of 2 % another size."""
    return row["role"] in NEGATIVES and not _is_little_scaled(row)


def _by_family(rows: list[Row], *, has_free_space: bool) -> str:
    """A table with a row for each family, and one for all."""
    labels = shares([], has_free_space=has_free_space)
    head = ["family", "pairs", "right of one place, overlap from 0.2; 0.1; 0.05; 0"]
    head += [f"{label} (>= {100 * share.asked:.0f} %)" for label, share in labels.items()]
    head += ["accepted without a true pose (0)", "other wrong accepts"]
    head += [f"calibration error (<= {MOST_ERROR:g}); were it exact"]
    groups = {family[0]["kind"]: family for family in _families(rows)}
    table = []
    for name, mine in (groups | {"all": rows}).items():
        negatives = [row for row in mine if is_negative(row)]
        others = sum(_is_wrong_accept(row) for row in mine if not is_negative(row))
        cells = [share.cells for share in shares(mine, has_free_space=has_free_space).values()]
        cells += [_none_of(negatives), (str(others),), _error(mine)]
        table.append((name, str(len(mine)), _right(mine), *map(_joined, cells)))
    return markdown_table(head, table)


def _by_role(rows: list[Row]) -> str:
    """A table of the pairs that are not two maps of one place as it was."""
    groups = {role: [row for row in rows if row["role"] == role] for role in ROLES if role != "same"}
    scaled = groups.pop("scaled")
    groups["scaled by 5 % and more"] = [row for row in scaled if not _is_little_scaled(row)]
    groups["scaled by less"] = [row for row in scaled if _is_little_scaled(row)]
    table = []
    for name, mine in groups.items():
        wrong = sum(_is_wrong_accept(row) for row in mine)
        accepted = sum(row["verdict"] == "accepted" for row in mine)
        bound = f"{wrong} (<= {100 * upper_bound(wrong, len(mine)):.1f} %)" if mine else "-"
        named = str(sum(_is_named(row) for row in mine)) if name != "elsewhere" else "-"
        table.append((name, str(len(mine)), str(accepted - wrong), bound, named))
    head = ("pairs", "number", "accepted and right", "accepted and wrong (95 % bound)", "cause named")
    return markdown_table(head, table)


def _asked(rows: list[Row]) -> str:
    """A table of what was asked of all families."""
    negatives = [row for row in rows if is_negative(row)]
    count = len(negatives)
    table = [
        ("pairs without a true pose: at least 1500", str(count), _met(count >= 1500)),
        ("none of them accepted", *_none_of(negatives)),
    ]
    for has_free_space in (True, False):
        mine = [row for row in rows if _is_cloud(row) != has_free_space]
        kind = "free space" if has_free_space else "clouds"
        for label, share in shares(mine, has_free_space=has_free_space).items():
            table.append((f"{kind}, {label}: >= {100 * share.asked:.0f} %", *share.cells))
        each = (
            next(iter(shares(family, has_free_space=has_free_space).values())) for family in _families(mine)
        )
        table.append((f"{kind}, the same from 0.2 on in every family", *_every([s for s in each if s.total])))
    table.append((f"calibration error of every family <= {MOST_ERROR:g}", *_worst_error(rows)))
    for role in ("mirrored", "scaled", "storey"):
        mine = [row for row in rows if row["role"] == role]
        share = Share(sum(_is_named(row) for row in mine), len(mine), 0.95)
        table.append((f"{role}: the reason names the cause: >= 95 %", *share.cells))
    return markdown_table(("asked", "measured (95 % bound)", ""), table)


def _families(rows: list[Row]) -> list[list[Row]]:
    """The rows of each family."""
    return [[row for row in rows if row["kind"] == family] for family in sorted({r["kind"] for r in rows})]


def _every(each: list[Share]) -> tuple[str, str]:
    """How many families have enough, and whether all have."""
    enough = sum(share.is_met for share in each)
    return (f"{enough} of {len(each)} families", _met(enough == len(each))) if each else ("-", "-")


def _worst_error(rows: list[Row]) -> tuple[str, str]:
    """How many families have a small calibration error, the largest error, and whether all have."""
    errors = {family[0]["kind"]: calibration_error(*confidences(family)) for family in _families(rows)}
    worst = max(errors, key=lambda family: errors[family])
    enough = sum(error <= MOST_ERROR for error in errors.values())
    measured = f"{enough} of {len(errors)} families, largest {errors[worst]:.3f} ({worst})"
    return measured, _met(enough == len(errors))


def _error(rows: list[Row]) -> tuple[str, str]:
    """Calibration error, what it would be in the mean were the confidences exact, and whether it is small enough."""
    confidence, is_right = confidences(rows)
    error = calibration_error(confidence, is_right)
    return f"{error:.3f}; {error_of_exact(confidence):.3f}", _met(error <= MOST_ERROR)


def _none_of(negatives: list[Row]) -> tuple[str, str]:
    """How many of these pairs were accepted, with the bound of the rate, and whether none was."""
    if not negatives:
        return "-", "-"
    count = sum(row["verdict"] == "accepted" for row in negatives)
    bound = 100 * upper_bound(count, len(negatives))
    return f"{count} of {len(negatives)} (<= {bound:.1f} %)", _met(count == 0)


def _accepted(rows: list[Row], asked: float) -> Share:
    """How many of the right ones were accepted."""
    right = [row for row in rows if row["right"]]
    return Share(sum(row["verdict"] == "accepted" for row in right), len(right), asked)


def _right(rows: list[Row]) -> str:
    """How many pairs of one place are right, by overlap; those below what anything was asked of, too."""
    same = [row for row in rows if row["role"] == "same"]
    groups = (
        [row["right"] for row in same if low <= row["overlap"] < high]
        for low, high in ((0.2, np.inf), (0.1, 0.2), (0.05, 0.1), (0.0, 0.05))
    )
    return "; ".join(f"{sum(group)}/{len(group)}" for group in groups)


def _is_wrong_accept(row: Row) -> bool:
    return row["verdict"] == "accepted" and not row["right"]


def _is_cloud(row: Row) -> bool:
    """Whether a pair was made without free space."""
    return row["name"].endswith("_cloud")


def _is_little_scaled(row: Row) -> bool:
    """Whether a scaled map is less than 5 % too large or too small."""
    return row["role"] == "scaled" and abs(row["factor"] - 1.0) < 0.05


def _is_named(row: Row) -> bool:
    """Whether the reason names what is wrong."""
    words = {
        "mirrored": ("mirrored",),
        "scaled": ("to be larger", "to be smaller"),
        "storey": ("storey",),
        "changed": ("moved",),
    }
    return any(word in row["reason"] for word in words.get(row["role"], ()))


def _met(is_met: bool) -> str:
    return "met" if is_met else "missed"


def _joined(cells: Sequence[str]) -> str:
    """What was measured and whether it is enough in one cell."""
    return ", ".join(cells) if cells[0] != "-" else "-"
