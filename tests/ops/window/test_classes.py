import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from oracles import sliding_window
from voxjax._checks import InputError
from voxjax.ops.window.classes import (
    count_change,
    count_steady_directions,
    shift_directions,
    window_classes,
)


def _random(shape, share=0.3, seed=0):
    return np.random.default_rng(seed).random(shape) < share


@pytest.mark.parametrize("shift", [1, 2, 3, 4])
def test_directions_are_thirteen_and_no_two_are_opposite(shift):
    ours = [tuple(int(c) for c in move) for move in shift_directions(shift)]
    assert ours == sliding_window.moves(shift)
    assert len({frozenset([move, tuple(-c for c in move)]) for move in ours}) == 13


@pytest.mark.parametrize(("size", "shift"), [(7, 4), (3, 1)])
def test_changes_equal_the_loop_also_at_the_border(size, shift):
    occupied = _random((5, 6, 4), 0.4)
    change = count_change(occupied, size=size, shift=shift)
    assert change.dtype == jnp.uint8
    np.testing.assert_array_equal(np.asarray(change), sliding_window.changes(occupied, size, shift))


def test_steady_directions_are_those_below_the_bound():
    occupied = _random((6, 6, 6), 0.2)
    change = sliding_window.changes(occupied, 7, 3)
    count = sliding_window.window_count(occupied, 7)
    steady = np.asarray(count_steady_directions(occupied, np.int32(25), shift=3))
    has_voxels = count > 0
    np.testing.assert_array_equal(steady[has_voxels], (change < 25).sum(axis=-1)[has_voxels])


def test_nothing_changes_inside_a_full_grid():
    full = np.ones((15, 15, 15), bool)
    assert not np.asarray(count_change(full))[7, 7, 7].any()
    assert not np.asarray(count_change(np.zeros((4, 4, 4), bool))).any()


@settings(max_examples=15, deadline=None)
@given(hnp.arrays(bool, (5, 4, 6)), st.sampled_from([1, 20, 100, 150]))
def test_classes_equal_those_of_the_loop_on_any_grid(occupied, min_change):
    classes = window_classes(occupied, np.int32(min_change), size=5, shift=3)
    assert classes.dtype == jnp.uint8
    np.testing.assert_array_equal(np.asarray(classes), sliding_window.classes(occupied, 5, 3, min_change))


@pytest.mark.parametrize(("min_change", "steady"), [(-5, 0), (0, 0), (2**31 - 1, 13)])
def test_bounds_that_no_change_or_every_change_reaches(min_change, steady):
    occupied = np.ones((5, 5, 5), bool)
    found = np.asarray(count_steady_directions(occupied, np.int32(min_change), size=15, shift=8))
    assert (found == steady).all()


@pytest.mark.parametrize("size", [7, 15])
def test_largest_counts_do_not_wrap(size):
    """A full block of windows beside nothing: counts from 0 to size cubed meet in the comparisons."""
    occupied = np.zeros((size + size // 2 + 1, size, size // 2), bool)
    occupied[:size] = True
    change = sliding_window.changes(occupied, size, size // 2 + 1)
    np.testing.assert_array_equal(np.asarray(count_change(occupied, size=size, shift=size // 2 + 1)), change)
    steady = count_steady_directions(occupied, np.int32(90), size=size, shift=size // 2 + 1)
    has_voxels = sliding_window.window_count(occupied, size) > 0
    np.testing.assert_array_equal(np.asarray(steady)[has_voxels], (change < 90).sum(axis=-1)[has_voxels])


def test_changes_and_classes_under_vmap_equal_those_one_by_one():
    grids = np.stack([_random((5, 6, 7), 0.3, seed) for seed in range(2)])
    changes = jax.vmap(lambda grid: count_change(grid, size=3, shift=2))(jnp.asarray(grids))
    classes = jax.vmap(lambda grid: window_classes(grid, np.int32(40), size=3, shift=2))(jnp.asarray(grids))
    for grid, change, kind in zip(grids, changes, classes, strict=True):
        np.testing.assert_array_equal(np.asarray(change), sliding_window.changes(grid, 3, 2))
        np.testing.assert_array_equal(np.asarray(kind), sliding_window.classes(grid, 3, 2, 40))


@pytest.mark.parametrize("shape", [(0, 0, 0), (4, 0, 3)])
def test_grids_without_voxels_have_no_classes(shape):
    grid = np.zeros(shape, bool)
    assert window_classes(grid, np.int32(20)).shape == shape
    assert count_change(grid).shape == (*shape, 13)


@pytest.mark.parametrize("shift", [0, 65, 20_000_000])
@pytest.mark.parametrize("kernel", [count_change, count_steady_directions, window_classes])
def test_moves_that_would_pad_the_grid_without_end_are_refused(kernel, shift):
    arguments = () if kernel is count_change else (np.int32(20),)
    with pytest.raises(InputError, match="shift must be"):
        kernel(np.zeros((2, 2, 2), bool), *arguments, shift=shift)


@pytest.mark.parametrize("shape", [(70, 65, 9), (33, 130, 5), (3, 4, 300)])
@pytest.mark.parametrize(("size", "shift"), [(7, 4), (3, 1)])
def test_tiles_give_the_classes_of_one_pass(shape, size, shift):
    occupied = _random(shape, 0.3)
    for grid in (occupied, jnp.asarray(occupied, jnp.uint8)):
        tiles, passes = (
            window_classes(grid, np.int32(20), size=size, shift=shift, implementation=name)
            for name in ("tiles", "passes")
        )
        assert isinstance(tiles, jax.Array)
        np.testing.assert_array_equal(np.asarray(tiles), np.asarray(passes))


def test_tiles_are_refused_where_they_cannot_run():
    def traced(grid):
        return window_classes(grid, np.int32(20), implementation="tiles")

    with pytest.raises(NotImplementedError, match="implementation='passes'"):
        jax.jit(traced)(_random((4, 4, 4)))
