"""Which elements of a surface touch, and the surface of maps in blocks and tiles."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.ops.blocks.boxes import random_boxes

from block_maps import far_apart, peak_of, turned_map, ways
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


def test_the_surface_of_two_maps_far_apart_takes_memory_for_these_and_not_for_the_box():
    room = turned_map()
    grid = far_apart(room)
    expected, (found, peak) = find_surface(room), peak_of(lambda: find_surface(grid))
    # The rows of the two are the same, one after the other among the fronts and among the backs.
    is_far = found.index[:, 0] >= 2048
    away = found.index[is_far] - expected.index
    np.testing.assert_array_equal(away, np.broadcast_to(away[0], away.shape))
    for part in (is_far, ~is_far):
        np.testing.assert_array_equal(found.normal[part], expected.normal)
        np.testing.assert_array_equal(found.is_signed[part], expected.is_signed)
    assert len(found.pairs) == 2 * len(expected.pairs)
    assert peak < 60e6 < grid.num_voxels / 50
