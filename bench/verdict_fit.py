"""Fit the model of the verdict on rows of `bench/calibration.py`, and say how well it does on folds left out.

    python -m bench calibration --seed 100000 --pairs 120 --hotels 75 --buildings 12 --out fit.json
    python -m bench verdict_fit fit.json [more.json ...]

Rows with free space and without are fitted apart (`registration/judging/verdict.py`): the first step by the scores and
supports of all leaders, the second, among rivals, by the area of their contradictions. Prints the coefficients beside
those in use, and for each kind of pair how many would be accepted, rightly and wrongly, with the coefficients of ten
folds each fitted without the fold that it judges; also with the true pose struck from the leaders: then nothing is
right.
"""

import argparse
import json
import sys
from pathlib import Path

import numpy as np
from scipy.optimize import minimize

from voxjax.registration.judging import conflict_pieces, verdict
from voxjax.registration.judging.judgement import Judgement
from voxjax.registration.judging.settings import VerdictConfig


def judgement_of(row: dict, *, without_truth: bool = False) -> tuple[Judgement, np.ndarray]:
    """The recorded leaders of a pair, and which of them are right."""
    leaders = [one for one in row["leaders"] if not (without_truth and one["right"])]

    def column(key: str) -> np.ndarray:
        return np.asarray([one[key] for one in leaders], np.float64)

    # The rows keep the support alone, so the information is one that has this support.
    least = column("support")[:, None] / 3.0
    information = (least + [0.0, 1.0, 1.0])[:, :, None] * np.eye(3)
    nothing = np.zeros(len(leaders))
    judged = Judgement(
        column("score"), nothing, nothing, information, column("contradiction"), column("shared")
    )
    return judged, np.asarray([one["right"] for one in leaders], bool)


def chances(judged: Judgement, *, first: np.ndarray, piece: float, has_free_space: bool) -> np.ndarray:
    """Probabilities as `verdict` gives them, with other coefficients: none, score, support; weight of pieces."""
    score, support = verdict.log_evidence(judged)
    utility = first[1] * score + first[2] * support
    is_rival = conflict_pieces.rivals(judged)
    if has_free_space and is_rival.any():
        within = VerdictConfig.rival_weight * score - piece * np.log1p(judged.pieces)
        within = np.where(is_rival, within, -np.inf)
        within = within - np.logaddexp.reduce(within)
        utility = np.where(is_rival, utility[is_rival].max() + within, utility)
    utility = np.concatenate([[first[0]], utility])
    shares = np.exp(utility - utility.max())
    return shares / shares.sum()


def fit(rows: list[dict], *, has_free_space: bool, ridge: float = 0.02) -> tuple[np.ndarray, float]:
    """Coefficients of greatest likelihood, drawn a little toward 0 by the weight `ridge` of their squares."""
    data = [judgement_of(row) for row in rows]

    def loss(x: np.ndarray) -> float:
        total = ridge * float((x**2).sum())
        for judged, is_right in data:
            p = chances(judged, first=x[:3], piece=x[3], has_free_space=has_free_space)
            # Far from the optimum a probability may round to 0, of which there is no logarithm.
            total -= float(np.log(max(p[int(np.argmax(is_right)) + 1 if is_right.any() else 0], 1e-12)))
        return total

    start = np.asarray([-5.0, 3.0, 0.5, 3.0])
    # The bounds hold the signs: more evidence never makes a pose less probable, whatever few rows may suggest.
    found = minimize(loss, start, method="L-BFGS-B", bounds=[(-50, 0), (0, 50), (0, 50), (0, 50)])
    return found.x[:3], float(found.x[3])


def judge_folds(
    rows: list[dict],
    *,
    has_free_space: bool,
    num_folds: int = 10,
    levels: tuple[float, ...] = (0.8, 0.85, 0.9, 0.95),
) -> list[str]:
    """Table of the pairs that would be accepted at some probabilities, by kind, on the folds left out."""
    found: list[tuple[str, float, bool]] = []
    for fold in range(num_folds):
        others = [row for number, row in enumerate(rows) if number % num_folds != fold]
        first, piece = fit(others, has_free_space=has_free_space)
        for row in rows[fold::num_folds]:
            for strike in (False, True) if row["rank"] is not None else (False,):
                judged, is_right = judgement_of(row, without_truth=strike)
                if len(is_right) == 0:
                    continue
                p = chances(judged, first=first, piece=piece, has_free_space=has_free_space)[1:]
                best = int(np.argmax(p))
                name = row["kind"] + (", true pose struck" if strike else "")
                found.append((name, float(p[best]), bool(is_right[best])))
    lines = []
    for name in sorted({one[0] for one in found}):
        mine = [one for one in found if one[0] == name]
        counts = [
            f"{level:g}: {sum(r and p >= level for _, p, r in mine)} / {sum(not r and p >= level for _, p, r in mine)}"
            for level in levels
        ]
        worst = max((p for _, p, r in mine if not r), default=0.0)
        lines.append(
            f"  {name} ({len(mine)}), right {sum(r for *_, r in mine)}; accepted right / wrong at {', '.join(counts)}; "
            f"wrong at most {worst:.3f}"
        )
    return lines


def main(argv: list[str]) -> int:
    """Fit and print."""
    parser = argparse.ArgumentParser(prog="python -m bench verdict_fit", description=__doc__)
    parser.add_argument("rows", type=Path, nargs="+", help="JSON files of bench calibration")
    args = parser.parse_args(argv)
    rows = [row for path in args.rows for row in json.loads(path.read_text())["rows"]]
    in_use = {True: verdict.WITH_FREE_SPACE, False: verdict.WITHOUT_FREE_SPACE}
    for has_free_space in (True, False):
        mine = [r for r in rows if r["leaders"] and r["has_free_space"] == has_free_space]
        if not mine:
            continue
        print(f"{'with' if has_free_space else 'without'} free space: {len(mine)} pairs")
        first, piece = fit(mine, has_free_space=has_free_space)
        print(f"  fitted none {first[0]:.2f}, score {first[1]:.2f}, support {first[2]:.2f}", end="")
        print(f", pieces {piece:.2f}" if has_free_space else "")
        print(f"  in use {in_use[has_free_space]}, pieces {VerdictConfig.rival_weight}")
        print("\n".join(judge_folds(mine, has_free_space=has_free_space)))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
