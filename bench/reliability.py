"""Do the probabilities hold? Tables and calibration error of rows of `bench/calibration.py`."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.stats import beta, chi2


def calibration_error(confidence: np.ndarray, is_right: np.ndarray, bins: int = 10) -> float:
    """Expected calibration error: mean gap of confidence and share right over equal bins, weighted by count."""
    which = np.minimum((confidence * bins).astype(int), bins - 1)
    gaps = [abs(confidence[which == k].sum() - is_right[which == k].sum()) for k in range(bins)]
    return float(sum(gaps) / max(len(confidence), 1))


def confidences(rows: Sequence[dict[str, Any]]) -> tuple[np.ndarray, np.ndarray]:
    """Confidence of each row (n,), and whether its first pose is right (n,) as 0 or 1."""
    return np.asarray([row["confidence"] for row in rows], float), np.asarray(
        [row["right"] for row in rows], float
    )


def error_of_exact(confidence: np.ndarray, draws: int = 200) -> float:
    """Calibration error in the mean of such pairs if each were right with the probability of its confidence.

    Few pairs fill bins unevenly, so that exact probabilities show an error as well.
    """
    drawn = np.random.default_rng(0).random((draws, len(confidence))) < confidence
    return float(np.mean([calibration_error(confidence, is_right) for is_right in drawn]))


def upper_bound(events: int, trials: int) -> float:
    """Upper end of the 95 % interval of a rate (Clopper-Pearson, one-sided)."""
    return float(beta.ppf(0.95, events + 1, trials - events)) if events < trials else 1.0


def lower_bound(events: int, trials: int) -> float:
    """Lower end of the 95 % interval of a rate (Clopper-Pearson, one-sided)."""
    return 1.0 - upper_bound(trials - events, trials)


def summary(rows: list[dict]) -> list[str]:
    """Lines for people and for Markdown: a table by kind, the calibration error, covariances, errors."""
    confidence, is_right = (np.asarray([r[key] for r in rows], float) for key in ("confidence", "right"))
    balanced = balance(rows)
    return [
        *_table(rows),
        f"\nexpected calibration error {calibration_error(confidence, is_right):.3f} on {len(rows)} pairs",
        f"half of them of one building: {calibration_error(*balanced):.3f} on {len(balanced[0])} pairs",
        *_covariance_lines([r for r in rows if r["right"] and r["verdict"] == "accepted"]),
        *_error_lines([r for r in rows if r["right"] and r["kind"] == "pair"]),
    ]


def _table(rows: list[dict]) -> list[str]:
    """A Markdown table with a row for each kind of pair."""
    head = (
        "pairs",
        "right",
        "in the first 5",
        "accepted and right",
        "accepted and wrong (95 % bound of the rate)",
    )
    lines = [f"| {' | '.join(head)} |", "|---" * len(head) + "|"]
    names = {"pair": "one building", "hotel": "equal rooms", "cross": "different buildings"}
    for kind, name in names.items():
        mine = [r for r in rows if r["kind"] == kind]
        if not mine:
            continue
        accepted = [r for r in mine if r["verdict"] == "accepted"]
        wrong = sum(not r["right"] for r in accepted)
        near = sum(r["rank"] is not None and r["rank"] < 5 for r in mine)
        # Maps of different buildings have no true pose that could be found.
        truth = f"{sum(r['right'] for r in mine)} | {near}" if kind != "cross" else "- | -"
        bound = f"{wrong} ({100 * upper_bound(wrong, len(mine)):.1f} %)"
        lines.append(f"| {name} ({len(mine)}) | {truth} | {len(accepted) - wrong} | {bound} |")
    return lines


def _covariance_lines(accepted: list[dict]) -> list[str]:
    """What the errors of accepted, right poses say about their covariances; nothing without such poses."""
    if not accepted:
        return []
    tangents, covariances = (np.asarray([r[key] for r in accepted]) for key in ("tangent", "covariance"))
    squared = np.einsum("ni,ni->n", tangents, np.linalg.solve(covariances, tangents[..., None])[..., 0])
    share = 100 * np.mean(squared <= chi2.ppf(0.95, 6))
    return [
        f"normalised error squared of {len(squared)} accepted poses: mean {squared.mean():.2f} (6 if the covariance "
        f"is right), {share:.0f} % below the 95 % quantile"
    ]


def _error_lines(right: list[dict]) -> list[str]:
    """The errors of right poses of one building; nothing without such poses."""
    if not right:
        return []
    texts = []
    for key, unit in (("degrees", "deg"), ("metres", "m")):
        median, most = np.percentile([r[key] for r in right], (50, 90))
        texts.append(f"{median:.2f} and {most:.2f} {unit}")
    return [f"error of the right poses of one building, median and 90th percentile: {', '.join(texts)}"]


def balance(rows: list[dict]) -> tuple[np.ndarray, np.ndarray]:
    """Confidence and truth of a set whose half is of one building: the others evenly thinned."""
    pairs = [r for r in rows if r["kind"] == "pair"]
    others = [r for r in rows if r["kind"] == "hotel"] + [r for r in rows if r["kind"] == "cross"]
    hotels = [r for r in others if r["kind"] == "hotel"]
    cross = [r for r in others if r["kind"] == "cross"]
    keep = max(len(pairs) - len(hotels), 0)
    chosen = np.unique(np.linspace(0, len(cross) - 1, min(keep, len(cross))).astype(int)) if cross else []
    rows = pairs + hotels + [cross[i] for i in chosen]
    return np.asarray([r["confidence"] for r in rows]), np.asarray([r["right"] for r in rows], float)
