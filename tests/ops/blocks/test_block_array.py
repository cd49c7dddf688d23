"""`BlockArray` against the dense array that it stands for."""

import jax
import numpy as np
import pytest
from tests.ops.blocks.boxes import random_boxes

from voxjax import InputError
from voxjax.ops.blocks.block_array import BlockArray
from voxjax.ops.blocks.block_builder import BlockBuilder, blocks_of

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


def test_a_list_that_memory_does_not_hold_is_refused(monkeypatch):
    blocks = blocks_of(np.full((168, 168, 168), 2, np.uint8))
    monkeypatch.setenv("VOXJAX_MEMORY", "0.1")
    with pytest.raises(InputError, match="list of 4,741,632 voxels"):
        blocks.where(2)
