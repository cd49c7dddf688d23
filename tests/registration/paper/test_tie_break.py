import numpy as np

from oracles.matching import fused_voxels
from oracles.motions import moved, random_pose
from voxjax import VoxelGrid
from voxjax.registration.paper.tie_break import count_fused_voxels, select_scheme


def random_grid(seed, shape=(9, 8, 7)):
    rng = np.random.default_rng(seed)
    return VoxelGrid(
        rng.integers(0, 3, shape).astype(np.uint8), rng.uniform(-2, 2, 3).astype(np.float32), 0.2
    )


def test_count_equals_voxel_by_voxel():
    for seed in range(8):
        a, b = random_grid(seed), random_grid(seed + 100)
        T = random_pose(np.random.default_rng(seed), metres=0.5, degrees=60)
        points = b.occupied_points()
        expected = fused_voxels(np.asarray(a.states), np.asarray(a.origin, np.float64), 0.2, points, T)
        # A centre on the face between two voxels may fall either way in float32.
        assert abs(count_fused_voxels(a, points, T.astype(np.float32)) - expected) <= 1


def test_a_map_fuses_wholly_with_itself_and_not_at_all_far_away():
    a = random_grid(1)
    points = a.occupied_points()
    assert count_fused_voxels(a, points, np.eye(4, dtype=np.float32)) == a.num_occupied
    far = np.eye(4, dtype=np.float32)
    far[0, 3] = 100.0
    assert count_fused_voxels(a, points, far) == 0


def test_the_scheme_with_most_fused_voxels_wins_wherever_it_stands():
    a = random_grid(2)
    shifts = {0: 5.0, 1: 0.2, 2: 0.0}

    def align(scheme):
        T = np.eye(4)
        T[0, 3] = shifts[int(scheme[0, 0])]
        return T

    schemes = [np.array([[k, k]], np.int32) for k in (0, 1, 2)]
    best, poses, counts = select_scheme(a, a.occupied_points(), schemes, align)
    assert best == 2
    assert counts[2] == a.num_occupied == counts.max()
    np.testing.assert_array_equal(poses[2], np.eye(4))
    assert select_scheme(a, a.occupied_points(), schemes[::-1], align)[0] == 0


def test_of_equals_the_first_wins():
    a = random_grid(3)
    schemes = [np.array([[k, k]], np.int32) for k in (5, 4)]
    assert select_scheme(a, a.occupied_points(), schemes, lambda _: np.eye(4))[0] == 0


def test_points_are_moved_by_the_pose_from_b_to_a():
    a = random_grid(4)
    T = random_pose(np.random.default_rng(4))
    points_b = moved(np.linalg.inv(T), a.occupied_points()).astype(np.float32)
    assert count_fused_voxels(a, points_b, T.astype(np.float32)) >= 0.99 * a.num_occupied
