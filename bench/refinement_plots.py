"""Plots of the benchmark of refinement: basins side by side, and the errors of each suite."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from bench.refinement_table import CONVERGED_SHARE, MOST_DEGREES, MOST_VOXELS, Results, Row


def draw(results: Results, folder: Path) -> list[Path]:
    """Write refinement_basin.png and refinement_accuracy.png of the parts that are there.

    `bench.plots.prepare_plots` is to be called before.
    """
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    figures: tuple[tuple[str, Callable[[Sequence[Row], Path], None]], ...] = (
        ("accuracy", _draw_accuracy),
        ("basin", _draw_basin),
    )
    for part, draw_part in figures:
        if part in results:
            paths.append(folder / f"refinement_{part}.png")
            draw_part(results[part]["rows"], paths[-1])
    return paths


def _draw_basin(rows: Sequence[Row], path: Path) -> None:
    """One panel for each line of starts, one curve a method, the peers' dashed."""
    import matplotlib.pyplot as plt

    lines = list(dict.fromkeys(row["line"] for row in rows))
    figure, panels = plt.subplots(
        1, len(lines), figsize=(4.2 * len(lines), 4), sharey=True, layout="constrained"
    )
    for axes, line in zip(panels, lines, strict=True):
        for row in (row for row in rows if row["line"] == line):
            by_degrees = line == "rotation"
            x, shares = row["degrees" if by_degrees else "metres"], row["converged"]
            dashes = "-" if row["method"].startswith("voxjax") else "--"
            axes.plot(x, shares, dashes, marker="o", markersize=4, alpha=0.8, label=row["method"])
        unit = {"translation": "m", "rotation": "degrees", "both": "m, with 15 degrees a metre"}[line]
        axes.axhline(CONVERGED_SHARE, color="grey", linestyle=":", linewidth=1)
        axes.set(xlabel=f"error of the start [{unit}]", title=line, ylim=(-0.03, 1.03))
        axes.grid(alpha=0.3)
    panels[0].set_ylabel("share converged")
    panels[-1].legend(fontsize=8)
    figure.savefig(path, dpi=120)
    plt.close(figure)


def _draw_accuracy(rows: Sequence[Row], path: Path) -> None:
    """Medians as bars with a line to the 90th percentile, by suite and method; the targets as lines."""
    import matplotlib.pyplot as plt

    suites = list(dict.fromkeys(row["suite"] for row in rows))
    methods = list(dict.fromkeys(row["method"] for row in rows))
    figure, both = plt.subplots(1, 2, figsize=(11, 4), layout="constrained")
    wide = 0.8 / len(methods)
    panels: Any = zip(both, (("voxels", MOST_VOXELS), ("degrees", MOST_DEGREES)), strict=True)
    for axes, (key, target) in panels:
        for number, method in enumerate(methods):
            mine = {row["suite"]: row[key] for row in rows if row["method"] == method}
            places = [suites.index(s) + wide * (number - (len(methods) - 1) / 2) for s in mine]
            medians, tails = zip(*mine.values(), strict=True)
            upward = [tail - median for median, tail in zip(medians, tails, strict=True)]
            below = [0.0] * len(upward)
            axes.bar(places, medians, wide, yerr=[below, upward], capsize=2, ecolor="grey", label=method)
        place = suites.index("drift-free") if "drift-free" in suites else None
        if place is not None:
            axes.plot(
                [place - 0.45, place + 0.45], [target, target], color="black", linestyle="--", label="target"
            )
        axes.set_xticks(range(len(suites)), suites)
        axes.set_ylabel(f"error [{key}], median to 90th percentile")
        axes.grid(alpha=0.3, axis="y")
    both[0].legend(fontsize=8)
    figure.savefig(path, dpi=120)
    plt.close(figure)
