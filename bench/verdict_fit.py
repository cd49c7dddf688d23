"""Fit the model of the verdict on rows of `bench calibration --families`, each family left out once.

    python -m bench calibration --families 8 --seed 100000 --out fit.json
    python -m bench verdict_fit fit.json [more.json ...]

Pairs with free space and without are fitted apart (`registration/judging/verdict.py`). Prints the coefficients beside
those in use, and for each family how many pairs would be accepted, rightly and wrongly, with the coefficients fitted
on all other families, and the expected calibration error then. Mirrored and scaled maps are left out: what explains
them is tested by itself.
"""

import argparse
import json
import sys
from pathlib import Path

import numpy as np
from scipy.optimize import minimize
from scipy.special import expit

from bench.reliability import calibration_error
from bench.reports import markdown_table
from voxjax.registration.judging import verdict
from voxjax.registration.judging.settings import VerdictConfig
from voxjax.registration.judging.verdict import Coefficients, Standing

LEAST = Coefficients(none=-np.inf, strength=0.0, contrast=1.0, changed=0.0, crowd=0.0)
"""More evidence never makes a pose less probable, whatever few rows may suggest, and what stands out of chance counts
everywhere, even where the families at hand do not need it."""


def usable(rows: list[dict], *, has_free_space: bool) -> list[dict]:
    """Rows that the model is fitted on: those with poses of any strength, and without a cause of their own."""
    return [
        row
        for row in rows
        if row["evidence"] is not None
        and row["role"] not in ("mirrored", "scaled")
        and (row["free_space"] != "unknown") == has_free_space
    ]


def design(rows: list[dict]) -> tuple[np.ndarray, np.ndarray]:
    """What the coefficients weigh (n, 5), and whether one of the rivals is right (n,)."""
    settings = VerdictConfig()
    terms = [Standing(**row["evidence"]).terms(settings) for row in rows]
    return np.reshape(terms, (-1, 5)), np.asarray([row["is_group_right"] for row in rows], float)


def fit(terms: np.ndarray, is_right: np.ndarray, *, ridge: float = 0.05) -> Coefficients:
    """Coefficients of greatest likelihood, drawn a little toward 0 by the weight `ridge` of their squares."""

    def loss(x: np.ndarray) -> float:
        odds = terms @ x
        return float(np.sum(np.logaddexp(0.0, odds) - is_right * odds) + ridge * np.sum(x[1:] ** 2))

    found = minimize(loss, np.ones(5), method="L-BFGS-B", bounds=[(low, None) for low in LEAST])
    return Coefficients(*map(float, found.x))


def left_out(rows: list[dict]) -> list[tuple[str, ...]]:
    """For each family, by the fit on all others: what it would accept, and its calibration error.

    Returns:
        Family, pairs, those with a right pose among the rivals, those of them that would be accepted, accepted ones
        without, and the calibration error of the probability that one of the rivals is right.
    """
    table = []
    for family in sorted({row["kind"] for row in rows}):
        mine = [row for row in rows if row["kind"] == family]
        terms, is_right = design(mine)
        weights = fit(*design([row for row in rows if row["kind"] != family]))
        odds = terms @ np.asarray(weights)
        is_accepted = odds > np.log(VerdictConfig.min_confidence / (1.0 - VerdictConfig.min_confidence))
        counts = (
            len(mine),
            is_right.sum(),
            (is_accepted * is_right).sum(),
            (is_accepted * (1 - is_right)).sum(),
        )
        error = calibration_error(expit(odds), is_right)
        table.append((family, *(str(int(count)) for count in counts), f"{error:.3f}"))
    return table


def main(argv: list[str]) -> int:
    """Fit and print."""
    parser = argparse.ArgumentParser(prog="python -m bench verdict_fit", description=__doc__)
    parser.add_argument("rows", type=Path, nargs="+", help="JSON files of bench calibration --families")
    args = parser.parse_args(argv)
    rows = [row for path in args.rows for row in json.loads(path.read_text())["rows"]]
    in_use = {True: verdict.WITH_FREE_SPACE, False: verdict.WITHOUT_FREE_SPACE}
    for has_free_space in (True, False):
        mine = usable(rows, has_free_space=has_free_space)
        if not mine:
            continue
        print(f"{'with' if has_free_space else 'without'} free space: {len(mine)} pairs")
        print(f"  fitted {_shown(fit(*design(mine)))}")
        print(f"  in use {_shown(in_use[has_free_space])}")
        head = ("family left out", "pairs", "a rival is right", "accepted of these", "accepted, none right")
        head += ("calibration error",)
        print(markdown_table(head, left_out(mine)))
    return 0


def _shown(weights: Coefficients) -> str:
    return ", ".join(f"{name} {value:.2f}" for name, value in weights._asdict().items())


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
