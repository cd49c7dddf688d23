"""Plots of the registration benchmark's rows: recall against overlap, and distribution of the errors."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from bench.summary import OVERLAP_BINS, Row, bin_label, in_bin, methods_of
from voxjax import InputError


def prepare_plots() -> None:
    """Choose a way of drawing that needs no screen; to be called before long work whose results are to be drawn.

    Raises:
        InputError: If matplotlib is not installed.
    """
    try:
        import matplotlib
    except ImportError as error:
        raise InputError('plots need matplotlib: pip install "voxjax[bench]".') from error
    matplotlib.use("Agg")


def draw_plots(rows: Sequence[Row], folder: Path) -> list[Path]:
    """Write `recall.png` and `errors.png` into the folder, which is made if it is missing."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = [folder / "recall.png", folder / "errors.png"]
    _draw_recall(rows, paths[0])
    _draw_errors(rows, paths[1])
    return paths


def wilson_interval(successes: int, trials: int) -> tuple[float, float]:
    """95 % interval of a share; (0, 1) without trials."""
    if not trials:
        return 0.0, 1.0
    z, share = 1.96, successes / trials
    centre = (share + z * z / (2 * trials)) / (1 + z * z / trials)
    half = z / (1 + z * z / trials) * np.sqrt(share * (1 - share) / trials + z * z / (4 * trials * trials))
    return float(centre - half), float(centre + half)


def error_curve(rows: Sequence[Row], key: str) -> tuple[np.ndarray, np.ndarray]:
    """Sorted errors of the pairs of one place, and the share of all of them within each; no pose is never within."""
    pairs = [row for row in rows if row["kind"] == "pair"]
    values = np.sort([np.inf if row[key] is None else row[key] for row in pairs])
    share = np.arange(1, len(values) + 1) / max(len(values), 1)
    return values[np.isfinite(values)], share[np.isfinite(values)]


def _draw_recall(rows: Sequence[Row], path: Path) -> None:
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
    methods = methods_of(rows)
    for number, method in enumerate(methods):
        places, shares, bars = [], [], []
        for place, (low, high) in enumerate(OVERLAP_BINS):
            mine = [r for r in rows if r["method"] == method and in_bin(r, low, high)]
            if not mine:
                continue
            right = sum(bool(r["right"]) for r in mine)
            share, interval = right / len(mine), wilson_interval(right, len(mine))
            places.append(place + 0.08 * (number - (len(methods) - 1) / 2))
            shares.append(share)
            # Rounding can leave the share a hair outside at 0 and 1.
            bars.append((max(share - interval[0], 0.0), max(interval[1] - share, 0.0)))
        if places:
            axes.errorbar(places, shares, yerr=np.transpose(bars), marker="o", capsize=3, label=method)
    axes.set_xticks(range(len(OVERLAP_BINS)), [bin_label(*limits) for limits in OVERLAP_BINS])
    axes.set(xlabel="overlap", ylabel="share of right poses, with 95 % interval", ylim=(-0.03, 1.03))
    _finish(figure, [axes], path)


def _draw_errors(rows: Sequence[Row], path: Path) -> None:
    import matplotlib.pyplot as plt

    figure, both = plt.subplots(1, 2, figsize=(9, 4), sharey=True, layout="constrained")
    for axes, key, unit in zip(both, ("degrees", "metres"), ("degrees", "m"), strict=True):
        for method in methods_of(rows):
            values, share = error_curve([r for r in rows if r["method"] == method], key)
            if len(values):
                axes.step(np.maximum(values, 1e-4), share, where="post", label=method)
        axes.set(xscale="log", xlabel=f"error [{unit}]", ylim=(0, 1.03))
    both[0].set_ylabel("share of the pairs of one place")
    _finish(figure, both, path)


def _finish(figure, all_axes, path: Path) -> None:
    import matplotlib.pyplot as plt

    for axes in all_axes:
        axes.grid(alpha=0.3)
        if axes.get_legend_handles_labels()[0]:
            axes.legend()
    figure.savefig(path, dpi=120)
    plt.close(figure)
