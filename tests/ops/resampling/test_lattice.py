"""The lattice of multiples of the voxel size: origins, the box that a moved grid can fill, and its limit."""

import numpy as np
import pytest

from oracles.motions import moved, pose_of, turned
from voxjax import InputError
from voxjax.ops.resampling.lattice import (
    about_middle,
    check_num_voxels,
    moved_bounds,
    origin_in_voxels,
    origin_of_cell,
)

SIZE = 0.1


def test_origins_near_the_lattice_lie_on_it_and_others_stay():
    cell = np.asarray([-7, 0, 1234])
    np.testing.assert_array_equal(origin_in_voxels(origin_of_cell(cell, SIZE), SIZE), cell)
    np.testing.assert_allclose(
        origin_in_voxels(np.asarray([0.05, -0.03, 0.3]), SIZE), [0.5, -0.3, 3.0], atol=1e-9
    )


@pytest.mark.parametrize("beside", [0.0, 1e-4, 9e-4, 0.03])
def test_a_local_frame_is_where_the_grid_is_also_just_beside_the_lattice(beside):
    origin = np.asarray([4e5, 5e6, -0.3]) + beside
    local, place = about_middle(origin, (5, 8, 1), SIZE)
    np.testing.assert_allclose(local + place, origin, rtol=0, atol=2e-9)
    np.testing.assert_array_equal(local, np.asarray([-2, -4, 0]) * SIZE)


TILTED, SHIFTED = turned("zyx", (0.7, -0.4, 2.0), (0.33, -1.2, 5.01)), pose_of(translation=(0.3, -0.2, 0.0))


@pytest.mark.parametrize("T", [TILTED, SHIFTED], ids=["tilted", "shifted"])
def test_the_box_holds_the_centres_that_the_moved_voxels_reach(T):
    states = np.zeros((9, 8, 7), np.uint8)
    states[2:5, 3, 1:6] = 1
    states[8, 7, 6] = 2
    origin = np.asarray([0.2, -0.4, 1.0])
    low, high = moved_bounds(states, origin, SIZE, T, SIZE)
    sides = [np.arange(a, b) for a, b in zip(low - 3, high + 3, strict=True)]
    cells = np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1).reshape(-1, 3)
    place = np.floor((moved(np.linalg.inv(T), (cells + 0.5) * SIZE) - origin) / SIZE + 1e-6).astype(int)
    is_inside = ((place >= 0) & (place < states.shape)).all(axis=1)
    is_known = np.zeros(len(place), bool)
    is_known[is_inside] = states[tuple(place[is_inside].T)] != 0
    filled = cells[is_known]
    assert len(filled) > 10
    assert (filled >= low).all()
    assert (filled < high).all()
    assert (high - low).max() < 30


def test_nothing_known_has_no_box_and_too_many_voxels_are_refused():
    low, high = moved_bounds(np.zeros((3, 3, 3), np.uint8), np.zeros(3), SIZE, turned("z", 0.3), SIZE)
    np.testing.assert_array_equal(low, high)
    check_num_voxels(np.asarray([10, 10, 10]), "the map", "do less", most=1000)
    with pytest.raises(
        InputError, match=r"the map would have 10 x 10 x 11 voxels, more than 1,000; do less\."
    ):
        check_num_voxels(np.asarray([10, 10, 11]), "the map", "do less", most=1000)
    with pytest.raises(InputError, match="placed in steps of"):
        moved_bounds(
            np.ones((3, 3, 3), np.uint8), np.zeros(3), SIZE, pose_of(translation=(1e17, 0.0, 0.0)), SIZE
        )
