import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from occupied_grids import SHAPES, blocks_of, random_grid, walls
from oracles import sliding_window
from voxjax._checks import InputError
from voxjax.ops.blocks.choice import box_count_at
from voxjax.ops.blocks.counts import (
    count_in_blocks,
    cut_blocks,
    dense_from_blocks,
    list_blocks,
    take_from_blocks,
)
from voxjax.ops.blocks.words import block_lattice, occupied_blocks, pack_words


@pytest.mark.parametrize("halo", [0, 3, 8])
def test_blocks_hold_their_voxels_and_the_halo(halo):
    occupied = random_grid((20, 9, 45), 0.1)
    blocks = list_blocks(pack_words(occupied), halo=halo)
    padded = np.pad(occupied, ((halo, 8 + halo),) * 2 + ((halo, 32 + halo),))
    side = 8 + 2 * halo
    assert [tuple(i) for i in np.asarray(blocks.index[blocks.mask]).tolist()] == blocks_of(occupied)
    assert blocks.halo == halo
    assert not np.asarray(blocks.words)[~np.asarray(blocks.mask)].any()
    assert (np.asarray(blocks.index)[~np.asarray(blocks.mask)] == block_lattice((20, 9, 45))).all()
    count = int(blocks.num_found)
    for words, index in zip(np.asarray(blocks.words)[:count], np.asarray(blocks.index)[:count], strict=True):
        x, y, z = 8 * index
        bits = (words[..., None] >> np.arange(32, dtype=np.uint32)) & 1
        expected = padded[x : x + side, y : y + side, z : z + side]
        np.testing.assert_array_equal(bits[..., :side], expected)
        assert not bits[..., side:].any()


@settings(max_examples=8, deadline=None)
@given(
    st.sampled_from(SHAPES),
    st.sampled_from([0.003, 0.1, 0.7]),
    st.integers(0, 99),
    st.sampled_from([1, 3, 7, 15]),
)
def test_counts_in_blocks_equal_the_dense_counts(shape, share, seed, size):
    occupied = random_grid(shape, share, seed)
    blocks = list_blocks(pack_words(occupied), halo=size // 2)
    counts = count_in_blocks(blocks, size=size)
    assert counts.dtype == jnp.uint16
    is_listed = np.asarray(dense_from_blocks(jnp.ones_like(counts), blocks, shape=shape)) > 0
    expected = np.where(is_listed, sliding_window.window_count(occupied, size), 0)
    np.testing.assert_array_equal(np.asarray(dense_from_blocks(counts, blocks, shape=shape)), expected)
    assert is_listed[occupied].all()
    assert not np.asarray(counts)[~np.asarray(blocks.mask)].any()


def test_a_full_block_reaches_the_largest_count_of_the_largest_window():
    blocks = list_blocks(pack_words(np.ones((24, 24, 24), bool)), halo=7)
    assert int(count_in_blocks(blocks, size=15).max()) == 15**3


def test_a_wide_halo_serves_every_smaller_window():
    occupied = random_grid((17, 18, 40), 0.2)
    wide = list_blocks(pack_words(occupied), halo=7)
    for size in (1, 5, 7):
        narrow = list_blocks(pack_words(occupied), halo=size // 2)
        np.testing.assert_array_equal(
            np.asarray(count_in_blocks(wide, size=size)), np.asarray(count_in_blocks(narrow, size=size))
        )


@pytest.mark.parametrize("shape", [(0, 4, 4), (4, 4, 0), (16, 16, 64)])
def test_grids_with_nothing_in_them_have_no_blocks(shape):
    blocks = list_blocks(pack_words(np.zeros(shape, bool)))
    assert int(blocks.num_found) == 0
    assert not np.asarray(blocks.mask).any()
    assert not np.asarray(count_in_blocks(blocks)).any()


def test_a_list_that_is_too_short_says_so_and_keeps_the_first_blocks():
    words = pack_words(random_grid((40, 40, 40), 0.05))
    flags = occupied_blocks(words)
    short, whole = cut_blocks(words, flags, halo=3, capacity=7), list_blocks(words)
    assert int(short.num_found) == int(whole.num_found) > 7
    np.testing.assert_array_equal(np.asarray(short.index), np.asarray(whole.index)[:7])
    np.testing.assert_array_equal(np.asarray(short.words), np.asarray(whole.words)[:7])


def test_blocks_can_be_cut_and_counted_under_vmap():
    words = jnp.stack([jnp.asarray(pack_words(random_grid((16, 16, 40), 0.1, seed))) for seed in range(3)])

    def counts(words):
        blocks = cut_blocks(words, occupied_blocks(words), halo=3, capacity=20)
        return count_in_blocks(blocks)

    for one, batched in zip(words, jax.vmap(counts)(words), strict=True):
        np.testing.assert_array_equal(np.asarray(counts(one)), np.asarray(batched))


def test_values_of_blocks_that_are_not_listed_are_zero_and_marked():
    occupied = walls()
    blocks = list_blocks(pack_words(occupied))
    index = np.array([[7, 5, 20], [39, 32, 69], [-1, 5, 20], [100, 5, 20]], np.int32)
    lattice = block_lattice(occupied.shape)
    values, is_listed = take_from_blocks(count_in_blocks(blocks), blocks, index, lattice=lattice)
    assert np.asarray(is_listed).tolist() == [True, False, False, False]
    assert np.asarray(values).tolist() == [sliding_window.count_at(occupied, (7, 5, 20), 7), 0, 0, 0]


def test_requests_that_cannot_be_met_are_refused():
    words = pack_words(walls())
    blocks = list_blocks(words, halo=1)
    with pytest.raises(InputError, match="at most 2 \\* halo \\+ 1 = 3"):
        count_in_blocks(blocks, size=7)
    with pytest.raises(InputError, match="halo must be 0 to 8"):
        list_blocks(words, halo=9)
    with pytest.raises(InputError, match="lattice"):
        cut_blocks(words, np.zeros((1, 2, 3), bool), halo=3, capacity=4)
    with pytest.raises(InputError, match="implementation"):
        box_count_at(walls(), np.zeros((1, 3), np.int32), implementation="magic")
    with pytest.raises(InputError, match="cut_blocks with a capacity"):
        jax.jit(lambda o, i: box_count_at(o, i, implementation="blocks"))(walls(), np.zeros((1, 3), np.int32))
    for implementation in ("dense", "blocks", None):
        with pytest.raises(InputError, match="at most 15"):
            box_count_at(walls(), np.zeros((1, 3), np.int32), size=19, implementation=implementation)
    with pytest.raises(InputError, match="at most 15"):
        count_in_blocks(list_blocks(words, halo=8), size=17)


def test_wide_default_types_change_nothing():
    words = pack_words(walls())
    narrow = count_in_blocks(list_blocks(words))
    with jax.enable_x64(True):
        blocks = list_blocks(jnp.asarray(words))
        wide = count_in_blocks(blocks)
        assert [array.dtype.name for array in blocks] == ["uint32", "int32", "bool", "int32"]
    assert wide.dtype == jnp.uint16
    np.testing.assert_array_equal(np.asarray(wide), np.asarray(narrow))
