"""`BlockArray` against the dense array that it stands for."""

import jax
import numpy as np
import pytest
from tests.ops.blocks.boxes import random_boxes

from voxjax import InputError
from voxjax.ops.blocks.block_array import BlockArray, BlockBuilder, blocks_of

SHAPES = ((1, 1, 1), (8, 8, 8), (17, 23, 9), (40, 8, 31), (0, 5, 3), (9, 33, 64))


@pytest.fixture(params=SHAPES, ids=str)
def dense(request):
    return random_boxes(request.param, seed=3)


def check_invariants(blocks: BlockArray):
    assert not blocks.pool[0].any()
    values = blocks.pool[blocks.is_uniform, 0, 0, 0]
    assert len(np.unique(values)) == len(values)


def test_blocks_stand_for_the_dense_array(dense):
    blocks = blocks_of(dense)
    check_invariants(blocks)
    np.testing.assert_array_equal(blocks.dense(), dense)
    np.testing.assert_array_equal(np.asarray(blocks), dense)
    assert blocks.dtype == dense.dtype
    assert blocks.num_voxels == dense.size


def test_voxels_of_a_value_are_counted_and_listed_in_lexicographic_order(dense):
    blocks = blocks_of(dense)
    for value in (1, 2, 3):
        assert blocks.count(value) == np.count_nonzero(dense == value)
        np.testing.assert_array_equal(blocks.where(value), np.argwhere(dense == value))


def test_blocks_that_are_not_zero_are_listed(dense):
    blocks = blocks_of(dense)
    np.testing.assert_array_equal(blocks.places(), np.argwhere(np.asarray(blocks.table) != 0))
    assert blocks.uses.tolist() == [np.count_nonzero(blocks.table == row) for row in range(len(blocks.pool))]


def test_windows_are_those_of_the_dense_array_and_zero_beyond_it(dense):
    blocks, rng, margin = blocks_of(dense), np.random.default_rng(0), 80
    padded = np.pad(dense, margin)
    for _ in range(20):
        low = rng.integers(-20, 40, 3)
        high = low + rng.integers(0, 40, 3)
        expected = padded[tuple(slice(a + margin, b + margin) for a, b in zip(low, high, strict=True))]
        np.testing.assert_array_equal(blocks.window(low, high), expected)


def test_single_voxels_are_looked_up(dense):
    if not dense.size:
        return
    rng = np.random.default_rng(0)
    index = np.stack([rng.integers(0, n, 50) for n in dense.shape], axis=1)
    np.testing.assert_array_equal(blocks_of(dense).take(index), dense[tuple(index.T)])


def test_the_box_around_what_is_not_zero(dense):
    low, high = blocks_of(dense).known_box()
    known = np.argwhere(dense)
    np.testing.assert_array_equal(low, known.min(axis=0, initial=1 << 20) if len(known) else 0)
    np.testing.assert_array_equal(high, known.max(axis=0, initial=0) + 1 if len(known) else 0)


def test_equality_is_that_of_values_whatever_rows_stand_for_them(dense):
    blocks = blocks_of(dense)
    builder = BlockBuilder(dense.shape, dense.dtype)
    for index, values in reversed(list(blocks.parts())):
        builder.add(index[::-1], values[::-1])
    other = builder.finish()
    check_invariants(other)
    assert blocks.equals(other)
    assert other.equals(blocks)
    if dense.size:
        changed = dense.copy()
        changed[-1, -1, -1] = 3 - changed[-1, -1, -1]
        assert not blocks.equals(blocks_of(changed))
    assert not blocks.equals(blocks_of(np.zeros((3, 3, 3), np.uint8)))


def test_log_odds_of_one_value_share_a_block():
    dense = np.zeros((32, 32, 32), np.float32)
    dense[:16] = -0.4
    dense[20, 20, 20] = 3.5
    blocks = blocks_of(dense)
    check_invariants(blocks)
    assert len(blocks.pool) == 3
    np.testing.assert_array_equal(blocks.dense(), dense)


def test_blocks_of_one_value_end_where_the_box_ends():
    builder = BlockBuilder((12, 12, 12), np.uint8)
    builder.put(np.array([[0, 0, 0], [1, 0, 1]]), np.array([1, 2], np.uint8))
    blocks = builder.finish()
    check_invariants(blocks)
    expected = np.zeros((12, 12, 12), np.uint8)
    expected[:8, :8, :8] = 1
    expected[8:, :8, 8:] = 2
    np.testing.assert_array_equal(blocks.dense(), expected)
    assert blocks.count(2) == 4 * 8 * 4


def test_what_lies_beyond_the_box_becomes_zero_and_the_caller_s_blocks_stay():
    given = np.ones((1, 8, 8, 8), np.uint8)
    builder = BlockBuilder((5, 8, 3), np.uint8)
    builder.add(np.array([[0, 0, 0]]), given)
    blocks = builder.finish()
    assert given.all()
    assert blocks.count(1) == 5 * 8 * 3
    np.testing.assert_array_equal(blocks.dense(), np.ones((5, 8, 3), np.uint8))


def test_a_traced_array_is_dense_on_the_device():
    dense = random_boxes((17, 23, 9), seed=1)
    found = jax.jit(lambda blocks: blocks.dense())(blocks_of(dense))
    np.testing.assert_array_equal(found, dense)


def test_a_box_that_no_memory_holds_costs_what_is_in_it(monkeypatch):
    builder = BlockBuilder((8_000, 4_000, 800), np.uint8)
    one = np.zeros((1, 8, 8, 8), np.uint8)
    one[0, 3, 4, 5] = 2
    builder.add(np.array([[900, 400, 40]]), one)
    blocks = builder.finish()
    assert len(blocks.pool) == 2
    assert blocks.num_voxels == 25_600_000_000
    np.testing.assert_array_equal(blocks.where(2), [[7_203, 3_204, 325]])
    monkeypatch.setenv("VOXJAX_MEMORY", "1")
    with pytest.raises(InputError, match=r"dense array of 8000 x 4000 x 800 voxels needs about 25\.6 GB"):
        blocks.dense()


def test_a_table_that_int32_does_not_count_is_refused():
    with pytest.raises(InputError, match="crop the map, or take a larger voxel size"):
        BlockBuilder((65_536, 65_536, 65_536), np.uint8)


def test_a_list_that_memory_does_not_hold_is_refused(monkeypatch):
    blocks = blocks_of(np.full((168, 168, 168), 2, np.uint8))
    monkeypatch.setenv("VOXJAX_MEMORY", "0.1")
    with pytest.raises(InputError, match="list of 4,741,632 voxels"):
        blocks.where(2)


def test_boxes_of_blocks_of_one_value_are_put_at_once():
    builder = BlockBuilder((64, 64, 60), np.float32)
    builder.put_boxes(np.array([[0, 0, 0], [4, 1, 3]]), (3, 2, 2), np.array([1.5, -2.0], np.float32))
    places = np.array([[2, 1, 1], [6, 2, 4], [3, 0, 0]])
    assert builder.levels_at(places).tolist() == [1.5, -2.0, 0.0]
    blocks = builder.finish()
    check_invariants(blocks)
    expected = np.zeros((64, 64, 60), np.float32)
    expected[:24, :16, :16], expected[32:56, 8:24, 24:40] = 1.5, -2.0
    np.testing.assert_array_equal(blocks.dense(), expected)


@pytest.mark.parametrize("capacity", [0, 2, 5, 100])
def test_a_builder_takes_more_blocks_than_it_was_told_of(capacity):
    rng = np.random.default_rng(0)
    dense = rng.integers(0, 3, (16, 24, 8)).astype(np.uint8)
    dense[:8, :8] = 1
    builder = BlockBuilder(dense.shape, np.uint8, capacity=capacity)
    for index in np.ndindex(2, 3, 1):
        x, y, z = (8 * n for n in index)
        builder.add(np.array([index]), dense[None, x : x + 8, y : y + 8, z : z + 8])
    blocks = builder.finish()
    check_invariants(blocks)
    assert len(blocks.pool) == 7
    np.testing.assert_array_equal(blocks.dense(), dense)
