"""Outermost known voxels, of dense grids and of blocks, against all known voxels."""

import numpy as np
import pytest
from tests.ops.blocks.boxes import random_boxes
from tests.ops.resampling.test_stored import stored_arrays

from oracles.motions import random_pose, random_rotation
from voxjax.ops.blocks.block_array import BlockArray
from voxjax.ops.blocks.block_builder import blocks_of
from voxjax.ops.resampling.lattice import moved_bounds
from voxjax.ops.resampling.outermost import outermost, outermost_in_blocks


@pytest.mark.parametrize("seed", range(8))
def test_none_of_all_known_voxels_lies_farther_out(seed):
    rng = np.random.default_rng(seed)
    states = random_boxes((37, 25, 18), seed=seed, num_boxes=3, share=0.0005)
    directions = np.concatenate([random_rotation(rng), np.eye(3), -np.eye(3)])
    farthest = (directions @ np.argwhere(states).T).max(axis=1)
    for kept in (blocks_of(states), stored_arrays(states)):
        index = outermost(kept, directions)
        assert index.shape == directions.shape
        assert states[tuple(index.T)].all()
        np.testing.assert_allclose((directions * index).sum(axis=1), farthest, atol=1e-9)
    ends = outermost(states, directions)
    assert states[tuple(ends.T)].all()
    np.testing.assert_allclose((directions @ ends.T).max(axis=1), farthest, atol=1e-9)


@pytest.mark.parametrize("seed", range(20))
def test_bounds_of_blocks_are_those_of_the_dense_grid(seed):
    rng = np.random.default_rng(seed)
    states = random_boxes(tuple(rng.integers(1, 40, 3)), seed=seed, num_boxes=3)
    T, size = random_pose(rng), float(rng.choice([0.1, 0.05]))
    expected = moved_bounds(states, np.array([0.33, -2.0, 1.0]), 0.1, T, size)
    for kept in (blocks_of(states), stored_arrays(states)):
        found = moved_bounds(kept, np.array([0.33, -2.0, 1.0]), 0.1, T, size)
        np.testing.assert_array_equal(found, expected)


def test_blocks_of_many_layers_are_looked_at_in_pieces():
    table = np.zeros((40, 64, 64), np.int32)
    table[[3, 39], [5, 60], [60, 7]] = 1
    states = BlockArray(
        table, np.stack([np.zeros((8, 8, 8)), np.ones((8, 8, 8))]).astype(np.uint8), (320, 512, 512)
    )
    directions = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.5, 1.0]])
    index = outermost_in_blocks(states, directions)
    assert index[0, 0] == 319
    assert index[1, 0] == 24
    assert index[2].tolist()[1:] == [47, 487]


def test_nothing_known_has_none():
    nothing = np.zeros((9, 3, 2), np.uint8)
    for kept in (nothing, blocks_of(nothing), stored_arrays(nothing)):
        assert outermost(kept, np.eye(3)).shape == (0, 3)


def test_of_a_store_few_cubes_are_read():
    states = np.ones((160, 160, 16), np.uint8)
    stored, reads = stored_arrays(states), []

    def read(low, high):
        reads.append(low)
        return stored.read(low, high)

    assert outermost(stored._replace(read=read), np.array([[1.0, 1.0, 0.5], [-1.0, 0.3, 0.0]])).tolist() == [
        [159, 159, 15],
        [0, 159, 0],
    ]
    assert len(reads) == 2
