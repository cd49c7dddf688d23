"""The unit that brings two maps to one size, by their boxes, their voxels and the scatter of what is occupied."""

import numpy as np
import pytest

from small_worlds import draw_map, pose
from voxjax import VoxelGrid
from voxjax.registration.causes.units import FAR_UNITS, FEET, far_unit, feet_between

SEEN = ((-0.3, -0.3, -0.3), (6.5, 8.4, 3.0))


@pytest.fixture(scope="module")
def maps():
    return draw_map(), draw_map(pose(yaw=30.0, tilt=20.0), voxel_size=0.2, seen=SEEN)


def room(high, *, voxel_size=0.1):
    """A solid box with one corner at the origin."""
    shape = np.rint(np.asarray(high) / voxel_size).astype(int)
    return VoxelGrid(np.full(shape, 2, np.uint8), np.zeros(3), voxel_size)


@pytest.mark.parametrize("unit", FAR_UNITS)
def test_a_map_in_a_far_unit_is_brought_back(maps, unit):
    scaled = maps[1].placed(scale=1 / unit)
    assert far_unit(maps[0], scaled) == unit
    assert far_unit(scaled, maps[0]) == pytest.approx(1 / unit)
    assert feet_between(maps[0], scaled) is None


@pytest.mark.parametrize("unit", FEET)
def test_a_map_in_feet_is_brought_back_whatever_its_frame(maps, unit):
    scaled = maps[1].placed(scale=1 / unit)
    assert feet_between(maps[0], scaled) == unit
    assert far_unit(maps[0], scaled) is None


def test_parts_of_one_place_are_in_one_unit(maps):
    town, scan = room((40.0, 30.0, 6.0), voxel_size=0.5), room((0.8, 0.6, 0.4))
    storey, small = room((9.9, 6.0, 2.0)), room((3.0, 2.0, 2.0))
    for one, other in (maps, (town, scan), (storey, small)):
        for a, b in ((one, other), (other, one)):
            assert far_unit(a, b) is None
            assert feet_between(a, b) is None


def test_empty_maps_have_no_unit(maps):
    empty = VoxelGrid(np.zeros((2, 2, 2), np.uint8), np.zeros(3), 100.0)
    assert far_unit(maps[0], empty) is None
    assert far_unit(empty, maps[0]) is None
