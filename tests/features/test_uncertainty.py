from typing import get_args

import numpy as np
import pytest
from scipy.spatial import KDTree

from oracles import box_room
from voxjax import VoxelGrid, detect_corners
from voxjax.features.paper import paper_corners
from voxjax.synthetic import simulate_team
from voxjax.synthetic.team import Frame

SIZE = 0.1


def room(turn, voxel_size=SIZE, **options):
    states, vector = box_room.room_map(turn, **options)
    return VoxelGrid(states, np.zeros(3, np.float32), voxel_size), (vector + 0.5) * voxel_size


def covariances(corners):
    assert corners.covariance is not None
    return np.asarray(corners.covariance)


def test_errors_on_generated_maps_are_as_large_as_the_covariance_says():
    squared = []
    for seed, frame in zip((21, 22, 23), get_args(Frame), strict=True):
        team = simulate_team(seed, num_robots=1, frame=frame, drift=0.015)
        assert team.poses[0] is not None
        T_map_world = np.linalg.inv(team.poses[0])
        true = team.corners.position @ T_map_world[:3, :3].T + T_map_world[:3, 3]
        found = detect_corners(team.grids[0]).trimmed()
        gap, row = KDTree(true).query(found.position)
        # Farther ones are other corners, or none.
        good = gap < 3 * SIZE
        error = (np.asarray(found.position) - true[row])[good].astype(np.float64)
        inverse = np.linalg.inv(covariances(found)[good].astype(np.float64))
        squared.append(np.einsum("ni,nij,nj->n", error, inverse, error))
    squared = np.concatenate(squared)
    assert len(squared) > 300
    # Chi squared with three degrees of freedom: 2.4 and 7.8. Errors of one map are not independent of each other.
    assert 1.2 < np.median(squared) < 3.6
    assert 4.0 < np.percentile(squared, 95) < 14.0


def test_covariances_are_symmetric_positive_and_zero_in_padding():
    corners = detect_corners(room(box_room.rotation((1.0, -2.0, 0.7), 0.9))[0], virtual=True)
    assert covariances(corners).dtype == np.float32
    assert covariances(corners).shape == (len(corners.mask), 3, 3)
    assert not covariances(corners)[~np.asarray(corners.mask)].any()
    listed = covariances(corners.trimmed())
    np.testing.assert_allclose(listed, np.swapaxes(listed, 1, 2), rtol=1e-4, atol=1e-9)
    assert (np.linalg.eigvalsh(listed) > 0).all()


def test_a_hidden_corner_is_less_certain_than_a_seen_one():
    states, vector = box_room.room_map(np.eye(3))
    low = np.floor(vector).astype(int)
    states[low[0] - 1 : low[0] + 9, low[1] - 1 : low[1] + 9, low[2] - 1 : low[2] + 9] = 0
    place = (vector + 0.5) * SIZE
    hidden = detect_corners(VoxelGrid(states, np.zeros(3, np.float32), SIZE), virtual=True).trimmed()
    seen = detect_corners(room(np.eye(3))[0], virtual=True).trimmed()
    sizes = []
    for corners, at in ((hidden, place), (seen, room(np.eye(3))[1])):
        row = np.argmin(np.linalg.norm(corners.position - at, axis=1))
        sizes.append(np.trace(covariances(corners)[row]))
    assert sizes[0] > sizes[1]


def test_covariance_grows_with_the_square_of_the_voxel_size():
    turn = box_room.rotation((0, 0, 1), 0.4)
    small, large = (detect_corners(room(turn, voxel_size)[0]).trimmed() for voxel_size in (0.1, 0.2))
    np.testing.assert_allclose(
        np.sort(np.trace(covariances(large), axis1=1, axis2=2)),
        4.0 * np.sort(np.trace(covariances(small), axis1=1, axis2=2)),
        rtol=1e-2,
    )


def test_corners_of_the_paper_preset_are_known_to_the_tolerance():
    corners = paper_corners(room(np.eye(3), thickness=0.5)[0], plane_distance_tolerance=1.5).corners
    expected = np.eye(3) * (1.5 * SIZE) ** 2 / 3.0
    np.testing.assert_allclose(covariances(corners), np.tile(expected, (len(corners.mask), 1, 1)), rtol=1e-5)


@pytest.mark.parametrize("virtual", [False, True])
def test_maps_without_corners_have_no_covariance_but_padding(virtual):
    corners = detect_corners(VoxelGrid(np.zeros((4, 4, 4), np.uint8), np.zeros(3), SIZE), virtual=virtual)
    assert not covariances(corners).any()
