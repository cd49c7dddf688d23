"""What maps take in memory, of grids as of the leaves that they are made of."""

import tracemalloc

import numpy as np
import pytest

import voxjax as vx
from oracles import octree as oracle
from voxjax.io import describe_map
from voxjax.io.budget import Budget
from voxjax.io.kept_memory import KeptMemory, memory_of_grid, memory_of_leaves
from voxjax.io.octomap_leaves import leaves_of_ot


def grid_of(seed, shape=(40, 37, 21), low=(-3, 5, 0)):
    """Random states with whole blocks of one state among them, off the borders of the file's blocks."""
    rng = np.random.default_rng(seed)
    states = rng.integers(0, 3, shape).astype(np.uint8)
    states[8:32, 3:30, 2:19] = 1
    states[rng.random(shape) < 0.3] = 0
    states[10:30, 5:28, 4:16] = 2
    return vx.VoxelGrid(states, 0.1 * np.asarray(low), 0.1)


@pytest.mark.parametrize("ending", [".bt", ".ot"])
@pytest.mark.parametrize("seed", range(3))
def test_leaves_tell_what_the_grid_in_blocks_takes(tmp_path, ending, seed):
    path = tmp_path / f"m{ending}"
    vx.write_map(path, grid_of(seed))
    told = describe_map(path).kept
    found = memory_of_grid(vx.read_map(path))
    assert told == found
    assert told.form == "blocks"
    assert told.num_bytes is not None
    assert told.num_bytes > 0


@pytest.mark.parametrize("ending", [".bt", ".ot"])
def test_many_blocks_are_counted_without_a_table_of_the_box(tmp_path, ending):
    path = tmp_path / f"m{ending}"
    far = {(30_000 + 9 * i, 40_000, 32_000 + i, 16): 2 for i in range(400)}
    path.write_bytes(oracle.file_of(far | {(40_000, 60_000, 33_000, 16): 2}))
    if ending == ".ot":
        values = {key: 1.0 for key in far} | {(40_000, 60_000, 33_000, 16): -1.0}
        path.write_bytes(oracle.file_of(values, with_log_odds=True))
    tracemalloc.start()
    told = describe_map(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert told.kept.num_bytes == memory_of_grid(vx.read_map(path)).num_bytes
    # The box has twenty thousand million voxels, a table of its blocks 160 MB.
    assert told.facts.num_bytes > 1e10
    assert peak < 5e6


def test_dense_arrays_and_stores_are_named(tmp_path):
    grid = grid_of(0)
    assert memory_of_grid(grid) == KeptMemory("dense", grid.num_voxels)
    vx.write_map(tmp_path / "m.zarr", grid)
    assert describe_map(tmp_path / "m.zarr").kept == KeptMemory("store", None)
    vx.write_map(tmp_path / "m.npz", grid)
    assert describe_map(tmp_path / "m.npz").kept.form == "dense"


def test_a_few_wide_leaves_across_the_borders_of_blocks_are_not_cut_for_a_figure():
    data = oracle.file_of({(1, 1, 1, 16): 1.0, (1 << 15, 1 << 15, 1 << 15, 1): 1.0}, with_log_odds=True)
    leaves = leaves_of_ot(data, Budget(len(data)))
    assert memory_of_leaves(leaves, Budget(len(data))) == KeptMemory("blocks", None)
