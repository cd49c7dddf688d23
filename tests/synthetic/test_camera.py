"""Depth cameras."""

import numpy as np

from oracles.motions import pose_of
from voxjax.synthetic.camera import DepthCamera
from voxjax.synthetic.lidar import take_scan


def test_all_pixels_lie_in_the_field_of_view():
    camera = DepthCamera(field_of_view=(60.0, 40.0), num_pixels=(31, 21))
    rays = camera.directions()
    assert len(rays) == 31 * 21
    np.testing.assert_allclose(np.linalg.norm(rays, axis=1), 1.0)
    across, upright = (np.degrees(np.arctan2(rays[:, k], rays[:, 0])) for k in (1, 2))
    np.testing.assert_allclose((across.min(), across.max()), (-30.0, 30.0))
    np.testing.assert_allclose((upright.min(), upright.max()), (-20.0, 20.0))


def test_noise_grows_with_the_square_of_the_range():
    camera = DepthCamera(range_noise=0.01, max_range=4.0)
    np.testing.assert_allclose(camera.noise_at(np.asarray([1.0, 2.0, np.inf])), (0.01, 0.04, 0.16))


def test_a_picture_frees_nothing_where_it_has_no_echo(storey):
    T = pose_of(translation=[*storey.plan.rooms[0].polygon.mean(axis=0), 1.3])
    camera = DepthCamera(num_pixels=(20, 16), max_range=2.5)
    scan = take_scan(np.random.default_rng(0), storey.scene, T, camera)
    assert 0 < scan.num_hits < len(scan.points)
    assert np.linalg.norm(scan.points[: scan.num_hits], axis=1).max() < 2.7
    assert not scan.points[scan.num_hits :].any()
