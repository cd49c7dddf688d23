"""`ChunkedArray` against the dense array that its chunks make, and how many of these it reads."""

from collections import Counter

import numpy as np
import pytest
from tests.ops.blocks.boxes import random_boxes

from voxjax import InputError, VoxelGrid
from voxjax.ops.blocks.block_builder import blocks_of
from voxjax.ops.blocks.chunked_array import ChunkedArray

# Chunks of whole blocks, chunks that are not, and one chunk for all.
KINDS = (
    ((17, 23, 40), (16, 8, 24)),
    ((50, 9, 33), (7, 9, 10)),
    ((20, 30, 9), (64, 64, 64)),
    ((0, 5, 3), (8, 8, 8)),
)


def chunked(dense, chunk, **options):
    """The array in chunks, and how often each of them was read."""
    lattice = tuple(-(-n // side) for n, side in zip(dense.shape, chunk, strict=True))
    known, reads = np.zeros(lattice, bool), Counter()

    def part(place):
        return dense[tuple(slice(p * side, (p + 1) * side) for p, side in zip(place, chunk, strict=True))]

    for place in np.ndindex(*lattice):
        known[place] = part(place).any()

    def read(place):
        assert known[place], "a chunk that holds nothing was read"
        reads[place] += 1
        return part(place).copy()

    return ChunkedArray(dense.shape, dense.dtype, chunk, known, read, **options), reads


@pytest.fixture(params=KINDS, ids=str)
def pair(request):
    shape, chunk = request.param
    dense = random_boxes(shape, seed=3)
    return dense, chunked(dense, chunk)[0]


@pytest.fixture(params=["chunks", "read whole"])
def stored(request, pair):
    dense, array = pair
    if request.param == "read whole":
        array.blocks()
    return dense, array


def test_chunks_stand_for_the_dense_array(stored):
    dense, array = stored
    np.testing.assert_array_equal(array.dense(), dense)
    np.testing.assert_array_equal(np.asarray(array), dense)
    assert array.blocks().equals(blocks_of(dense))
    assert array.blocks() is array.blocks()
    assert array.num_voxels == dense.size


def test_voxels_of_a_value_are_counted_and_listed_in_lexicographic_order(stored):
    dense, array = stored
    for value in (1, 2, 3):
        assert array.count(value) == np.count_nonzero(dense == value)
        index = array.where(value)
        assert index.dtype == np.int32
        np.testing.assert_array_equal(index, np.argwhere(dense == value))


def test_windows_are_those_of_the_dense_array_and_zero_beyond_it(stored):
    (dense, array), rng, margin = stored, np.random.default_rng(0), 80
    padded = np.pad(dense, margin)
    for _ in range(20):
        low = rng.integers(-20, 40, 3)
        high = low + rng.integers(0, 40, 3)
        expected = padded[tuple(slice(a + margin, b + margin) for a, b in zip(low, high, strict=True))]
        np.testing.assert_array_equal(array.window(low, high), expected)


def test_single_voxels_are_looked_up(stored):
    (dense, array), rng = stored, np.random.default_rng(0)
    count = 200 if dense.size else 0
    index = np.stack([rng.integers(0, max(n, 1), count) for n in dense.shape], axis=1)
    np.testing.assert_array_equal(array.take(index), dense[tuple(index.T)])


def test_the_box_around_what_is_known_and_parts_of_it(stored):
    dense, array = stored
    for mine, true in zip(array.known_box(), blocks_of(dense).known_box(), strict=True):
        np.testing.assert_array_equal(mine, true)
    rng = np.random.default_rng(5)
    for _ in range(10 if dense.size else 0):
        low = np.array([rng.integers(0, n) for n in dense.shape])
        high = np.array([rng.integers(a, n) + 1 for a, n in zip(low, dense.shape, strict=True)])
        part = array.cut(low, high)
        np.testing.assert_array_equal(part.dense(), dense[tuple(map(slice, low, high))])


def test_only_chunks_that_are_needed_are_read_and_those_read_last_are_kept():
    dense = np.ones((32, 32, 32), np.uint8)
    dense[:8] = 0
    array, reads = chunked(dense, (8, 8, 8), most_kept=4 * 512)
    array.window((8, 0, 0), (16, 16, 16))
    assert reads == dict.fromkeys([(1, y, z) for y in range(2) for z in range(2)], 1)
    array.window((9, 1, 1), (15, 15, 15))
    array.take(np.array([[9, 1, 1], [0, 0, 0], [15, 15, 15]]))
    assert reads.total() == 4
    # Two more chunks displace the two that were not asked for.
    array.window((24, 24, 16), (32, 32, 32))
    array.take(np.array([[9, 1, 1], [15, 15, 15]]))
    assert reads.total() == 6
    array.take(np.array([[9, 1, 9]]))
    assert reads.total() == 7
    reads.clear()
    array.cut(np.array([16, 3, 3]), np.array([25, 8, 9]))
    assert sorted(reads) == [(2, 0, 0), (2, 0, 1), (3, 0, 0), (3, 0, 1)]
    reads.clear()
    assert not array.is_surveyed
    assert array.count(1) == 24 * 32 * 32
    assert array.known_box()[0].tolist() == [8, 0, 0]
    assert array.is_surveyed
    assert max(reads.values()) == 1
    assert len(reads) == 48


def test_a_map_read_whole_needs_memory_for_its_blocks_and_not_for_the_chunks(monkeypatch):
    dense = np.ones((64, 64, 64), np.uint8)
    dense[:8, :8, :8] = np.random.default_rng(0).integers(0, 2, (8, 8, 8))
    # A full chunk has room for 64 blocks, and 512 of them do not fit: but there is only one that is not of one value.
    monkeypatch.setenv("VOXJAX_MEMORY", "0.0001")
    assert chunked(dense, (32, 32, 32))[0].blocks().equals(blocks_of(dense))
    noise = np.random.default_rng(0).integers(0, 2, (64, 64, 64), np.uint8)
    with pytest.raises(InputError, match="the map of 64 x 64 x 64 voxels, read whole, needs"):
        chunked(noise, (32, 32, 32))[0].blocks()


def test_a_dense_array_that_does_not_fit_is_refused(monkeypatch):
    monkeypatch.setenv("VOXJAX_MEMORY", "0.01")

    def no_chunk(place):
        raise AssertionError(f"{place} was read")

    with pytest.raises(InputError, match="the dense array of 512 x 512 x 128 voxels needs about"):
        ChunkedArray((512, 512, 128), np.uint8, (64, 64, 64), np.zeros((8, 8, 2), bool), no_chunk).dense()


def test_a_map_of_chunks_is_the_map_of_the_dense_array():
    dense = random_boxes((40, 50, 30), seed=8)
    odds = dense * np.float32(0.25)
    array, reads = chunked(dense, (16, 16, 16))
    grid = VoxelGrid(array, (1.0, 2.0, 3.0), 0.1, chunked(odds, (8, 16, 24))[0])
    true = VoxelGrid(dense, (1.0, 2.0, 3.0), 0.1, odds)
    assert grid.is_sparse
    assert "not counted yet" in repr(grid)
    assert grid.shape == true.shape
    assert grid.localized()[0].extent[0].tolist() == true.localized()[0].extent[0].tolist()
    assert not reads
    np.testing.assert_array_equal(grid.states_in((3, 4, 5), (20, 30, 25)), dense[3:20, 4:30, 5:25])
    np.testing.assert_array_equal(grid.states_at(np.array([[3, 4, 5]])), dense[3:4, 4, 5])
    np.testing.assert_array_equal(grid.occupied_index(), true.occupied_index())
    assert repr(grid) == repr(true)
    for each in (grid, true, VoxelGrid(blocks_of(dense), (0, 0, 0), 0.1, blocks_of(odds))):
        np.testing.assert_array_equal(each.log_odds_in((3, 4, 5), (20, 30, 25)), odds[3:20, 4:30, 5:25])
        assert each.has_log_odds
        assert set(map(tuple, np.argwhere(dense) // 16)) <= set(map(tuple, each.cubes(16)))
    states_only = VoxelGrid(array, (0, 0, 0), 0.1)
    assert states_only.log_odds_in((0, 0, 0), (1, 1, 1)) is None
    assert not states_only.has_log_odds
    low, high = np.array([5, 6, 7]), np.array([33, 31, 29])
    assert grid.cut(low, high).equals(true.cut(low, high))
    assert grid.crop_to_known().equals(true.crop_to_known())
    assert grid.equals(true)
    assert true.equals(grid)
    np.testing.assert_array_equal(grid.states, dense)
    np.testing.assert_array_equal(grid.log_odds, odds)
    np.testing.assert_array_equal(grid.log_odds_blocks(), odds)
    assert repr(grid) == repr(true)


def test_a_window_for_which_the_process_may_not_take_memory_is_said(monkeypatch):
    def refused(*_, **__):
        raise MemoryError

    known = np.ones((1, 1, 1), bool)
    stored = ChunkedArray((9, 8, 7), np.uint8, (9, 8, 7), known, lambda _: np.ones((9, 8, 7), np.uint8))
    sentence = "a window of 9 x 8 x 7 voxels needs more memory than this process may take; crop the map"
    for function, read in (("_surveyed", lambda: stored.count(1)), ("split", stored.blocks)):
        monkeypatch.setattr(f"voxjax.ops.blocks.chunked_array.{function}", refused)
        with pytest.raises(InputError, match=sentence):
            read()
    with pytest.raises(InputError, match="a window of 1000000000000 x 1000 x 1 voxels needs more memory"):
        stored.window((0, 0, 0), (10**12, 1000, 1))
