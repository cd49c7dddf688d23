import numpy as np
import pytest

from voxjax.ops.window.class_tiles import classes_in_tiles, is_worth_tiles


@pytest.mark.parametrize("shape", [(1, 1, 1), (5, 17, 3), (16, 8, 4)])
@pytest.mark.parametrize("reach", [0, 2])
def test_each_tile_sees_what_its_voxels_depend_on(shape, reach):
    """A class that is the number of occupied voxels along x and y within the reach."""
    occupied = np.random.default_rng(0).random(shape) < 0.5

    def classes(grid):
        padded = np.pad(np.asarray(grid).astype(np.uint8), ((reach, reach), (reach, reach), (0, 0)))
        windows = np.lib.stride_tricks.sliding_window_view(
            padded, (2 * reach + 1, 2 * reach + 1), axis=(0, 1)
        )
        return windows.sum(axis=(-2, -1), dtype=np.uint8)

    seen = []

    def noting(grid):
        seen.append(grid.shape)
        return classes(grid)

    found = classes_in_tiles(noting, occupied, reach=reach, tile=8)
    np.testing.assert_array_equal(np.asarray(found), classes(occupied))
    # All tiles share one shape, and so one kernel.
    assert set(seen) == {(8 + 2 * reach, 8 + 2 * reach, shape[2])}


def test_small_grids_are_left_whole():
    assert not is_worth_tiles((256, 256, 256))
    assert is_worth_tiles((512, 512, 256))
    assert is_worth_tiles((1 << 11, 1 << 11, 1 << 11))
