"""The benchmark of map files: a row for each map, a table of all."""

import json

import pytest

from bench import cliques, inferred_space, start, stores
from small_worlds import draw_map
from voxjax import VoxelGrid


def test_a_row_has_bytes_times_and_memory_of_each_format(tmp_path):
    grid = draw_map(voxel_size=0.4)
    row = stores.map_row(
        "room", VoxelGrid(grid.state_blocks(), grid.origin, grid.voxel_size), tmp_path, rounds=1
    )
    for ending in (*stores.FORMATS, "log_odds.zarr"):
        cost = row[ending]
        assert cost["bytes"] > 100
        assert cost["write [s]"] > 0
        assert cost["read [s]"] > 0
        assert cost["write [MB]"] > 0
    assert row["log_odds.zarr"]["bytes"] > row[".zarr"]["bytes"]
    json.dumps(row)
    lines = stores.table([row]).splitlines()
    assert lines[0] == "|  | .bt | .npz | .zarr | .zarr with log-odds |"
    assert lines[2].startswith(f"| `room`, bytes | {row['.bt']['bytes']:,} |")
    assert lines[5].startswith("| open |  |  | 0.")


@pytest.mark.parametrize("main", [stores.main, start.main, cliques.main, inferred_space.main])
@pytest.mark.parametrize("count", ["0", "-1"])
def test_without_rounds_there_is_nothing_to_measure(main, count, capsys):
    with pytest.raises(SystemExit, match="2"):
        main([f"--rounds={count}"])
    assert f"argument --rounds: must be 1 or more, got {count}" in capsys.readouterr().err
