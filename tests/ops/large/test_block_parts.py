"""Parts of block arrays: equally many blocks in each, every block once, and what touches them."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from voxjax.ops.blocks.block_array import BlockArray
from voxjax.ops.blocks.block_builder import BlockBuilder, blocks_of
from voxjax.ops.large.block_parts import cut_parts, pool_of, table_of

OCCUPIED = 2


def random_states(shape, seed, share=0.002):
    """A few occupied voxels, in free and unknown space that ends anywhere."""
    rng = np.random.default_rng(seed)
    states = np.zeros(shape, np.uint8)
    low, high = np.sort(rng.integers(0, np.asarray(shape) + 1, (2, 3)), axis=0)
    states[tuple(map(slice, low, high))] = 1
    states[rng.random(shape) < share] = OCCUPIED
    return states


def held_by(part, array):
    """Blocks that a part's own table and pool say it has, by their numbers."""
    table = np.zeros(part.num_entries + 3, np.int32)
    pool = np.zeros((part.num_rows + 2, 8, 8, 8), array.dtype)
    table_of(part, array, table)
    pool_of(part, array, pool)
    assert not pool[0].any()
    assert not table[part.num_entries :].any()
    assert not pool[part.num_rows :].any()
    return {part.first + int(entry): pool[table[entry]] for entry in np.flatnonzero(table)}


def checked(array, num_parts, value=OCCUPIED):
    """The parts of an array, after comparing what they hold with the definition."""
    lattice, parts = array.table.shape, list(cut_parts(array, num_parts, value))
    block = {
        number: array.pool[row] for number, row in enumerate(array.table.reshape(-1)) if array.pool[row].any()
    }
    listed = [number for number, values in block.items() if (values == value).any()]
    assert len(parts) == num_parts
    np.testing.assert_array_equal(np.concatenate([part.listed for part in parts]), listed)
    counts = [len(part.listed) for part in parts]
    assert max(counts) - min(counts) <= 1
    owned = [number for part in parts for number in part.numbers if part.low <= number < part.high]
    np.testing.assert_array_equal(owned, sorted(block))
    for part in parts:
        wanted = {number for number in block if part.low <= number < part.high}
        for place in np.stack(np.unravel_index(part.listed, lattice), axis=1):
            for step in itertools.product((-1, 0, 1), repeat=3):
                around = place + step
                if ((around >= 0) & (around < lattice)).all():
                    wanted.add(int(np.ravel_multi_index(tuple(around), lattice)))
        held = held_by(part, array)
        assert set(held) == wanted & set(block)
        for number, values in held.items():
            np.testing.assert_array_equal(values, block[number])
    return parts


@settings(max_examples=20, deadline=None)
@given(
    st.sampled_from([(1, 1, 1), (40, 24, 32), (70, 9, 17), (9, 70, 40), (17, 25, 90)]),
    st.sampled_from([1, 2, 3, 8, 50]),
    st.integers(0, 99),
)
def test_parts_hold_each_block_once_and_what_touches_theirs(shape, num_parts, seed):
    checked(blocks_of(random_states(shape, seed)), num_parts)


def test_maps_of_fewer_blocks_than_parts_leave_some_empty():
    states = np.zeros((8, 40, 8), np.uint8)
    states[0, [0, 9, 30], 0] = OCCUPIED
    parts = checked(blocks_of(states), 5)
    assert sorted(len(part.listed) for part in parts) == [0, 0, 1, 1, 1]


@pytest.mark.parametrize("state", [0, 1])
def test_maps_without_the_value_are_all_of_the_first_part(state):
    first, *others = checked(blocks_of(np.full((20, 20, 20), state, np.uint8)), 3)
    assert first.high - first.low == (27 if state else 0)
    assert not any(len(part.numbers) for part in others)


def test_solid_blocks_are_listed_and_share_a_row():
    states = np.full((64, 16, 16), OCCUPIED, np.uint8)
    for part in checked(blocks_of(states), 4):
        assert len(part.listed) == 8
        assert part.num_rows == 2


def test_rows_of_one_value_that_are_not_shared_are_in_a_part_once():
    # Pools of evidence codes have such rows: each block near a surface has its own.
    pool = np.zeros((6, 8, 8, 8), np.uint8)
    pool[2], pool[3], pool[4] = 3, 3, 1
    pool[5, 0, 0, 0] = OCCUPIED
    array = BlockArray(np.asarray([0, 1, 2, 3, 4, 5], np.int32).reshape(1, 1, 6), pool, (8, 8, 48))
    (part,) = cut_parts(array, 1, OCCUPIED)
    held = held_by(part, array)
    assert part.num_rows == 4
    assert {number: values[0, 0, 0] for number, values in held.items()} == {2: 3, 3: 3, 4: 1, 5: OCCUPIED}


def test_parts_of_maps_that_lie_far_apart_have_tables_of_what_they_span():
    builder = BlockBuilder((80_000, 800, 800), np.uint8)
    states = random_states((40, 24, 32), 1, share=0.01)
    for low in (0, 9_000):
        for index, blocks in blocks_of(states).parts():
            builder.add(index + [low, 0, 0], blocks)
    array = builder.finish()
    for part in cut_parts(array, 2, OCCUPIED):
        assert part.num_entries <= 5 * 100 * 100


def test_truth_values_are_cut_as_well():
    checked(blocks_of(random_states((40, 24, 32), 0) == OCCUPIED), 3, True)
