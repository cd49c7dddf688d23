"""`voxjax info`: what a map holds."""

import argparse
import json

from ..io import DescribedMap, describe_map
from .maps import one_box_for_all, reading_options
from .streams import tell


def run(args: argparse.Namespace) -> int:
    """Print what each map holds and return the exit code."""
    # All maps are read before the first word: half an answer would look like a whole one.
    with one_box_for_all(args.maps):
        facts = [(path, described_facts(describe_map(path, **reading_options(args)))) for path in args.maps]
    if args.json:
        print(json.dumps([{"path": path, **entry} for path, entry in facts], indent=1, allow_nan=False))
        return 0
    for path, entry in facts:
        tell(path)
        for line in _lines(entry):
            tell(f"  {line}")
    return 0


def described_facts(described: DescribedMap) -> dict:
    """Counts, extents [m], voxel size [m], shares and memory [byte] of a map, and "remarks" about it.

    "memory_bytes" are those of dense arrays of the whole box, "kept_bytes" those of what is kept; null for a store.
    """
    facts = described.facts
    counts = {"occupied": facts.num_occupied, "free": facts.num_free}
    counts["unknown"] = facts.num_voxels - sum(counts.values())
    return {
        "voxel_size": facts.voxel_size,
        "shape": list(facts.shape),
        "low": [round(float(value), 4) for value in facts.low],
        "high": [round(float(value), 4) for value in facts.high],
        "counts": counts,
        # A map may have no voxel at all, and then has no share of anything.
        "shares": {name: count / max(facts.num_voxels, 1) for name, count in counts.items()},
        "log_odds": facts.has_log_odds,
        "memory_bytes": facts.num_bytes,
        "kept": described.kept.form,
        "kept_bytes": described.kept.num_bytes,
        "remarks": [remark.as_dict() for remark in described.remarks],
    }


def _lines(entry: dict) -> list[str]:
    size = " x ".join(map(str, entry["shape"]))
    box = ", ".join(
        f"{axis} {low:.2f} to {high:.2f}"
        for axis, low, high in zip("xyz", entry["low"], entry["high"], strict=True)
    )
    lines = [f"{size} voxels of {entry['voxel_size']:g} m", f"{box} m"]
    for name, count in entry["counts"].items():
        lines.append(f"{name:<9}{count:>14,}  {100 * entry['shares'][name]:5.1f} %")
    odds = "with log-odds" if entry["log_odds"] else "no log-odds"
    lines.append(f"{_memory(entry)}, {odds}")
    return lines + [f"{remark['text']}." for remark in entry["remarks"]]


def _memory(entry: dict) -> str:
    """What a map takes as it is kept, and what dense arrays would take."""
    dense, size = f"{entry['memory_bytes'] / 1e6:,.1f} MB as dense arrays", entry["kept_bytes"]
    if entry["kept"] == "dense":
        return f"{dense}, as it is kept"
    kept = "kept in its store and read as needed" if entry["kept"] == "store" else "kept in blocks"
    kept = kept if size is None else f"{size / 1e6:,.1f} MB in blocks, as it is kept"
    return f"{kept} ({dense})"
