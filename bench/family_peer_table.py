"""A table of other systems beside voxjax on pairs of the families: what each accepted, and what it had right.

"Valid" of KISS-Matcher is its verdict; systems without one have what is right alone. Maps of nearly the same size (2 %
off) count neither as pairs of one place nor as others.
"""

from typing import Any, NamedTuple

import numpy as np

from bench.family_tables import is_negative
from bench.reliability import lower_bound, upper_bound
from bench.reports import markdown_table

Row = dict[str, Any]


class Answer(NamedTuple):
    """What a method said of one pair.

    Attributes:
        role: What the pair is.
        is_negative: Whether it has no true pose, nor nearly one.
        right: Whether its pose is right.
        accepted: Whether it says so; None where the method has no verdict.
        seconds: Time [s].
    """

    role: str
    is_negative: bool
    right: bool
    accepted: bool | None
    seconds: float


def peers_of(rows: list[Row]) -> list[str]:
    """Names of the peers that some row has an answer of."""
    return list(dict.fromkeys(name for row in rows for name in row.get("peers", {})))


def answers(rows: list[Row], peer: str | None) -> list[Answer]:
    """What a peer said of the pairs that it was given, or voxjax (None) of all."""
    found = []
    for row in rows:
        if peer is None:
            said = row["right"], row["verdict"] == "accepted", row["seconds"]
        elif peer in row.get("peers", {}):
            said = tuple(row["peers"][peer][key] for key in ("right", "valid", "seconds"))
        else:
            continue
        found.append(Answer(row["role"], is_negative(row), *said))
    return found


def peer_table(rows: list[Row]) -> str:
    """A table with a line for voxjax and each peer in each family, of the pairs that all of them were given."""
    peers = peers_of(rows)
    rows = [row for row in rows if all(peer in row.get("peers", {}) for peer in peers)]
    families = {row["kind"]: [other for other in rows if other["kind"] == row["kind"]] for row in rows}
    table = [
        (family, peer or "voxjax", *_cells(answers(mine, peer)))
        for family, mine in {**dict(sorted(families.items())), "all": rows}.items()
        for peer in (None, *peers)
    ]
    head = ("family", "system", "accepted without a true pose", "right of one place", "accepted of the right")
    return markdown_table((*head, "wrong accepts of one place", "seconds, median / 95 %"), table)


def _cells(said: list[Answer]) -> tuple[str, str, str, str, str]:
    """The figures of one system; those of verdicts are left out where it has none."""
    negatives = [answer for answer in said if answer.is_negative]
    place = [answer for answer in said if answer.role in ("same", "changed")]
    right = [answer for answer in place if answer.right]
    seconds = " / ".join(f"{value:.2g}" for value in np.percentile([s.seconds for s in said], (50, 95)))
    rightly = f"{len(right)} of {len(place)}" if place else "-"
    if any(answer.accepted is None for answer in said):
        return "-", rightly, "-", "-", seconds
    valid, wrong = _count(negatives), _count([answer for answer in place if not answer.right])
    most = upper_bound(valid, len(negatives)) if negatives else 1.0
    least = lower_bound(_count(right), len(right)) if right else 0.0
    return (
        f"{valid} of {len(negatives)} (<= {100 * most:.1f} %)" if negatives else "-",
        rightly,
        f"{_count(right)} of {len(right)} (>= {100 * least:.0f} %)" if right else "-",
        str(wrong) if place else "-",
        seconds,
    )


def _count(said: list[Answer]) -> int:
    return sum(bool(answer.accepted) for answer in said)
