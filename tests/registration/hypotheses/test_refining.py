"""Quick refinement of poses between two prepared maps."""

import numpy as np

from small_worlds import draw_map, pose
from voxjax.maps.prepared import prepare_map
from voxjax.metrics import pose_error
from voxjax.registration.hypotheses.refining import refine_poses


def test_poses_some_voxels_off_are_pulled_in_and_the_others_keep_their_rows():
    T_map_world = pose(yaw=20.0, translation=(1.0, 2.0, 0.0))
    a, b = prepare_map(draw_map(voxel_size=0.16)), prepare_map(draw_map(T_map_world, voxel_size=0.16))
    truth = np.linalg.inv(T_map_world)
    off, lost = (
        truth @ pose(yaw=2.0, translation=(0.2, -0.2, 0.1)),
        truth @ pose(translation=(300.0, 0.0, 0.0)),
    )
    starts = np.stack([lost, off]).astype(np.float32)
    refined = refine_poses(
        a, b, starts, num_points=1024, num_steps=15, start_distance=5.0, final_distance=1.5
    )
    error = pose_error(refined[1].astype(np.float64), truth, np.asarray(b.centroid, np.float64))
    assert error.metres < 0.05
    assert error.degrees < 0.5
    # What meets nothing stays where it is.
    np.testing.assert_allclose(refined[0], lost, atol=1e-4)
