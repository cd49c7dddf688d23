import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import zarr
from hypothesis import given, settings
from hypothesis import strategies as st

from oracles import sliding_window
from voxjax._checks import InputError
from voxjax.ops.large.tiles import map_tiles, tiles_of
from voxjax.ops.window.classes import box_count, count_change

COUNT_5 = functools.partial(box_count, size=5)


def _random(shape, share=0.3, seed=0):
    return np.random.default_rng(seed).random(shape) < share


class SlicesOnly:
    """An array that can do no more than Zarr promises, and remembers the largest part that was asked for."""

    def __init__(self, values):
        self._values, self.shape, self.dtype, self.largest = values, values.shape, values.dtype, 0

    def _check(self, key):
        assert isinstance(key, tuple)
        assert all(isinstance(part, slice) and part.step is None for part in key)

    def __getitem__(self, key):
        self._check(key)
        part = self._values[key].copy()
        self.largest = max(self.largest, part.size)
        return part

    def __setitem__(self, key, value):
        self._check(key)
        assert type(value) is np.ndarray
        self._values[key] = value


@settings(max_examples=15, deadline=None)
@given(
    st.tuples(*[st.sampled_from([1, 4, 9, 13])] * 3),
    st.sampled_from([4, 7, (5, 20, 3)]),
    st.sampled_from([2, 3, 6]),
)
def test_counts_tile_by_tile_equal_counts_of_the_whole(shape, tile, halo):
    occupied = _random(shape, seed=sum(shape))
    counts = np.full(shape, 999, np.uint16)
    map_tiles(COUNT_5, occupied, counts, tile=tile, halo=halo)
    np.testing.assert_array_equal(counts, sliding_window.window_count(occupied, 5))


@pytest.mark.parametrize("shape", [(1, 2, 3), (10, 9, 8), (11, 4, 17)])
@pytest.mark.parametrize("halo", [0, 2, 5])
def test_cores_cover_the_grid_once_and_read_their_halo(shape, halo):
    filled = np.zeros(shape, int)
    for tile in tiles_of(shape, (4, 4, 5), halo):
        filled[tile.core] += 1
        for core, read, place, keep, side in zip(
            tile.core, tile.read, tile.place, tile.keep, shape, strict=True
        ):
            assert read.start == max(core.start - halo, 0)
            assert read.stop >= min(core.stop + halo, side)
            assert place.stop - place.start == read.stop - read.start
            # The same voxel has the same place in what is read and in what is kept.
            assert core.start - read.start == keep.start - place.start
            assert keep.stop - keep.start == core.stop - core.start
    assert (filled == 1).all()


def test_tiles_of_all_kinds_trace_one_kernel():
    traces = []

    def kernel(block):
        traces.append(block.shape)
        return box_count(block, size=3)

    occupied = _random((21, 10, 13))
    for _ in range(2):
        map_tiles(kernel, occupied, np.zeros(occupied.shape, np.uint16), tile=8, halo=1)
    assert traces == [(10, 10, 10)]


def test_a_tile_larger_than_the_grid_is_cut_down_to_it():
    shapes = []
    occupied = _random((5, 40, 3))
    counts = np.zeros(occupied.shape, np.uint16)
    map_tiles(lambda b: (shapes.append(b.shape), COUNT_5(b))[1], occupied, counts, tile=16, halo=2)
    assert shapes == [(9, 20, 7)]
    np.testing.assert_array_equal(counts, sliding_window.window_count(occupied, 5))


def test_arrays_that_can_only_be_sliced_are_read_a_tile_at_a_time():
    occupied = _random((20, 21, 22))
    source, target = SlicesOnly(occupied), SlicesOnly(np.zeros(occupied.shape, np.uint16))
    map_tiles(COUNT_5, source, target, tile=8, halo=2)
    np.testing.assert_array_equal(target._values, sliding_window.window_count(occupied, 5))
    assert source.largest == 12**3
    assert target.largest == 0


def test_memory_mapped_files_are_read_and_written(tmp_path):
    shape = (20, 11, 12)
    source = np.memmap(tmp_path / "grid", np.uint8, "w+", shape=shape)
    source[:] = 2 * _random(shape)
    target = np.memmap(tmp_path / "counts", np.uint16, "w+", shape=shape)
    map_tiles(COUNT_5, source, target, tile=(8, 11, 5), halo=2)
    target.flush()
    written = np.fromfile(tmp_path / "counts", np.uint16).reshape(shape)
    np.testing.assert_array_equal(written, sliding_window.window_count(np.asarray(source), 5))


def test_zarr_arrays_are_read_and_written():
    occupied = _random((17, 16, 9)).astype(np.uint8)
    source = zarr.array(occupied, chunks=(8, 8, 8))
    target = zarr.zeros(occupied.shape, chunks=(8, 8, 8), dtype="uint16")
    map_tiles(COUNT_5, source, target, tile=8, halo=2)
    np.testing.assert_array_equal(target[:], sliding_window.window_count(occupied, 5))


def test_kernels_may_add_axes():
    occupied = _random((9, 8, 7), 0.4)
    changes = np.zeros((*occupied.shape, 13), np.uint8)
    map_tiles(functools.partial(count_change, size=3, shift=2), occupied, changes, tile=4, halo=3)
    np.testing.assert_array_equal(changes, sliding_window.changes(occupied, 3, 2))


def test_grids_may_have_more_axes():
    values = np.random.default_rng(0).integers(0, 9, (9, 5, 6, 2)).astype(np.int32)
    sums = np.zeros(values.shape, np.int32)
    map_tiles(lambda b: jnp.cumsum(b, axis=3, dtype=jnp.int32), values, sums, tile=4, halo=0)
    np.testing.assert_array_equal(sums, np.cumsum(values, axis=3))


@pytest.mark.parametrize("shape", [(0, 3, 3), (3, 3, 0)])
def test_grids_without_voxels_are_left_alone(shape):
    map_tiles(COUNT_5, np.zeros(shape, bool), np.zeros(shape, np.uint16), tile=4, halo=2)


def test_without_a_halo_the_borders_of_tiles_would_show():
    occupied = np.ones((8, 8, 8), bool)
    counts = np.zeros(occupied.shape, np.uint16)
    map_tiles(COUNT_5, occupied, counts, tile=4, halo=1)
    assert (counts != sliding_window.window_count(occupied, 5)).any()


@pytest.mark.parametrize(
    ("message", "source", "target", "options"),
    [
        ("halo must be 0", np.zeros((4, 4, 4), bool), np.zeros((4, 4, 4), np.uint16), {"halo": -1}),
        ("tile must be one or three", np.zeros((4, 4, 4), bool), np.zeros((4, 4, 4), np.uint16), {"tile": 0}),
        (
            "tile must be one or three",
            np.zeros((4, 4, 4), bool),
            np.zeros((4, 4, 4), np.uint16),
            {"tile": (4, 0, 4)},
        ),
        ("target must be uint16", np.zeros((4, 4, 4), bool), np.zeros((4, 4, 4), np.uint8), {}),
        ("target must be uint16", np.zeros((4, 4, 4), bool), np.zeros((4, 4, 5), np.uint16), {}),
        ("axes x, y, z", np.zeros((4, 4), bool), np.zeros((4, 4), np.uint16), {}),
        ("narrow to float32", np.zeros((4, 4, 4)), np.zeros((4, 4, 4), np.uint16), {}),
    ],
)
def test_requests_that_cannot_be_met_are_refused_before_the_first_tile(message, source, target, options):
    with pytest.raises(InputError, match=message):
        map_tiles(COUNT_5, source, target, **({"halo": 2, "tile": 4} | options))


def test_a_kernel_that_changes_the_shape_is_refused():
    with pytest.raises(InputError, match="keep the shape"):
        map_tiles(lambda b: b[1:], np.zeros((4, 4, 4), bool), np.zeros((4, 4, 4), bool), halo=2)


def test_a_grid_is_not_overwritten_while_it_is_read():
    grid = np.zeros((4, 4, 4), np.uint16)
    for target in (grid, grid[:, ::-1]):
        with pytest.raises(InputError, match="other memory"):
            map_tiles(lambda b: b, grid, target, halo=2)


def test_wide_default_types_change_nothing():
    occupied = _random((9, 8, 7))
    counts = np.zeros(occupied.shape, np.uint16)
    with jax.enable_x64(True):
        map_tiles(COUNT_5, occupied, counts, tile=4, halo=2)
    np.testing.assert_array_equal(counts, sliding_window.window_count(occupied, 5))
