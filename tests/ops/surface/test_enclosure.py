"""Enclosing directions against rays walked one by one."""

import numpy as np
import pytest

from voxjax.ops.surface.enclosure import DIRECTIONS, enclosing_directions


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


@pytest.mark.parametrize("reach", [0.9, 1.0, 1.8, 3.0, 5.5, 40.0])
@pytest.mark.parametrize("shape", [(7, 9, 5), (1, 6, 3), (2, 1, 1), (12, 4, 4)])
def test_counts_equal_rays_walked_step_by_step(shape, reach):
    occupied = np.random.default_rng(sum(shape)).random(shape) < 0.15
    np.testing.assert_array_equal(enclosing_directions(occupied, reach=reach), walk(occupied, reach))


def test_the_middle_of_a_closed_box_is_enclosed_and_the_outside_is_not():
    occupied = np.zeros((15, 15, 15), bool)
    occupied[3:12, 3:12, 3:12] = True
    occupied[4:11, 4:11, 4:11] = False
    count = enclosing_directions(occupied, reach=14.0)
    assert count[7, 7, 7] == 26
    assert (count[4:11, 4:11, 4:11] == 26).all()
    assert count[1, 7, 7] <= 9


def test_an_empty_block_is_no_error():
    assert enclosing_directions(np.zeros((0, 3, 3), bool), reach=5.0).shape == (0, 3, 3)
    assert not enclosing_directions(np.zeros((4, 3, 3), bool), reach=5.0).any()
