import numpy as np
import pytest

from oracles.motions import pose_error, pose_of, random_rotation
from voxjax import InputError, VoxelGrid
from voxjax.matching.descriptors import describe_map
from voxjax.registration.hypotheses.descriptors import descriptor_hypotheses

VOXEL = 0.1


def inside_of(points, seed):
    """Which points lie inside solid matter: outside the room, in one of its boxes or in a slanted prism."""
    rng = np.random.default_rng(seed)
    room = np.array([6.0, 4.5, 2.6])
    solid = ((points < 0.0) | (points > room)).any(axis=-1)
    for _ in range(20):
        size = rng.uniform([0.4, 0.4, 0.4], [1.4, 1.2, 1.8])
        offset = points - (rng.uniform([0, 0, 0], [*(room - size)[:2], 0.3]) + size / 2)
        c, s = np.cos(turn := rng.uniform(0, np.pi)), np.sin(turn)
        turned = offset @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        solid |= (np.abs(turned) < size / 2).all(axis=-1)
    return solid | (points[..., 0] + 0.6 * points[..., 1] < 1.2)


def scan(T, seed=0, cut=None):
    """Map of the world seen in a frame: voxels at the surface are occupied, the inside of the room free."""
    low, shape = np.array([-4.5, -4.5, -4.5]), (90, 90, 90)
    index = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), -1)
    local = low + VOXEL * (index + 0.5)
    world = local @ T[:3, :3].T + T[:3, 3]
    solid = inside_of(world, seed)
    near_free = np.zeros(shape, bool)
    for axis in range(3):
        near_free |= np.roll(~solid, 1, axis) | np.roll(~solid, -1, axis)
    states = np.where(solid & near_free, 2, np.where(solid, 0, 1)).astype(np.uint8)
    if cut is not None:
        states[cut(world)] = 0
    return VoxelGrid(states, low.astype(np.float32), VOXEL)


def pose(seed, centre):
    """Random rotation of a frame whose origin is near `centre` of the world."""
    rng = np.random.default_rng(seed)
    return pose_of(random_rotation(rng), np.asarray(centre) + rng.uniform(-0.2, 0.2, 3))


CENTRE = (3.0, 2.25, 1.3)


@pytest.fixture(scope="module")
def views():
    T_a, T_b = pose(1, CENTRE), pose(2, CENTRE)
    a = scan(T_a, cut=lambda p: p[..., 0] > 5.0)
    b = scan(T_b, cut=lambda p: p[..., 0] < 1.0)
    return a, b, np.linalg.inv(T_a) @ T_b


@pytest.mark.parametrize("use_free_space", [True, False])
def test_the_best_hypothesis_of_two_overlapping_maps_is_the_true_pose(views, use_free_space):
    a, b, truth = views
    described = [describe_map(m, spacing=0.2, use_free_space=use_free_space) for m in (a, b)]
    poses, sizes = descriptor_hypotheses(*described)
    angle, shift = pose_error(poses[0], truth, np.zeros(3))
    assert angle < 6.0
    assert shift < 0.25
    assert sizes[0] > sizes[1:].max(initial=0)


def test_exchanging_the_maps_inverts_the_best_pose(views):
    a, b, truth = views
    poses, _ = descriptor_hypotheses(describe_map(b, spacing=0.2), describe_map(a, spacing=0.2))
    angle, shift = pose_error(poses[0], np.linalg.inv(truth), np.zeros(3))
    assert angle < 6.0
    assert shift < 0.25


def test_hypotheses_are_rigid_distinct_sorted_and_repeatable(views):
    a, b = (describe_map(m) for m in views[:2])
    poses, sizes = descriptor_hypotheses(a, b, max_hypotheses=5)
    assert poses.dtype == np.float32
    assert sizes.dtype == np.int32
    assert len(poses) == len(sizes) <= 5
    assert (np.diff(sizes) <= 0).all()
    assert (sizes >= 3).all()
    rotations = poses[:, :3, :3]
    np.testing.assert_allclose(
        rotations @ rotations.swapaxes(1, 2), np.broadcast_to(np.eye(3), rotations.shape), atol=1e-5
    )
    np.testing.assert_allclose(np.linalg.det(rotations), 1.0, atol=1e-5)
    for i in range(len(poses)):
        for j in range(i):
            angle, shift = pose_error(poses[i], poses[j], np.zeros(3))
            assert angle > 9.0 or shift > 0.5
    again, sizes_again = descriptor_hypotheses(*(describe_map(m) for m in views[:2]), max_hypotheses=5)
    np.testing.assert_array_equal(again, poses)
    np.testing.assert_array_equal(sizes_again, sizes)


def test_maps_with_next_to_nothing_give_no_hypothesis(views):
    states = np.zeros((6, 6, 6), np.uint8)
    empty = describe_map(VoxelGrid(states, np.zeros(3, np.float32), VOXEL), use_free_space=False)
    states[2, 3, 1] = 2
    one = describe_map(VoxelGrid(states, np.zeros(3, np.float32), VOXEL), use_free_space=False)
    room = describe_map(views[0], use_free_space=False)
    for a, b in ((empty, empty), (one, one), (empty, room), (room, one)):
        poses, sizes = descriptor_hypotheses(a, b)
        assert poses.shape == (0, 4, 4)
        assert sizes.shape == (0,)


def test_descriptors_that_cannot_be_compared_are_refused(views):
    room = describe_map(views[0])
    with pytest.raises(InputError, match="sign their normals alike"):
        descriptor_hypotheses(room, describe_map(views[1], use_free_space=False))
    with pytest.raises(InputError, match="spacing in common"):
        descriptor_hypotheses(room, describe_map(views[1], spacing=0.15))
    with pytest.raises(InputError, match="max_hypotheses must be 1 or more"):
        descriptor_hypotheses(room, room, max_hypotheses=0)
