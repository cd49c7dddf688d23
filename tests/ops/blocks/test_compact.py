import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from voxjax._checks import InputError
from voxjax.ops.blocks.compact import occupied_indices


def _assert_lists(occupied, size):
    """Held against NumPy's own list of the voxels that are not 0."""
    expected = np.argwhere(occupied)[:size]
    indices, mask = occupied_indices(occupied, size=size)
    assert indices.shape == (size, 3)
    assert indices.dtype == jnp.int32
    np.testing.assert_array_equal(np.asarray(mask), np.arange(size) < len(expected))
    np.testing.assert_array_equal(np.asarray(indices)[: len(expected)], expected)
    assert not np.asarray(indices)[len(expected) :].any()


SHAPES = [(1, 1, 1), (1, 1, 300), (300, 1, 1), (3, 50, 7), (16, 16, 16), (33, 5, 31)]


@pytest.mark.parametrize("share", [0.0, 0.02, 0.5, 1.0])
@pytest.mark.parametrize("shape", SHAPES)
def test_the_list_is_that_of_argwhere_with_rows_left_over(shape, share):
    occupied = np.random.default_rng(0).random(shape) < share
    _assert_lists(occupied, int(np.count_nonzero(occupied)) + 13)


@pytest.mark.parametrize("size", [0, 1, 5, 127, 128, 129])
def test_a_list_that_is_too_short_keeps_the_first_voxels(size):
    _assert_lists(np.random.default_rng(1).random((9, 10, 11)) < 0.4, size)


@settings(max_examples=25, deadline=None)
@given(
    hnp.arrays(np.uint8, (5, 9, 13), elements=st.sampled_from([0, 0, 0, 1, 255])), st.sampled_from([40, 700])
)
def test_any_grid_of_bytes_is_listed_where_it_is_not_zero(occupied, size):
    _assert_lists(occupied, size)


def test_voxels_far_apart_are_found_across_empty_groups():
    occupied = np.zeros((40, 40, 40), bool)
    for place in ((0, 0, 0), (0, 3, 7), (20, 0, 39), (39, 39, 39)):
        occupied[place] = True
    _assert_lists(occupied, 6)


@pytest.mark.parametrize("shape", [(0, 0, 0), (4, 0, 3)])
def test_a_grid_without_voxels_fills_no_row(shape):
    _assert_lists(np.zeros(shape, bool), 4)


def test_lists_under_vmap_equal_lists_one_by_one():
    grids = np.random.default_rng(2).random((3, 6, 7, 8)) < 0.3
    indices, mask = jax.vmap(lambda grid: occupied_indices(grid, size=150))(jnp.asarray(grids))
    for grid, rows, is_row in zip(grids, np.asarray(indices), np.asarray(mask), strict=True):
        np.testing.assert_array_equal(rows[is_row], np.argwhere(grid))


@pytest.mark.parametrize("size", [-1, True])
def test_numbers_of_rows_that_cannot_be_are_refused(size):
    with pytest.raises(InputError, match="size"):
        occupied_indices(np.ones((3, 3, 3), bool), size=size)


def test_a_grid_whose_places_do_not_fit_int32_is_refused():
    huge = np.broadcast_to(np.uint8(0), (2048, 1024, 1024))
    with pytest.raises(InputError, match=r"2\*\*31"):
        jax.eval_shape(
            lambda grid: occupied_indices(grid, size=4), jax.ShapeDtypeStruct(huge.shape, np.uint8)
        )
