import numpy as np
import pytest

from voxjax.ops.window.class_tiles import classes_in_tiles, is_worth_tiles


@pytest.mark.parametrize(
    ("shape", "sides"), [((1, 1, 1), (1, 1, 1)), ((5, 17, 3), (5, 6, 3)), ((16, 8, 9), (8, 8, 5))]
)
@pytest.mark.parametrize("reach", [0, 2])
@pytest.mark.parametrize("dtype", [bool, np.uint8])
def test_each_tile_sees_what_its_voxels_depend_on(shape, sides, reach, dtype):
    """A class that is the number of occupied voxels within the reach."""
    # Any number that is not 0 says that a voxel is occupied.
    occupied = (np.random.default_rng(0).random(shape) < 0.9).astype(dtype) * dtype(2)
    windows = 3 * (2 * reach + 1,)

    def classes(ones):
        return np.lib.stride_tricks.sliding_window_view(ones, windows).sum(axis=(3, 4, 5), dtype=np.uint8)

    seen = []

    def noting(ones):
        seen.append(ones.shape)
        return classes(ones)

    found = np.asarray(classes_in_tiles(noting, occupied, reach=reach, tile=(8, 8, 6)))
    expected = classes(np.pad((occupied != 0).astype(np.uint8), reach))
    np.testing.assert_array_equal(found, expected)
    # All tiles share one shape, and so one kernel.
    assert set(seen) == {tuple(side + 2 * reach for side in sides)}


def test_tiles_without_an_occupied_voxel_are_passed_over():
    occupied = np.zeros((40, 4, 4), bool)
    occupied[33, 1, 2] = True
    calls = []

    def classes(ones):
        calls.append(ones.shape)
        return ones[1:-1, 1:-1, 1:-1]

    found = np.asarray(classes_in_tiles(classes, occupied, reach=1, tile=(8, 8, 8)))
    np.testing.assert_array_equal(found, occupied)
    assert calls == [(10, 6, 6)]


def test_small_grids_are_left_whole():
    assert not is_worth_tiles((128, 128, 128))
    assert is_worth_tiles((256, 256, 256))
    assert is_worth_tiles((1 << 11, 1 << 11, 1 << 11))
