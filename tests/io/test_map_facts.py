"""Figures of maps: of leaves as of the dense grid, and at what cost."""

import tracemalloc

import numpy as np
import pytest

import voxjax as vx
from oracles import octree as oracle
from voxjax.io import describe_map, load_map
from voxjax.io.map_facts import facts_of_grid, facts_of_leaves
from voxjax.io.octomap_leaves import leaves_of_bt


def states(seed=0):
    coarse = np.random.default_rng(seed).integers(0, 3, (4, 3, 2)).astype(np.uint8)
    return coarse.repeat(4, 0).repeat(4, 1).repeat(4, 2)


@pytest.mark.parametrize("ending", [".bt", ".ot", ".npz"])
@pytest.mark.parametrize("options", [{}, {"crop": ((0, 0, 0), (1.0, 0.7, 0.9))}, {"voxel_size": 0.5}])
def test_figures_and_remarks_are_those_of_the_map_that_is_read(tmp_path, ending, options):
    path = tmp_path / f"m{ending}"
    vx.write_map(path, vx.VoxelGrid(states(), np.array([-0.4, 0.2, 0.0]), 0.1))
    described, loaded = describe_map(path, **options), load_map(path, **options)
    grid, facts = loaded.grid, described.facts
    assert described.remarks == loaded.remarks
    assert facts.shape == grid.shape
    assert (facts.num_occupied, facts.num_free) == (grid.num_occupied, grid.num_free)
    np.testing.assert_allclose(np.stack([facts.low, facts.high]), np.stack(grid.extent), atol=1e-6)
    assert facts.voxel_size == grid.voxel_size
    assert facts.num_voxels == grid.states.size
    assert facts.num_bytes == grid.states.nbytes + (0 if grid.log_odds is None else grid.log_odds.nbytes)
    assert facts == facts_of_grid(grid)._replace(low=facts.low, high=facts.high)


@pytest.mark.parametrize("drop_isolated", [False, True])
def test_isolated_pieces_are_said_of_leaves_too(tmp_path, drop_isolated):
    path = tmp_path / "m.bt"
    room = {(33000 + i, 33000 + j, 33000, 16): 2 for i in range(20) for j in range(20)}
    path.write_bytes(oracle.file_of(room | {(33000, 65000, 33000, 16): 2}))
    described = describe_map(path, drop_isolated=drop_isolated)
    assert [remark.code for remark in described.remarks] == ["isolated"]
    assert described.facts.shape == ((20, 20, 1) if drop_isolated else (20, 32001, 1))


def test_a_map_of_nothing_is_one_unknown_voxel():
    data = oracle.file_of({(0, 0, 0, 16): 2})
    facts = facts_of_leaves(leaves_of_bt(data[: data.index(b"data\n") + 5].replace(b"size 17", b"size 0")))
    assert (facts.shape, facts.num_occupied, facts.num_free) == ((1, 1, 1), 0, 0)
    assert facts.low.tolist() == [0, 0, 0]
    assert facts.high.tolist() == [0.1] * 3


def test_what_a_file_of_one_wide_leaf_holds_is_told_at_no_cost(tmp_path, monkeypatch):
    monkeypatch.setenv("VOXJAX_MEMORY", "off")
    path = tmp_path / "m.ot"
    path.write_bytes(oracle.file_of({(0, 0, 0, 6): 1.0}, with_log_odds=True))
    tracemalloc.start()
    facts = describe_map(path).facts
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert facts.num_occupied == facts.num_voxels == 2**30
    assert facts.num_bytes == 5 * 2**30
    assert peak < 5_000_000
