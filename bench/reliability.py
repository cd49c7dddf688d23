"""Do the probabilities hold? Tables, calibration error and reliability diagram of rows of `bench/calibration.py`."""

from pathlib import Path

import numpy as np
from scipy.stats import beta, chi2


def calibration_error(confidence: np.ndarray, is_right: np.ndarray, bins: int = 10) -> float:
    """Expected calibration error: mean gap of confidence and share right over equal bins, weighted by count."""
    which = np.minimum((confidence * bins).astype(int), bins - 1)
    gaps = [abs(confidence[which == k].sum() - is_right[which == k].sum()) for k in range(bins)]
    return float(sum(gaps) / max(len(confidence), 1))


def upper_bound(events: int, trials: int) -> float:
    """Upper end of the 95 % interval of a rate (Clopper-Pearson, one-sided)."""
    return float(beta.ppf(0.95, events + 1, trials - events)) if events < trials else 1.0


def summary(rows: list[dict]) -> list[str]:
    """Table by kind, calibration, covariance, times."""
    lines = [
        "| pairs | right | in the first 5 | accepted and right | accepted and wrong (95 % bound of the rate) |"
    ]
    lines.append("|---|---|---|---|---|")
    names = {"pair": "one building", "hotel": "equal rooms", "cross": "different buildings"}
    for kind, name in names.items():
        mine = [r for r in rows if r["kind"] == kind]
        if not mine:
            continue
        accepted = [r for r in mine if r["verdict"] == "accepted"]
        wrong = sum(not r["right"] for r in accepted)
        near = sum(r["rank"] is not None and r["rank"] < 5 for r in mine)
        truth = f"{sum(r['right'] for r in mine)} | {near}" if kind != "cross" else "- | -"
        bound = f"{wrong} ({100 * upper_bound(wrong, len(mine)):.1f} %)"
        lines.append(f"| {name} ({len(mine)}) | {truth} | {len(accepted) - wrong} | {bound} |")
    confidence = np.asarray([r["confidence"] for r in rows])
    is_right = np.asarray([r["right"] for r in rows], float)
    lines.append(
        f"\nexpected calibration error {calibration_error(confidence, is_right):.3f} on {len(rows)} pairs"
    )
    balanced = balance(rows)
    lines.append(
        f"half of them of one building: {calibration_error(*balanced[:2]):.3f} on {len(balanced[0])} pairs"
    )
    nees = [
        float(np.asarray(r["tangent"]) @ np.linalg.solve(np.asarray(r["covariance"]), np.asarray(r["tangent"])))
        for r in rows if r["right"] and r["verdict"] == "accepted"
    ]  # fmt: skip
    if nees:
        inside = float(np.mean(np.asarray(nees) <= chi2.ppf(0.95, 6)))
        lines.append(
            f"normalised error squared of {len(nees)} accepted poses: mean {np.mean(nees):.2f} (6 if the covariance is "
            f"right), {100 * inside:.0f} % below the 95 % quantile"
        )
    right = [r for r in rows if r["right"] and r["kind"] == "pair"]
    if right:
        lines.append("error of the right poses of one building, median and 90th percentile: " + ", ".join(
            f"{np.median([r[k] for r in right]):.2f} and {np.percentile([r[k] for r in right], 90):.2f} {unit}"
            for k, unit in (("degrees", "deg"), ("metres", "m"))
        ))  # fmt: skip
    return lines


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


def draw(rows: list[dict], path: Path) -> None:
    """Reliability diagram: share right against confidence, and how many pairs each bin holds."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    confidence, is_right = balance(rows)
    which = np.minimum((confidence * 10).astype(int), 9)
    fig, (top, bottom) = plt.subplots(2, 1, figsize=(5, 6), height_ratios=(3, 1), sharex=True)
    used = [k for k in range(10) if (which == k).any()]
    top.plot([0, 1], [0, 1], "k:", lw=1)
    top.plot([confidence[which == k].mean() for k in used], [is_right[which == k].mean() for k in used], "o-")
    top.set_ylabel("share of the best poses that are right")
    bottom.bar((np.arange(10) + 0.5) / 10, np.bincount(which, minlength=10), width=0.09)
    bottom.set_xlabel("confidence")
    bottom.set_ylabel("pairs")
    fig.tight_layout()
    path.parent.mkdir(parents=True, exist_ok=True)
    fig.savefig(path, dpi=110)
