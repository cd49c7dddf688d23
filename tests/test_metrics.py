import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from oracles.motions import pose_of
from voxjax.metrics import pose_error


@pytest.mark.parametrize("degrees", [0.0, 0.01, 1.0, 90.0, 179.0])
def test_error_is_the_angle_and_the_distance_of_the_images(degrees):
    truth = pose_of(Rotation.random(rng=np.random.default_rng(1)).as_matrix(), (1, 2, 3))
    point = np.asarray([4.0, -5.0, 6.0])
    T = truth.copy()
    T[:3, :3] = truth[:3, :3] @ Rotation.from_rotvec([0, 0, np.radians(degrees)]).as_matrix()
    T[:3, 3] += (0.3, 0.0, 0.4)
    error = pose_error(T, truth, point)
    assert abs(error.degrees - degrees) < 1e-6
    np.testing.assert_allclose(error.metres, np.linalg.norm(T[:3] @ [*point, 1] - truth[:3] @ [*point, 1]))
