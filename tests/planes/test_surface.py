"""Which elements of a surface touch, and the surface of maps in blocks and tiles."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.ops.blocks.boxes import random_boxes

from block_maps import turned_map, ways
from voxjax import VoxelGrid
from voxjax.planes.surface import find_surface, neighbour_pairs


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**31), st.floats(0.05, 0.9))
def test_pairs_are_all_voxels_that_touch(seed, share):
    index = np.argwhere(np.random.default_rng(seed).random((5, 4, 6)) < share).astype(np.int32)
    ours = {tuple(pair) for pair in neighbour_pairs(index).tolist()}
    gap = np.abs(index[:, None] - index[None]).max(axis=2) if len(index) else np.zeros((0, 0))
    assert ours == {(i, j) for i, j in np.argwhere(gap == 1).tolist() if i < j}


@pytest.mark.parametrize("kind", ["building", "boxes", "cloud"])
def test_the_surface_is_the_same_in_blocks_and_in_tiles(kind, monkeypatch):
    grid = turned_map()
    if kind == "boxes":
        grid = VoxelGrid(random_boxes((150, 70, 90), seed=2), np.zeros(3), 0.1)
    if kind == "cloud":
        grid = VoxelGrid(np.where(np.asarray(grid.states) == 1, np.uint8(0), grid.states), grid.origin, 0.1)
    first, *others = (find_surface(each) for each in ways(grid, monkeypatch))
    assert len(first.index) > 1000
    for other in others:
        for field in dataclasses.fields(first):
            np.testing.assert_array_equal(getattr(first, field.name), getattr(other, field.name))
