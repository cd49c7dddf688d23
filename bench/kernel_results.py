"""Results of `python -m bench kernels` as JSON, one file per kind of device, and what is made of them."""

import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from pathlib import Path

from bench.kernel_row import KernelRow
from bench.reports import markdown_table, rounded, write_json
from bench.timing import Timing, format_seconds

FOLDER = Path(__file__).parent / "results"
LARGEST_FALL = 0.3
"""Share that a ratio may lose against the committed one before the gate fails."""


def result_of(
    row: KernelRow, timings: Sequence[Timing], limit: float, setting: dict[str, str], quick: bool
) -> dict:
    """One row as plain data, judged.

    Args:
        row: The kernel and what it is compared with.
        timings: Times of the row's candidates.
        limit: Bytes per second of a widening copy in the same rounds.
        setting: Device, allocator and versions that it ran on.
        quick: Whether the benchmark ran in its quick form.

    Returns:
        Times [s], ratios to the references, bytes per second, share of the limit and what was met.
    """
    times = {t.name: {k: v for k, v in asdict(t).items() if k != "name"} for t in timings}
    ours = times[row.ours]["median_s"]
    targets = [
        {"reference": t.reference, "at_least": t.ratio, "ratio": times[t.reference]["median_s"] / ours}
        for t in row.targets
        if t.reference in times
    ]
    nanoseconds = 1e9 * ours / max(row.count, 1)
    rate = row.bytes_moved / ours
    temporary = None if row.temporary_bytes is None else row.temporary_bytes / max(row.count, 1)
    met = [t["ratio"] >= t["at_least"] for t in targets]
    met += [nanoseconds <= row.max_ns] if row.max_ns else []
    met += [temporary <= row.max_temporary] if row.max_temporary and temporary is not None else []
    return {
        "name": row.name,
        "quick": quick,
        "setting": setting,
        "ours": row.ours,
        "unit": row.unit,
        "count": row.count,
        "seconds": ours,
        "ns_per_item": nanoseconds,
        "max_ns": row.max_ns,
        "first_call_s": times[row.ours]["first_s"],
        "bytes_per_s": rate,
        "share_of_limit": rate / limit if rate and limit else None,
        "temporary_per_item": temporary,
        "max_temporary": row.max_temporary,
        "targets": targets,
        "met": all(met) if met else None,
        "times": times,
        "note": row.note,
    }


def lines_of(result: dict) -> list[str]:
    """A result for people."""
    name = result["name"]
    verdict = {True: "met", False: "MISSED", None: "no target"}[result["met"]]
    lines = [f"\n{name}   [{verdict}]" + (f"   {result['note']}" if result["note"] else "")]
    for candidate, time in result["times"].items():
        mark = "*" if candidate == result["ours"] else " "
        spread = f"({format_seconds(time['low_s'])} .. {format_seconds(time['high_s'])})"
        ratio = time["median_s"] / result["seconds"]
        lines.append(
            f" {mark} {candidate:<40} {format_seconds(time['median_s']):>9} {spread:<22} {ratio:8.2f} x ours   "
            f"first call {time['first_s']:.2f} s"
        )
    facts = [f"{result['ns_per_item']:.3g} ns per {result['unit']}"]
    if result["max_ns"]:
        facts[0] += f" (target <= {result['max_ns']:g})"
    if result["share_of_limit"] is not None:
        share = 100 * result["share_of_limit"]
        facts.append(f"{result['bytes_per_s'] / 1e9:.2f} GB/s, {share:.0f} % of a widening copy")
    if result["temporary_per_item"] is not None:
        bound = f" (target <= {result['max_temporary']:g})" if result["max_temporary"] else ""
        facts.append(f"temporary {result['temporary_per_item']:.2f} B per {result['unit']}{bound}")
    lines.append("   " + "; ".join(facts))
    for target in result["targets"]:
        word = "met" if target["ratio"] >= target["at_least"] else "MISSED"
        lines.append(
            f"   {target['ratio']:.2f} x {target['reference']}, target {target['at_least']:g}: {word}"
        )
    return lines


def read(path: Path) -> list[dict]:
    """Results of a file; none where it does not exist."""
    return json.loads(path.read_text())["rows"] if path.exists() else []


def read_all(folder: Path) -> list[list[dict]]:
    """Results of all kinds of devices, one list for each file of a folder and of the folder "gpu" in it.

    `bench/on_gpu.sh` fills the latter, with files of other benchmarks too: they are left out.
    """
    paths = [*sorted(folder.glob("*.json")), *sorted((folder / "gpu").glob("*.json"))]
    contents = [json.loads(path.read_text()) for path in paths]
    rows = [content.get("rows") for content in contents if isinstance(content, dict)]
    return [found for found in rows if found and "ns_per_item" in found[0]]


def write(path: Path, results: Iterable[dict]) -> None:
    """Write results, those of other rows or allocators that are in the file kept."""
    rows = {_key(r): r for r in read(path)} | {_key(r): rounded(r) for r in results}
    write_json(path, {"rows": [rows[key] for key in sorted(rows)]})


def falls(results: Iterable[dict], baseline: Iterable[dict]) -> list[str]:
    """One line for each ratio to a reference that is more than `LARGEST_FALL` below that of the baseline."""
    before = {_key(r): {t["reference"]: t["ratio"] for t in r["targets"]} for r in baseline}
    lines = []
    for result in results:
        for target in result["targets"]:
            old = before.get(_key(result), {}).get(target["reference"])
            if old and target["ratio"] < (1.0 - LARGEST_FALL) * old:
                name = f"{result['name']} ({result['setting']['allocator']} allocator)"
                lines.append(f"{name}: {target['ratio']:.2f} x {target['reference']}, was {old:.2f}")
    return lines


def table(results: Sequence[dict]) -> str:
    """Markdown table of the results of one device, full runs before quick ones."""
    if not results:
        return "not yet measured"
    head = [
        "kernel",
        "allocator",
        "time",
        "per item",
        "against",
        "share of a widening copy",
        "temporary",
        "target",
    ]
    rows = []
    for r in sorted(results, key=lambda r: (r["quick"], r["name"], r["setting"]["allocator"])):
        against = [f"{t['ratio']:.2g} x {t['reference']} (>= {t['at_least']:g})" for t in r["targets"]]
        share, temporary = r["share_of_limit"], r["temporary_per_item"]
        rows.append(
            [
                r["name"],
                r["setting"]["allocator"],
                format_seconds(r["seconds"]),
                f"{r['ns_per_item']:.3g} ns",
                "<br>".join(against) or "-",
                "-" if share is None else f"{100 * share:.0f} %",
                "-" if temporary is None else f"{temporary:.2f} B",
                {True: "met", False: "missed", None: "-"}[r["met"]],
            ]
        )
    return markdown_table(head, rows)


def _key(result: dict) -> tuple[str, str]:
    """Name and allocator, which tell results of one device apart."""
    return result["name"], result["setting"]["allocator"]
