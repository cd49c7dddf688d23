"""Map files of three formats: bytes, processor seconds and memory of writing and of reading, with and without log-odds.

    python -m bench stores [MAP ...] [--maps FOLDER] [--rounds N]

Each map is written as .bt, .npz and .zarr and read back whole; without names these are the two real maps of the folder
of test maps, or a generated one where that is not there. Seconds are of the processor, the least of a few rounds in
which the formats take turns; memory is the peak that Python and NumPy took beside the map, in a round of its own. A
store is also opened, which reads none of it, and written and read with log-odds, made from the states.

Takes about 20 s of the processor, on two cores.
"""

import argparse
import tempfile
import time
import tracemalloc
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

import voxjax as vx
from bench.cases import maps_folder
from bench.reports import markdown_table, write_json
from bench.timing import round_count, setting, turned
from voxjax.synthetic import simulate_team

FORMATS = (".bt", ".npz", ".zarr")


def map_row(name: str, grid: vx.VoxelGrid, folder: Path, rounds: int) -> dict:
    """Cost of one map in each format.

    Args:
        name: Of the map.
        grid: The map, in blocks.
        folder: Where files go.
        rounds: How often each is timed.
    """
    row: dict = {"map": name, "voxels": list(grid.shape), "occupied": grid.num_occupied}
    odds = np.array([0.0, -0.4, 0.85], np.float32)[np.asarray(grid.states)]
    with_odds = vx.VoxelGrid(grid.states, grid.origin, grid.voxel_size, odds)
    maps = {ending: grid for ending in FORMATS} | {"log_odds.zarr": with_odds}
    paths = {ending: folder / f"m{number}{ending}" for number, ending in enumerate(maps)}
    costs: dict = {ending: {"write [s]": [], "read [s]": [], "open [s]": []} for ending in maps}
    for turn in range(rounds + 1):
        for ending in turned(list(maps), turn):
            path, seconds = paths[ending], costs[ending]
            calls = {
                "write [s]": lambda path=path, given=maps[ending]: vx.write_map(path, given),
                "open [s]": lambda path=path: vx.read_map(path),
                "read [s]": lambda path=path: _whole(path),
            }
            for what, call in calls.items():
                if turn:
                    seconds[what].append(_busy(call))
                else:  # which also imports what is imported once
                    costs[ending][what.replace("[s]", "[MB]")] = _peak(call)
    for ending, cost in costs.items():
        cost["bytes"] = _size(paths[ending])
        for what in ("write [s]", "read [s]", "open [s]"):
            cost[what] = min(cost[what])
    return row | costs


def _whole(path: Path) -> None:
    """Read all of a map."""
    grid = vx.read_map(path)
    grid.state_blocks()
    grid.log_odds_blocks()


def _busy(call: Callable[[], object]) -> float:
    """Seconds of the processor, of all threads."""
    start = time.process_time()
    call()
    return time.process_time() - start


def _peak(call: Callable[[], object]) -> float:
    """Peak of what Python and NumPy allocate [MB], in a second call."""
    call()
    tracemalloc.start()
    call()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak / 1e6


def _size(path: Path) -> int:
    """Bytes of a file or of all files of a folder."""
    return sum(p.stat().st_size for p in ([path] if path.is_file() else path.rglob("*")) if p.is_file())


def table(rows: list[dict]) -> str:
    """Rows as a Markdown table, three lines for each map."""
    ends = [*FORMATS, "log_odds.zarr"]
    cells = []
    for row in rows:
        costs = [row[ending] for ending in ends]
        cells.append([f"`{row['map']}`, bytes", *(f"{cost['bytes']:,}" for cost in costs)])
        for what in ("write", "read"):
            line = [f"{cost[f'{what} [s]']:.2f} s, {cost[f'{what} [MB]']:.0f} MB" for cost in costs]
            cells.append([what, *line])
        # Of files there is nothing to open but the whole.
        opened = [f"{row[end]['open [s]']:.3f} s" if end.endswith("zarr") else "" for end in ends]
        cells.append(["open", *opened])
    return markdown_table(["", ".bt", ".npz", ".zarr", ".zarr with log-odds"], cells)


def maps_of(args: argparse.Namespace) -> Iterator[tuple[str, vx.VoxelGrid]]:
    """Names and maps."""
    paths = [Path(name) for name in args.map]
    folder = maps_folder(args.maps, is_wanted=not paths)
    if not paths and folder:
        paths = [folder / "real" / name for name in ("freiburg1_360.bt", "geb079.bt")]
    for path in paths:
        yield path.stem, vx.read_map(path)
    if not paths:
        grid = simulate_team(3).grids[0]
        yield "generated", vx.VoxelGrid(grid.state_blocks(), grid.origin, grid.voxel_size)


def main(argv: list[str]) -> int:
    """Print the table and write JSON."""
    parser = argparse.ArgumentParser(
        prog="python -m bench stores", description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("map", nargs="*", help="map files")
    parser.add_argument(
        "--maps", type=Path, help="folder of test maps; default: VOXJAX_MAPS or ../shared/maps"
    )
    parser.add_argument("--rounds", type=round_count, default=5)
    parser.add_argument("--out", type=Path, default=Path("bench/out/stores.json"))
    args = parser.parse_args(argv)
    print(setting(), flush=True)
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for name, grid in maps_of(args):
            rows.append(map_row(name, grid, Path(folder), args.rounds))
    for row in rows:
        print(f"{row['map']}: {' x '.join(map(str, row['voxels']))} voxels, {row['occupied']:,} occupied")
    print(table(rows))
    write_json(args.out, rows)
    return 0
