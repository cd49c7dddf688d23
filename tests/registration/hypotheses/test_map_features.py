"""Features of a map: what is made at once, and what on demand and once."""

import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from small_worlds import draw_map, pose
from voxjax.maps.settings import MapConfig
from voxjax.pipeline.config import config_from
from voxjax.pipeline.features import features_at
from voxjax.planes.settings import PlaneConfig
from voxjax.registration.hypotheses.map_features import LateFeatures, map_features


def test_directions_are_those_of_the_walls_and_the_rest_is_made_once():
    T = pose(yaw=25.0, tilt=10.0)
    features = map_features(draw_map(T), max_virtual=8)
    assert features.free_space == "observed"
    across = np.abs(features.directions[:3] @ T[:3, :3])
    np.testing.assert_allclose(np.sort(across.max(axis=1)), 1.0, atol=0.01)
    assert (np.diff(features.shares) <= 0).all()
    assert features.corners is features.corners
    first, again = (features.late.descriptors(use_free_space=True, finest=0) for _ in range(2))
    assert first is again
    assert features.late.finest_level == 0


def test_corners_of_two_maps_are_found_side_by_side(monkeypatch):
    both, found = threading.Barrier(2), map_features(draw_map(), max_virtual=8).corners

    def find(self):
        both.wait(timeout=20)
        return found

    monkeypatch.setattr(LateFeatures, "_find_corners", find)
    late = [LateFeatures(draw_map(), max_virtual=8) for _ in range(2)]
    with ThreadPoolExecutor(2) as threads:
        assert all(each is found for each in threads.map(lambda each: each.corners, late))


def test_two_planes_make_no_corner():
    grid = draw_map()
    assert map_features(grid, plane=PlaneConfig(max_planes=2)).corners.num_listed == 0
    settings = config_from({"plane": {"max_planes": 2}})
    assert features_at(grid, voxel_size=grid.voxel_size, config=settings).corners.num_listed == 0


def test_corners_of_a_map_of_many_voxels_are_found_in_wider_ones():
    grid = draw_map()
    fine = map_features(grid, max_virtual=0).corners.trimmed()
    fewer = MapConfig(max_planar=grid.num_occupied // 2)
    wide = map_features(grid, max_virtual=0, settings=fewer).corners.trimmed()
    assert 0 < len(wide.position) <= len(fine.position)
    gaps = np.linalg.norm(np.asarray(wide.position)[:, None] - np.asarray(fine.position), axis=2).min(axis=1)
    assert np.median(gaps) < grid.voxel_size
    assert not np.array_equal(np.asarray(wide.position), np.asarray(fine.position))
