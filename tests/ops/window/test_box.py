import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy import ndimage

from oracles import sliding_window
from voxjax._checks import InputError
from voxjax.ops.window.box import box_count, check_occupied

IMPLEMENTATIONS = ("separable", "packed", "summed_area")


def _random(shape, share=0.3, seed=0):
    return np.random.default_rng(seed).random(shape) < share


@pytest.mark.parametrize("implementation", IMPLEMENTATIONS)
@pytest.mark.parametrize("size", [1, 3, 5, 7, 9, 11, 13, 15])
def test_counts_equal_shifted_copies_for_every_size(implementation, size):
    occupied = _random((9, 17, 6))
    count = box_count(occupied, size=size, implementation=implementation)
    assert count.dtype == jnp.uint16
    np.testing.assert_array_equal(np.asarray(count), sliding_window.window_count(occupied, size))


@pytest.mark.parametrize("implementation", IMPLEMENTATIONS)
@pytest.mark.parametrize("shape", [(1, 1, 1), (1, 1, 20), (2, 30, 1), (3, 2, 70)])
def test_thin_grids_and_windows_larger_than_the_grid(implementation, shape):
    occupied = _random(shape, 0.6)
    expected = ndimage.correlate(occupied.astype(np.int64), np.ones((7, 7, 7), np.int64), mode="constant")
    np.testing.assert_array_equal(np.asarray(box_count(occupied, implementation=implementation)), expected)


@pytest.mark.parametrize("implementation", IMPLEMENTATIONS)
@pytest.mark.parametrize("shape", [(0, 0, 0), (4, 0, 3)])
def test_grids_without_voxels_have_no_counts(implementation, shape):
    assert box_count(np.zeros(shape, bool), implementation=implementation).shape == shape


@pytest.mark.parametrize("implementation", IMPLEMENTATIONS)
def test_full_grid_reaches_the_largest_count(implementation):
    full = np.ones((16, 16, 16), bool)
    for size in (7, 15):
        assert int(box_count(full, size=size, implementation=implementation)[8, 8, 8]) == size**3


@pytest.mark.parametrize("implementation", IMPLEMENTATIONS)
def test_bool_and_uint8_grids_count_alike(implementation):
    occupied = _random((6, 7, 8))
    as_bytes = np.where(occupied, np.uint8(2), np.uint8(0))
    np.testing.assert_array_equal(
        np.asarray(box_count(occupied, implementation=implementation)),
        np.asarray(box_count(as_bytes, implementation=implementation)),
    )


@pytest.mark.parametrize("implementation", IMPLEMENTATIONS)
def test_counts_under_vmap_equal_counts_one_by_one(implementation):
    grids = _random((3, 6, 7, 8))
    batched = jax.vmap(lambda g: box_count(g, size=5, implementation=implementation))(jnp.asarray(grids))
    for grid, count in zip(grids, batched, strict=True):
        np.testing.assert_array_equal(np.asarray(count), sliding_window.window_count(grid, 5))


@settings(max_examples=25, deadline=None)
@given(hnp.arrays(bool, (6, 5, 37)), st.sampled_from([3, 7, 13]))
def test_all_implementations_agree_on_any_grid(occupied, size):
    first, *others = (
        np.asarray(box_count(occupied, size=size, implementation=name)) for name in IMPLEMENTATIONS
    )
    for other in others:
        np.testing.assert_array_equal(first, other)


@pytest.mark.parametrize("implementation", ["separable", "packed"])
def test_temporary_memory_is_at_most_two_bytes_a_voxel(implementation):
    grid = jax.ShapeDtypeStruct((64, 64, 64), np.bool_)
    count = jax.jit(lambda occupied: box_count(occupied, size=7, implementation=implementation))
    memory = count.lower(grid).compile().memory_analysis()
    assert memory is not None
    assert memory.temp_size_in_bytes <= 2 * 64**3


@pytest.mark.parametrize("axes", list(itertools.permutations(range(3)))[1::2])
def test_counts_turn_with_the_grid(axes):
    occupied = _random((8, 9, 10))
    turned = np.flip(np.transpose(occupied, axes), axis=0).copy()
    expected = np.flip(np.transpose(np.asarray(box_count(occupied)), axes), axis=0)
    np.testing.assert_array_equal(np.asarray(box_count(turned)), expected)


@pytest.mark.parametrize("size", [0, 2, -1, 17])
def test_window_sizes_that_cannot_be_are_refused(size):
    with pytest.raises(InputError, match="size"):
        box_count(np.zeros((3, 3, 3), bool), size=size)


def test_default_implementation_counts_too():
    occupied = _random((6, 7, 8))
    np.testing.assert_array_equal(np.asarray(box_count(occupied)), sliding_window.window_count(occupied, 7))


def test_unknown_implementation_is_refused():
    with pytest.raises(InputError, match="implementation"):
        box_count(np.zeros((3, 3, 3), bool), implementation="magic")


def test_lists_are_refused_in_one_sentence():
    with pytest.raises(InputError, match="occupied must be an array, got a list"):
        check_occupied([[[True]]])
