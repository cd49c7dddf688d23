"""Bytes of OctoMap files to leaves, and what it says beforehand about the memory that it takes."""

import tracemalloc

import numpy as np
import pytest

from oracles import octree as oracle
from voxjax import InputError, VoxelGrid
from voxjax.io.budget import Budget
from voxjax.io.octomap import encode_bt, encode_ot
from voxjax.io.octomap_leaves import leaves_of_bt, leaves_of_ot


def as_dict(leaves):
    return {
        (*key, level.depth): value
        for level in leaves.levels
        for key, value in zip(level.key.tolist(), level.value.tolist(), strict=True)
    }


def test_leaves_are_those_of_the_file():
    rng = np.random.default_rng(1)
    states = {(*(64 * key).tolist(), 16): 1 + int(key.sum() % 2) for key in rng.integers(0, 512, (50, 3))}
    states |= {(96, 64 * i + 32, 0, 11): 2 for i in range(9)} | {(32768, 0, 0, 1): 1}
    assert as_dict(leaves_of_bt(oracle.file_of(states))) == states
    odds = {key: state - 1.25 for key, state in states.items()}
    assert as_dict(leaves_of_ot(oracle.file_of(odds, with_log_odds=True))) == odds


def test_a_file_of_nothing_has_no_leaves():
    data = oracle.file_of({(0, 0, 0, 16): 2})
    empty = data[: data.index(b"data\n") + 5].replace(b"size 17", b"size 0")
    leaves = leaves_of_bt(empty)
    assert (leaves.levels, leaves.shape, leaves.resolution) == ([], (0, 0, 0), 0.1)


def test_what_a_map_holds_is_told_without_its_voxels():
    data = oracle.file_of({(0, 0, 0, 1): 1.0, (32768, 0, 0, 16): -1.0}, with_log_odds=True)
    tracemalloc.start()
    leaves = leaves_of_ot(data)
    assert leaves.count(np.uint8(2)) == 2**45
    assert leaves.shape == (32769, 32768, 32768)
    assert tracemalloc.get_traced_memory()[1] < 5_000_000
    tracemalloc.stop()


@pytest.mark.parametrize("kind", ["dense", "surface"])
def test_estimates_are_near_what_is_taken(monkeypatch, kind):
    asked = []
    monkeypatch.setattr(Budget, "excess", lambda self, need: asked.append(need))
    known = np.random.default_rng(0).integers(1, 3, (80, 80, 64)).astype(np.uint8)
    known = known.reshape(640, 640, 1) if kind == "surface" else known
    grid = VoxelGrid(known, np.full(3, 12.8), 0.1)
    for encode, read in ((encode_bt, leaves_of_bt), (encode_ot, leaves_of_ot)):
        data = encode(grid)
        asked.clear()
        tracemalloc.start()
        read(data)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert peak / 1.5 < max(asked) < 1.5 * peak


def test_a_tree_for_which_there_is_no_memory_is_refused(monkeypatch):
    monkeypatch.setenv("VOXJAX_MEMORY", "0.001")
    for ending, leaf, read in ((".bt", 2, leaves_of_bt), (".ot", 1.0, leaves_of_ot)):
        # The sums come before the structure: what follows the tree is not looked at.
        data = oracle.file_of({(0, 0, 0, 16): leaf}, with_log_odds=ending == ".ot") + bytes(5_000_000)
        with pytest.raises(
            InputError, match=r"the tree in the file needs about .* VOXJAX_MEMORY allows 0\.001 GB"
        ):
            read(data)
