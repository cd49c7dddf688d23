import itertools

import jax.numpy as jnp
import numpy as np
import pytest

from oracles import sliding_window
from voxjax._checks import InputError
from voxjax.features.classify import classify_voxels


def _faces(*axes, size=19):
    """Half or whole planes through the middle of a grid: one axis a wall, two an edge, three a room corner."""
    middle = size // 2
    place = np.stack(np.meshgrid(*[np.arange(size) - middle] * 3, indexing="ij"))
    inside = np.all([place[a] >= 0 for a in axes], axis=0)
    return inside & np.any([place[a] == 0 for a in axes], axis=0)


@pytest.mark.parametrize(("axes", "kind"), [((2,), 1), ((0, 2), 2), ((0, 1, 2), 3)])
def test_walls_are_flat_where_two_meet_is_an_edge_and_three_a_corner(axes, kind):
    kinds = classify_voxels(_faces(*axes))
    assert kinds.dtype == jnp.uint8
    assert int(kinds[9, 9, 9]) == kind


def test_classes_equal_the_loop_over_all_voxels():
    occupied = np.random.default_rng(0).random((6, 5, 4)) < 0.3
    expected = sliding_window.classes(occupied, 5, 3, 40)
    np.testing.assert_array_equal(
        np.asarray(classify_voxels(occupied, size=5, shift=3, min_change=40)), expected
    )


@pytest.mark.parametrize("axes", list(itertools.permutations(range(3)))[1::2])
def test_classes_turn_with_the_grid(axes):
    occupied = _faces(0, 1, 2) | (np.random.default_rng(1).random((19, 19, 19)) < 0.01)
    turned = np.flip(np.transpose(occupied, axes), axis=1).copy()
    expected = np.flip(np.transpose(np.asarray(classify_voxels(occupied)), axes), axis=1)
    np.testing.assert_array_equal(np.asarray(classify_voxels(turned)), expected)


def test_only_occupied_voxels_have_a_class():
    occupied = np.random.default_rng(2).random((9, 9, 9)) < 0.2
    kinds = np.asarray(classify_voxels(occupied))
    np.testing.assert_array_equal(kinds > 0, occupied)
    assert classify_voxels(np.zeros((0, 3, 3), bool)).shape == (0, 3, 3)


@pytest.mark.parametrize(
    "options",
    [
        {"shift": 0},
        {"shift": 20_000_000},
        {"min_change": 0},
        {"min_change": 101},
        {"size": 4},
    ],
)
def test_options_that_cannot_be_are_refused(options):
    with pytest.raises(InputError, match=next(iter(options))):
        classify_voxels(np.zeros((9, 9, 9), bool), **options)
