"""Reliability diagrams: the share of right poses against the confidence, of all buildings and of each family."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from bench.plots import wilson_interval
from bench.reliability import balance, calibration_error, confidences


def draw(rows: list[dict], path: Path) -> None:
    """Reliability diagram: share right against confidence, and how many pairs each bin holds."""
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
    plt.close(fig)


def draw_families(rows: list[dict[str, Any]], path: Path) -> None:
    """Write a PNG with a small reliability diagram for each family: pairs with free space, and clouds.

    Bars are 95 % intervals, and the areas of the dots grow with the numbers of pairs. What a peer calls valid stands at
    1, the rest at 0.
    """
    import matplotlib.pyplot as plt

    families = sorted({row["kind"] for row in rows})
    columns = min(5, len(families))
    lines = -(-len(families) // columns)
    figure, axes = plt.subplots(
        lines,
        columns,
        figsize=(2.6 * columns + 0.6, 2.7 * lines + 0.6),
        squeeze=False,
        sharex=True,
        sharey=True,
        layout="constrained",
    )
    for axis in axes.flat[len(families) :]:
        axis.axis("off")
    for axis, family in zip(axes.flat, families, strict=False):
        mine = [row for row in rows if row["kind"] == family]
        axis.plot([0, 1], [0, 1], "k:", lw=1)
        for is_cloud, label in ((False, "free space"), (True, "clouds")):
            _draw_bins(axis, [row for row in mine if row["name"].endswith("_cloud") == is_cloud], label)
        for number, peer in enumerate(dict.fromkeys(name for row in rows for name in row.get("peers", {}))):
            _draw_verdicts(axis, mine, peer, f"C{2 + number}")
        error = calibration_error(*confidences(mine))
        axis.set(xlim=(-0.05, 1.05), ylim=(-0.05, 1.05), xticks=(0, 0.5, 1), yticks=(0, 0.5, 1))
        axis.set_title(f"{family}: {len(mine)} pairs, error {error:.3f}", fontsize=9)
        axis.grid(alpha=0.3)
    figure.supxlabel("confidence")
    figure.supylabel("share of the best poses that are right")
    # Not every family need have all kinds of pairs.
    labelled = {
        label: mark
        for axis in axes.flat
        for mark, label in zip(*axis.get_legend_handles_labels(), strict=True)
    }
    figure.legend(labelled.values(), labelled, loc="outside upper center", ncols=len(labelled), fontsize=8)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=80)
    plt.close(figure)


def _draw_bins(axis, rows: Sequence[dict[str, Any]], label: str, bins: int = 10) -> None:
    confidence, is_right = confidences(rows)
    which = np.minimum((confidence * bins).astype(int), bins - 1)
    used = [which == k for k in range(bins) if (which == k).any()]
    if not used:
        return
    means = [confidence[mine].mean() for mine in used]
    shares = np.asarray([is_right[mine].mean() for mine in used])
    ends = [wilson_interval(int(is_right[mine].sum()), int(mine.sum())) for mine in used]
    # Rounding can leave the share a hair outside at 0 and 1.
    bars = np.maximum([shares - [low for low, _ in ends], [high for _, high in ends] - shares], 0.0)
    drawn = axis.errorbar(means, shares, yerr=bars, lw=1, elinewidth=0.6)
    sizes = [4 + 60 * mine.mean() for mine in used]
    axis.scatter(means, shares, s=sizes, color=drawn.lines[0].get_color(), label=label, zorder=3)


def _draw_verdicts(axis, rows: Sequence[dict[str, Any]], peer: str, color: str) -> None:
    """Crosses for what a peer calls valid, at 1, and for what it does not, at 0; nothing if it has no verdict."""
    said = [row["peers"][peer] for row in rows if row.get("peers", {}).get(peer, {}).get("valid") is not None]
    for is_valid, place in ((True, 1.0), (False, 0.0)):
        right = [answer["right"] for answer in said if answer["valid"] == is_valid]
        if not right:
            continue
        label = f"{peer}: valid at 1, not at 0" if is_valid else None
        axis.plot(place, np.mean(right), "x", color=color, label=label, zorder=4, clip_on=False)
