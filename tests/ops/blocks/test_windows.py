"""Windows and tiles of block arrays against slices of dense ones."""

import numpy as np
import pytest
from tests.ops.blocks.boxes import random_boxes

from voxjax.ops.blocks.block_builder import blocks_of
from voxjax.ops.blocks.windows import cut_out, cut_tiles, tile_rows


@pytest.mark.parametrize("shape", [(1, 1, 1), (17, 23, 9), (40, 8, 31), (64, 33, 64)], ids=str)
def test_a_part_that_is_cut_out_is_the_slice_of_the_dense_array(shape):
    rng, dense = np.random.default_rng(5), random_boxes(shape, seed=4)
    blocks = blocks_of(dense)
    for _ in range(20):
        low = np.array([rng.integers(0, n) for n in shape])
        high = np.array([rng.integers(a, n) + 1 for a, n in zip(low, shape, strict=True)])
        part = cut_out(blocks, low, high)
        expected = dense[tuple(map(slice, low, high))]
        np.testing.assert_array_equal(part.dense(), expected)
        values = part.pool[part.is_uniform, 0, 0, 0]
        assert len(np.unique(values)) == len(values)
        assert part.equals(blocks_of(expected))


def test_the_whole_is_not_copied():
    blocks = blocks_of(random_boxes((17, 23, 9), seed=4))
    assert cut_out(blocks, np.zeros(3, int), np.array(blocks.shape)) is blocks


def test_wide_space_of_one_value_is_not_taken_apart():
    dense = np.ones((128, 128, 128), np.uint8)
    part = cut_out(blocks_of(dense), np.array([3, 5, 1]), np.array([123, 125, 121]))
    # Zeros and ones: the part is as wide as whole blocks are.
    assert len(part.pool) == 2
    assert part.count(1) == 120**3


def test_tiles_fill_the_box_once_and_hold_their_halo():
    shape, halo = (300, 70, 130), 5
    tiles = cut_tiles(shape, halo=halo, most=1 << 18)
    covered = np.zeros(shape, np.uint8)
    for tile in tiles:
        window = tuple(slice(a, b) for a, b in zip(tile.low, tile.high, strict=True))
        covered[window] += 1
        np.testing.assert_array_equal(tile.outer_low, np.maximum(tile.low - halo, 0))
        np.testing.assert_array_equal(tile.outer_high, np.minimum(tile.high + halo, shape))
        outer = covered[tuple(slice(a, b) for a, b in zip(tile.outer_low, tile.outer_high, strict=True))]
        assert outer[tile.inner].shape == covered[window].shape
    assert len(tiles) > 4
    assert (covered == 1).all()


def test_a_small_box_is_one_tile_and_all_rows_are_its():
    tiles = cut_tiles((30, 40, 50), halo=5)
    (only, rows), *others = tile_rows(tiles, np.zeros((3, 3), np.int32))
    assert not others
    assert rows == slice(None)
    np.testing.assert_array_equal(only.outer_high, (30, 40, 50))


def test_rows_of_a_list_are_those_of_the_tiles_they_lie_in():
    shape, rng = (300, 70, 130), np.random.default_rng(0)
    index = np.stack([rng.integers(0, n, 500) for n in shape], axis=1)
    # A corner of the box alone is filled, so that tiles without a voxel are left out.
    index = index[(index < (200, 70, 60)).all(axis=1)]
    seen = np.zeros(len(index), int)
    for tile, rows in tile_rows(cut_tiles(shape, halo=2, most=1 << 18), index):
        assert isinstance(rows, np.ndarray)
        assert ((index[rows] >= tile.low) & (index[rows] < tile.high)).all()
        assert len(rows)
        assert (np.diff(rows) > 0).all()
        seen[rows] += 1
    assert (seen == 1).all()
