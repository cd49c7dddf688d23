"""`voxjax info`: what a map holds."""

import argparse
import json

from ..grid import VoxelGrid
from ..io import LoadedMap
from .maps import load_maps
from .streams import tell


def run(args: argparse.Namespace) -> int:
    """Print what each map holds and return the exit code."""
    # All maps are read before the first word: half an answer would look like a whole one.
    maps = load_maps(args, args.maps)
    facts = [(path, loaded_facts(loaded)) for path, loaded in zip(args.maps, maps, strict=True)]
    if args.json:
        print(json.dumps([{"path": path, **entry} for path, entry in facts], indent=1, allow_nan=False))
        return 0
    for path, entry in facts:
        tell(path)
        for line in _lines(entry):
            tell(f"  {line}")
    return 0


def loaded_facts(loaded: LoadedMap) -> dict:
    """What `map_facts` says of a map that was read, and "remarks": what a person should know about it."""
    return {**map_facts(loaded.grid), "remarks": [remark.as_dict() for remark in loaded.remarks]}


def map_facts(grid: VoxelGrid) -> dict:
    """Counts, extents [m], voxel size [m], shares and memory [byte] of a map."""
    low, high = grid.extent
    total = grid.shape[0] * grid.shape[1] * grid.shape[2]
    counts = {"occupied": grid.num_occupied, "free": grid.num_free}
    counts["unknown"] = total - counts["occupied"] - counts["free"]
    return {
        "voxel_size": grid.voxel_size,
        "shape": list(grid.shape),
        "low": [round(float(value), 4) for value in low],
        "high": [round(float(value), 4) for value in high],
        "counts": counts,
        # A map may have no voxel at all, and then has no share of anything.
        "shares": {name: count / max(total, 1) for name, count in counts.items()},
        "log_odds": grid.log_odds is not None,
        "memory_bytes": grid.states.nbytes + (0 if grid.log_odds is None else grid.log_odds.nbytes),
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
    lines.append(f"{entry['memory_bytes'] / 1e6:.1f} MB in memory, {odds}")
    return lines + [f"{remark['text']}." for remark in entry["remarks"]]
