"""Cells of a block and what a flat field holds there."""

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from voxjax._checks import InputError
from voxjax._runtime.tables import reserve, table_length
from voxjax.ops.blocks.block_builder import blocks_of
from voxjax.ops.evidence.lookup import Block, cells_on_host, lookup, turn_columns, turned_on_host

HUGE = (936, 1698, 174)


@settings(max_examples=30, deadline=None)
@given(shape=st.tuples(*[st.integers(1, 20)] * 3), seed=st.integers(0, 99))
def test_host_and_kernel_find_the_same_cells(shape: tuple[int, int, int], seed: int) -> None:
    rng = np.random.default_rng(seed)
    places = rng.uniform(-3, 23, (3, 200)).astype(np.float32)
    block = Block.of(np.asarray(shape, np.int32), np.zeros(3, np.float32), 1.0)
    cell, is_inside = block.cells_at(list(places))
    found, is_found = cells_on_host([row.copy() for row in places], shape)
    np.testing.assert_array_equal(is_found, np.asarray(is_inside))
    np.testing.assert_array_equal(found, np.asarray(cell))
    expected = np.asarray(np.ravel_multi_index(tuple(np.floor(places).astype(int)), shape, mode="clip"))
    np.testing.assert_array_equal(found[is_found], expected[is_found])


@settings(max_examples=30, deadline=None)
@given(shape=st.tuples(*[st.integers(1, 40)] * 3), seed=st.integers(0, 99))
def test_a_pool_of_blocks_holds_what_the_dense_field_holds(shape: tuple[int, int, int], seed: int) -> None:
    rng = np.random.default_rng(seed)
    field = rng.integers(0, 3, shape).astype(np.uint8) * (rng.random(shape) < rng.random())
    blocks = blocks_of(field)
    # Tables go on past the box.
    table, pool = np.append(blocks.table.reshape(-1), np.full(5, 1 << 20)), blocks.pool.reshape(-1)
    places = rng.uniform(-3, 43, (3, 200)).astype(np.float32)
    dense, is_in_dense = cells_on_host([row.copy() for row in places], shape)
    block = Block.of(np.asarray(shape, np.int32), np.zeros(3, np.float32), 1.0, table.astype(np.int32))
    cell, is_inside = (np.asarray(part) for part in block.cells_at(list(places)))
    np.testing.assert_array_equal(is_inside, is_in_dense)
    np.testing.assert_array_equal(pool[cell], np.where(is_inside, field.reshape(-1)[dense], pool[0]))
    assert not cell[~is_inside].any()
    found, is_found = cells_on_host([row.copy() for row in places], shape, table.astype(np.int32))
    np.testing.assert_array_equal(found, cell)
    np.testing.assert_array_equal(is_found, is_inside)
    np.testing.assert_array_equal(
        lookup(pool, block, places.T, np.uint8(9)), np.where(is_inside, pool[cell], 9)
    )


def test_host_and_kernel_turn_alike() -> None:
    rng = np.random.default_rng(0)
    rotation, columns = (rng.normal(size=shape).astype(np.float32) for shape in ((3, 3), (3, 50)))
    expected = np.asarray(turn_columns(jnp.asarray(rotation), jnp.asarray(columns)))
    np.testing.assert_allclose(list(turned_on_host(rotation, columns)), expected, atol=1e-5)


def test_the_last_cell_of_a_block_beyond_2_to_the_28_is_found() -> None:
    num_cells = int(np.prod(HUGE))
    assert num_cells > 1 << 28
    table = reserve(table_length(num_cells), dtype=np.uint8)
    table[num_cells - 1] = 7
    last = np.asarray([HUGE], np.float32) - np.float32(0.5)
    points = np.concatenate([last, last + np.float32(1), -last])
    block = Block.of(np.asarray(HUGE, np.int32), np.zeros(3, np.float32), 1.0)
    assert np.asarray(lookup(table, block, points, np.uint8(9))).tolist() == [7, 9, 9]
    cell, is_inside = cells_on_host(points.T.copy(), HUGE)
    assert is_inside.tolist() == [True, False, False]
    assert cell[0] == num_cells - 1


def test_a_field_that_int32_cannot_count_is_refused() -> None:
    block = Block.of(np.full(3, 2000, np.int32), np.zeros(3, np.float32), 1.0)
    with pytest.raises(InputError, match="a field must have at most 2,147 million voxels"):
        lookup(reserve(2**31, dtype=np.uint8), block, np.zeros((1, 3), np.float32), np.uint8(0))
