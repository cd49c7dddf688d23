"""Results of the benchmark of refinement: the file that keeps them, targets, lines for people, Markdown.

The file holds, by part, what it ran on ("setting"), whether in the quick form ("quick"), and its "rows"; see
bench/refinement_parts.py. It lies in a folder of its own, for bench/results has files of kernels.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from bench.reports import markdown_table, rounded, write_json
from bench.timing import format_seconds
from voxjax import InputError

Row = dict[str, Any]
Results = dict[str, dict[str, Any]]

FOLDER = Path(__file__).parent / "results" / "refinement"
FILE = "refinement.json"

OURS = "voxjax, both ways"
"""The method that the targets are for: what `voxjax.register` runs."""

MOST_VOXELS, MOST_DEGREES = 0.3, 0.1
"""Targets of the medians on generated pairs without drift."""

CONVERGED_SHARE = 0.9
"""A basin is as wide as the largest error up to which so many converge."""


def read(path: Path) -> Results:
    """Results of all parts.

    Raises:
        InputError: If there is no such file.
    """
    if not path.exists():
        raise InputError(f"there is no file {path}; run the benchmark, or name its folder with --results.")
    return json.loads(path.read_text())


def write(path: Path, part: str, result: dict[str, Any]) -> None:
    """Put one part's results into the file; other parts stay."""
    results = (read(path) if path.exists() else {}) | {part: rounded(result)}
    write_json(path, results)


def lines_of(row: Row) -> list[str]:
    """A row of any part for people: its names, then its numbers."""
    if "covariance" not in row and "suite" in row:
        metres, degrees, seconds = row["metres"], row["degrees"], row["seconds"]
        return [
            f"{row['suite']:<11} {row['method']:<26} {row['num_poses']:>3} poses  {metres[0]:.4f} / {metres[1]:.4f} m"
            f"  {row['voxels'][0]:.3f} voxel  {degrees[0]:.3f} / {degrees[1]:.3f} deg"
            f"  converged {100 * row['converged']:3.0f} %  {format_seconds(seconds[0])}"
            f"  prepare {format_seconds(row['prepare_seconds'][0])}"
        ]
    if "line" in row:
        shares = " ".join(f"{100 * share:3.0f}" for share in row["converged"])
        return [f"{row['line']:<11} {row['method']:<26} {shares} %  wide {_width_text(row)}"]
    if "solver" in row:
        return [
            f"{row['solver']:<28} {_solver_text(row):>10} {'' if row['most'] is None else _met_text(row)}"
        ]
    if "covariance" in row:
        return [
            f"{row['suite']:<11} {row['covariance']:<13} {row['num_poses']:>3} poses  normalised error squared "
            f"{row['mean']:.2f} (median {row['median']:.2f}), below the 95 % quantile {100 * row['below_95']:.0f} %"
        ]
    return [", ".join(f"{name} {value}" for name, value in row.items())]


def width(row: Row) -> tuple[float, float]:
    """Largest start error (metres, degrees) of a basin row such that from it and all smaller ones 90 % converge."""
    reached = (0.0, 0.0)
    for metres, degrees, share in zip(row["metres"], row["degrees"], row["converged"], strict=True):
        if share < CONVERGED_SHARE:
            break
        reached = metres, degrees
    return reached


def targets(results: Results) -> list[tuple[str, str, bool]]:
    """The targets: a line for each with the text of what was measured, and whether it was met."""
    found = []
    accuracy = results.get("accuracy", {}).get("rows", [])
    for suite in dict.fromkeys(row["suite"] for row in accuracy):
        ours, peers = _split([row for row in accuracy if row["suite"] == suite])
        if ours is None:
            continue
        if suite == "drift-free":
            for key, most, unit in (("voxels", MOST_VOXELS, "voxel"), ("degrees", MOST_DEGREES, "degrees")):
                median = ours[key][0]
                found.append((f"{suite}: median <= {most:g} {unit}", f"{median:.3g}", median <= most))
        # A target beside peers is against the best of them, whichever that is for this figure.
        for key, unit in (("metres", "m"), ("degrees", "degrees")):
            for k, name in enumerate(("median", "90th percentile") if peers else ()):
                best = min(peers, key=lambda row, key=key, k=k: row[key][k])
                text = f"{ours[key][k]:.3g}, {best['method']} {best[key][k]:.3g}"
                is_met = ours[key][k] <= best[key][k]
                found.append((f"{suite}: {name} [{unit}] no worse than any peer's", text, is_met))
    basin = results.get("basin", {}).get("rows", [])
    for line in dict.fromkeys(row["line"] for row in basin):
        ours, peers = _split([row for row in basin if row["line"] == line])
        if ours is not None and peers:
            best = max(peers, key=width)
            text = f"{_width_text(ours)}, {best['method']} {_width_text(best)}"
            found.append((f"basin, {line}: as wide as any peer's", text, width(ours) >= width(best)))
    for row in results.get("solver", {}).get("rows", []):
        if row["most"] is not None:
            most = f"{row['most']:g} s" if row["unit"] == "seconds" else f"{row['most']:g} {row['unit']}"
            found.append((f"{row['solver']}: at most {most}", _solver_text(row), row["value"] <= row["most"]))
    return found


def markdown(results: Results) -> str:
    """Tables of accuracy, basin, covariances and targets, of the parts that are there."""
    parts = []
    if "accuracy" in results:
        rows = results["accuracy"]["rows"]
        head = (
            "pairs",
            "method",
            "error [m], median / 90 %",
            "voxels",
            "degrees, median / 90 %",
            "converged",
            "time",
            "preparation",
        )
        parts.append(markdown_table(head, [_accuracy_cells(row) for row in rows]))
    if "basin" in results:
        rows = results["basin"]["rows"]
        lines = list(dict.fromkeys(row["line"] for row in rows))
        by_method: dict[str, dict[str, Row]] = {}
        for row in rows:
            by_method.setdefault(row["method"], {})[row["line"]] = row
        cells = [[name, *(_width_text(mine[line]) for line in lines)] for name, mine in by_method.items()]
        parts.append(markdown_table((f"{100 * CONVERGED_SHARE:g} % converge up to", *lines), cells))
    if "covariance" in results:
        parts.append(_covariance_table(results["covariance"]["rows"]))
    judged = [[what, value, "met" if is_met else "missed"] for what, value, is_met in targets(results)]
    if judged:
        parts.append(markdown_table(("target", "measured", ""), judged))
    quick = [name for name, part in results.items() if part["quick"]]
    if quick:
        parts.append(f"In the quick form, on few pairs: {', '.join(quick)}.")
    return "\n\n".join(parts)


def _covariance_table(rows: Sequence[Row]) -> str:
    head = (
        "pairs",
        "covariance",
        "poses",
        "normalised error squared, mean / median",
        "below the 95 % quantile",
    )
    cells = [
        [
            row["suite"],
            row["covariance"],
            str(row["num_poses"]),
            f"{row['mean']:.2f} / {row['median']:.2f}",
            f"{100 * row['below_95']:.0f} %",
        ]
        for row in rows
    ]
    return markdown_table(head, cells)


def _solver_text(row: Row) -> str:
    return format_seconds(row["value"]) if row["unit"] == "seconds" else f"{row['value']:.2g} x"


def _met_text(row: Row) -> str:
    return "met" if row["value"] <= row["most"] else "missed"


def _accuracy_cells(row: Row) -> list[str]:
    return [
        f"{row['suite']} ({row['num_pairs']})",
        row["method"],
        f"{row['metres'][0]:.3f} / {row['metres'][1]:.3f}",
        f"{row['voxels'][0]:.2f}",
        f"{row['degrees'][0]:.3f} / {row['degrees'][1]:.3f}",
        f"{100 * row['converged']:.0f} %",
        format_seconds(row["seconds"][0]),
        format_seconds(row["prepare_seconds"][0]),
    ]


def _split(rows: Sequence[Row]) -> tuple[Row | None, list[Row]]:
    """Our row, and those of the peers."""
    ours = next((row for row in rows if row["method"] == OURS), None)
    return ours, [row for row in rows if not row["method"].startswith("voxjax")]


def _width_text(row: Row) -> str:
    metres, degrees = width(row)
    texts = [f"{metres:g} m"] * (row["metres"][-1] > 0.0) + [f"{degrees:g}°"] * (row["degrees"][-1] > 0.0)
    return ", ".join(texts)
