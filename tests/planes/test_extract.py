"""Planes of whole maps against the room they show."""

import equinox as eqx
import numpy as np
import pytest

from hand_made_surfaces import SIZE, room_grid
from oracles import box_room
from voxjax import InputError, VoxelGrid
from voxjax.planes.extract import extract_planes
from voxjax.planes.settings import PlaneConfig
from voxjax.planes.triples import intersect_planes


@pytest.mark.parametrize("turn", [np.eye(3), box_room.rotation((1, 2, 3), 0.7)], ids=["straight", "turned"])
def test_planes_of_a_room_are_good_to_six_tenths_of_a_degree(turn):
    grid, shift = room_grid(turn, noise=0.2)
    found = extract_planes(grid)
    planes = found.planes.trimmed()
    for axis in range(3):
        for sign in (1.0, -1.0):
            normal = turn[:, axis] * sign
            place = shift + (turn @ box_room.ROOM * SIZE if sign < 0 else 0.0)
            row = np.argmin(
                np.linalg.norm(planes.normal - normal, axis=1) + np.abs(planes.offset - normal @ place)
            )
            assert np.degrees(np.arccos(min(planes.normal[row] @ normal, 1.0))) < 0.6
            assert planes.offset[row] == pytest.approx(normal @ place, abs=0.25 * SIZE)
    assert (np.diff(planes.num_voxels) <= 0).all()
    counts = np.bincount(found.labels[found.labels >= 0], minlength=len(planes.num_voxels))
    np.testing.assert_array_equal(counts, planes.num_voxels)


def test_what_a_plane_is_can_be_set():
    grid, _ = room_grid(np.eye(3), noise=0.0)
    every = extract_planes(grid).planes
    assert extract_planes(grid, settings=PlaneConfig(max_planes=2)).planes.num_found == 2
    large = PlaneConfig(min_voxels=int(every.num_voxels[2]))
    assert extract_planes(grid, settings=large).planes.num_found == 3
    assert extract_planes(grid, settings=PlaneConfig(min_width=1_000.0)).planes.num_found == 0


def test_empty_maps_have_no_planes():
    found = extract_planes(VoxelGrid(np.zeros((4, 4, 4), np.uint8), np.zeros(3), SIZE))
    assert int(found.planes.num_found) == 0
    assert len(found.labels) == 0
    assert len(intersect_planes(found, reach=1.0, min_triple_product=0.4).planes) == 0
    assert eqx.tree_equal(found, found)


def test_a_map_far_from_its_frame_s_origin_is_refused():
    """Its surface elements are float32 in the map's frame, where they would lie on a few planes half a metre apart."""
    far = VoxelGrid(np.full((4, 4, 4), 2, np.uint8), [4e5, 5e6, 0.0], SIZE)
    with pytest.raises(InputError, match=r"reaches 5e\+06 m .* give grid\.localized\(\)"):
        extract_planes(far)
    assert extract_planes(far.localized()[0]).voxel_size == SIZE
