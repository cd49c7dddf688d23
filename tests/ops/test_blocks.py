import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oracles import sliding_window
from voxjax._checks import InputError
from voxjax.ops.blocks import choice as block_choice
from voxjax.ops.blocks.choice import box_count_at
from voxjax.ops.blocks.counts import (
    count_in_blocks,
    cut_blocks,
    dense_from_blocks,
    list_blocks,
    take_from_blocks,
)
from voxjax.ops.blocks.words import block_lattice, lattice_of_words, occupied_blocks, pack_words
from voxjax.ops.window.classes import box_count

SHAPES = [(1, 1, 1), (8, 8, 32), (9, 17, 33), (3, 40, 5), (16, 1, 70)]


def _random(shape, share=0.1, seed=0):
    return np.random.default_rng(seed).random(shape) < share


def _walls(shape=(40, 33, 70)):
    """A floor and a wall: most blocks are empty."""
    occupied = np.zeros(shape, bool)
    occupied[2:30, 3:30, 9] = occupied[7, 3:30, 9:40] = True
    return occupied


def _blocks_of(occupied):
    """Occupied blocks from the definition."""
    return sorted({tuple(int(c) // 8 for c in voxel) for voxel in np.argwhere(occupied)})


def _unpacked(words, shape):
    """The grid that words were packed from, and whether their margin is empty."""
    bits = (np.asarray(words)[..., None] >> np.arange(32, dtype=np.uint32)) & 1
    bits = bits.reshape(*bits.shape[:2], -1)
    inner = tuple(slice(low, low + side) for low, side in zip((8, 8, 32), shape, strict=True))
    return bits[inner] != 0, bits.sum() == bits[inner].sum()


@pytest.mark.parametrize("put", [np.asarray, jnp.asarray], ids=["host", "device"])
@pytest.mark.parametrize("shape", SHAPES)
def test_packed_bits_are_the_voxels_in_an_empty_margin(shape, put):
    occupied = _random(shape, 0.4)
    words = pack_words(put(occupied))
    assert words.dtype == np.uint32
    assert words.shape == (-(-shape[0] // 8) * 8 + 16, -(-shape[1] // 8) * 8 + 16, -(-shape[2] // 32) + 2)
    assert lattice_of_words(words) == block_lattice(shape)
    unpacked, margin_is_empty = _unpacked(words, shape)
    np.testing.assert_array_equal(unpacked, occupied)
    assert margin_is_empty


@pytest.mark.parametrize("put", [np.asarray, jnp.asarray], ids=["host", "device"])
def test_any_byte_above_zero_is_occupied(put):
    grid = np.arange(256, dtype=np.uint8).reshape(2, 4, 32)
    np.testing.assert_array_equal(_unpacked(pack_words(put(grid)), grid.shape)[0], grid > 0)


@pytest.mark.parametrize("shape", SHAPES)
def test_occupied_blocks_are_those_that_hold_a_voxel(shape):
    occupied = _random(shape, 0.02, seed=sum(shape))
    flags = np.asarray(occupied_blocks(pack_words(occupied)))
    assert flags.shape == block_lattice(occupied.shape)
    assert [tuple(place) for place in np.argwhere(flags).tolist()] == _blocks_of(occupied)


@pytest.mark.parametrize("halo", [0, 3, 8])
def test_blocks_hold_their_voxels_and_the_halo(halo):
    occupied = _random((20, 9, 45), 0.1)
    blocks = list_blocks(pack_words(occupied), halo=halo)
    padded = np.pad(occupied, ((halo, 8 + halo),) * 2 + ((halo, 32 + halo),))
    side = 8 + 2 * halo
    assert [tuple(i) for i in np.asarray(blocks.index[blocks.mask]).tolist()] == _blocks_of(occupied)
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
    occupied = _random(shape, share, seed)
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
    occupied = _random((17, 18, 40), 0.2)
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
    words = pack_words(_random((40, 40, 40), 0.05))
    flags = occupied_blocks(words)
    short, whole = cut_blocks(words, flags, halo=3, capacity=7), list_blocks(words)
    assert int(short.num_found) == int(whole.num_found) > 7
    np.testing.assert_array_equal(np.asarray(short.index), np.asarray(whole.index)[:7])
    np.testing.assert_array_equal(np.asarray(short.words), np.asarray(whole.words)[:7])


def test_blocks_can_be_cut_and_counted_under_vmap():
    words = jnp.stack([jnp.asarray(pack_words(_random((16, 16, 40), 0.1, seed))) for seed in range(3)])

    def counts(words):
        blocks = cut_blocks(words, occupied_blocks(words), halo=3, capacity=20)
        return count_in_blocks(blocks)

    for one, batched in zip(words, jax.vmap(counts)(words), strict=True):
        np.testing.assert_array_equal(np.asarray(counts(one)), np.asarray(batched))


def test_values_of_blocks_that_are_not_listed_are_zero_and_marked():
    occupied = _walls()
    blocks = list_blocks(pack_words(occupied))
    index = np.array([[7, 5, 20], [39, 32, 69], [-1, 5, 20], [100, 5, 20]], np.int32)
    lattice = block_lattice(occupied.shape)
    values, is_listed = take_from_blocks(count_in_blocks(blocks), blocks, index, lattice=lattice)
    assert np.asarray(is_listed).tolist() == [True, False, False, False]
    assert np.asarray(values).tolist() == [sliding_window.count_at(occupied, (7, 5, 20), 7), 0, 0, 0]


@pytest.mark.parametrize("implementation", ["dense", "blocks", None])
@pytest.mark.parametrize("size", [3, 7])
def test_counts_at_voxels_equal_the_dense_ones_also_beside_empty_blocks(implementation, size):
    occupied = _walls()
    rng = np.random.default_rng(1)
    anywhere = rng.integers(0, occupied.shape, (200, 3))
    index = np.concatenate([np.argwhere(occupied), anywhere, anywhere]).astype(np.int32)
    expected = sliding_window.window_count(occupied, size)[tuple(index.T)]
    for grid in (occupied, jnp.asarray(occupied)):
        counts = box_count_at(grid, index, size=size, implementation=implementation)
        assert counts.dtype == jnp.uint16
        np.testing.assert_array_equal(np.asarray(counts), expected)


@pytest.mark.parametrize(("share", "calls"), [(0.0, 1), (1.0, 0)])
def test_the_share_of_blocks_decides_whether_the_whole_grid_is_counted(monkeypatch, share, calls):
    whole = []
    dense = block_choice._dense_at
    monkeypatch.setattr(block_choice, "MAX_BLOCK_SHARE", share)
    monkeypatch.setattr(block_choice, "MIN_VOXELS", 1)
    monkeypatch.setattr(block_choice, "_dense_at", lambda *a, **k: whole.append(a) or dense(*a, **k))
    occupied = _walls()
    box_count_at(occupied, np.argwhere(occupied).astype(np.int32))
    assert len(whole) == calls
    monkeypatch.setattr(block_choice, "MIN_VOXELS", occupied.size + 1)
    box_count_at(occupied, np.argwhere(occupied).astype(np.int32))
    assert len(whole) == calls + 1


def test_counts_at_voxels_work_under_jit():
    occupied = jnp.asarray(_walls())
    index = jnp.asarray(np.argwhere(_walls()).astype(np.int32))
    expected = box_count(occupied)[tuple(index.T)]
    np.testing.assert_array_equal(np.asarray(jax.jit(box_count_at)(occupied, index)), np.asarray(expected))


def test_counts_at_no_voxels_are_none():
    assert box_count_at(_walls(), np.zeros((0, 3), np.int32)).shape == (0,)


def test_requests_that_cannot_be_met_are_refused():
    words = pack_words(_walls())
    blocks = list_blocks(words, halo=1)
    with pytest.raises(InputError, match="at most 2 \\* halo \\+ 1 = 3"):
        count_in_blocks(blocks, size=7)
    with pytest.raises(InputError, match="halo must be 0 to 8"):
        list_blocks(words, halo=9)
    with pytest.raises(InputError, match="lattice"):
        cut_blocks(words, np.zeros((1, 2, 3), bool), halo=3, capacity=4)
    with pytest.raises(InputError, match="implementation"):
        box_count_at(_walls(), np.zeros((1, 3), np.int32), implementation="magic")
    with pytest.raises(InputError, match="cut_blocks with a capacity"):
        jax.jit(lambda o, i: box_count_at(o, i, implementation="blocks"))(
            _walls(), np.zeros((1, 3), np.int32)
        )
    for implementation in ("dense", "blocks", None):
        with pytest.raises(InputError, match="at most 15"):
            box_count_at(_walls(), np.zeros((1, 3), np.int32), size=19, implementation=implementation)
    with pytest.raises(InputError, match="at most 15"):
        count_in_blocks(list_blocks(words, halo=8), size=17)


def test_wide_default_types_change_nothing():
    words = pack_words(_walls())
    narrow = count_in_blocks(list_blocks(words))
    with jax.enable_x64(True):
        blocks = list_blocks(jnp.asarray(words))
        wide = count_in_blocks(blocks)
        assert [array.dtype.name for array in blocks] == ["uint32", "int32", "bool", "int32"]
    assert wide.dtype == jnp.uint16
    np.testing.assert_array_equal(np.asarray(wide), np.asarray(narrow))
