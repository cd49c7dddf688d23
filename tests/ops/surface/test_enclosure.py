"""Enclosed voxels against rays walked one by one."""

import tracemalloc
from itertools import product

import numpy as np
import pytest

from voxjax._runtime import threads
from voxjax.ops.surface.enclosure import is_enclosed

DIRECTIONS = np.asarray([d for d in product((-1, 0, 1), repeat=3) if any(d)])


def walk(occupied, reach):
    """Count by definition: step along each direction until something is met, the border or the end of the ray."""
    count = np.zeros(occupied.shape, np.uint8)
    for place in np.ndindex(occupied.shape):
        for direction in DIRECTIONS:
            at = np.asarray(place)
            for _ in range(int(reach / np.linalg.norm(direction))):
                at = at + direction
                if (at < 0).any() or (at >= occupied.shape).any():
                    break
                if occupied[tuple(at)]:
                    count[place] += 1
                    break
    return count


def march(occupied, reach):
    """The same count, all voxels a step at a time, in a grid with room for all rays around it."""
    steps = int(reach)
    room = np.pad(occupied, steps)
    inner = [np.arange(steps, steps + n) for n in occupied.shape]
    count = np.zeros(occupied.shape, np.uint8)
    for direction in DIRECTIONS:
        met = np.zeros(occupied.shape, bool)
        for step in range(1, int(reach / np.linalg.norm(direction)) + 1):
            met |= room[np.ix_(*(at + step * move for at, move in zip(inner, direction, strict=True)))]
        count += met
    return count


def assert_thresholds_agree(occupied, reach, count):
    for least in (1, 5, 9, 10, 16, 20, 26):
        found = is_enclosed(occupied, reach=reach, min_directions=least)
        assert found.dtype == bool
        np.testing.assert_array_equal(found, count >= least, err_msg=f"at least {least} directions")


@pytest.mark.parametrize("reach", [0.9, 1.0, 1.8, 5.5, 40.0])
@pytest.mark.parametrize("shape", [(7, 9, 5), (1, 6, 3), (2, 1, 1), (12, 4, 4)])
def test_counts_equal_rays_walked_step_by_step(shape, reach):
    occupied = np.random.default_rng(sum(shape)).random(shape) < 0.15
    count = walk(occupied, reach)
    np.testing.assert_array_equal(march(occupied, reach), count)
    assert_thresholds_agree(occupied, reach, count)


# Words hold 64 voxels along z: lengths below, at and above one word and two, and reaches of more than a word.
@pytest.mark.parametrize("depth", [1, 64, 65, 150])
@pytest.mark.parametrize("reach", [2.7, 70.3])
def test_columns_of_any_number_of_words(depth, reach):
    occupied = np.random.default_rng(depth).random((9, 6, depth)) < 0.04
    assert_thresholds_agree(occupied, reach, march(occupied, reach))


@pytest.mark.parametrize("seed", range(15))
def test_random_grids(seed):
    rng = np.random.default_rng(seed)
    shape = tuple(int(n) for n in rng.integers(1, rng.choice([4, 17, 30], 3)))
    occupied = rng.random(shape) < rng.choice([0.002, 0.02, 0.1, 0.4])
    reach = float(rng.choice([3.0, 15.0, 50.0]) * rng.random())
    assert_thresholds_agree(occupied, reach, march(occupied, reach))


# Tiles are 128 columns wide, more with a longer reach: walls face each other across seams, and most tiles are empty.
@pytest.mark.parametrize("shape", [(300, 5, 9), (5, 300, 9), (140, 150, 4)])
def test_rays_cross_the_seams_of_tiles(shape):
    occupied = np.zeros(shape, bool)
    rng = np.random.default_rng(0)
    for axis in (0, 1):
        if shape[axis] > 128:
            ends = (slice(None),) * axis + ([118, 139],)
            occupied[ends] = rng.random(occupied[ends].shape) < 0.8
    count = march(occupied, 25.0)
    assert (count > 9).any()
    assert_thresholds_agree(occupied, 25.0, count)


def test_the_middle_of_a_closed_box_is_enclosed_and_the_outside_is_not():
    occupied = np.zeros((15, 15, 15), bool)
    occupied[3:12, 3:12, 3:12] = True
    occupied[4:11, 4:11, 4:11] = False
    assert is_enclosed(occupied, reach=14.0, min_directions=26)[4:11, 4:11, 4:11].all()
    assert not is_enclosed(occupied, reach=14.0, min_directions=10)[1, 7, 7]


def test_an_empty_block_is_no_error():
    assert is_enclosed(np.zeros((0, 3, 3), bool), reach=5.0, min_directions=1).shape == (0, 3, 3)
    assert is_enclosed(np.zeros((3, 3, 0), bool), reach=5.0, min_directions=1).shape == (3, 3, 0)
    assert not is_enclosed(np.zeros((4, 3, 3), bool), reach=5.0, min_directions=1).any()


def test_a_large_empty_grid_takes_a_bit_a_voxel_beside_the_result(monkeypatch):
    # One core, so that there is one tile at a time.
    monkeypatch.setattr(threads, "num_cores", lambda: 1)
    occupied = np.zeros((600, 600, 64), bool)
    occupied[3:12, 3:12, 3:12] = True
    occupied[4:11, 4:11, 4:11] = False
    tracemalloc.start()
    try:
        enclosed = is_enclosed(occupied, reach=20.0, min_directions=20)
        most = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert enclosed.sum() == enclosed[4:11, 4:11, 4:11].sum() == 7**3
    assert most < 1.6 * occupied.size
