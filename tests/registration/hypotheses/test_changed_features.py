"""Features of a mirrored map and of one of another scale, against those of maps that were changed before."""

import numpy as np
import pytest

from small_worlds import draw_map
from voxjax.maps.mirrored import mirrored_grid
from voxjax.registration.hypotheses.changed_features import mirrored_features, scaled_features
from voxjax.registration.hypotheses.map_features import map_features


@pytest.fixture(scope="module")
def features():
    return map_features(draw_map(), origin=np.asarray([100.0, -20.0, 3.0]), max_virtual=64)


def test_features_of_the_mirror_image_are_those_of_the_mirrored_map(features):
    found = mirrored_features(features)
    expected = map_features(mirrored_grid(features.prepared.grid), max_virtual=64)
    np.testing.assert_allclose(found.origin, [-100.0, -20.0, 3.0])
    # Directions are unsigned, and only the strongest are sure to come in the same order.
    np.testing.assert_allclose(np.abs(found.directions[:3]), np.abs(expected.directions[:3]), atol=1e-3)
    assert (found.normals[:, 0] == -features.normals[:, 0]).all()
    assert (found.normals[:, 1:] == features.normals[:, 1:]).all()
    assert found.free_space == features.free_space
    # Corners are those of the image, and not of the map.
    here, there = (
        np.asarray(each.corners.position)[np.asarray(each.corners.mask)] for each in (features, found)
    )
    apart = np.linalg.norm((here * [-1.0, 1.0, 1.0])[:, None] - there[None], axis=2).min(axis=1)
    assert np.median(apart) < 0.05


def test_features_of_a_larger_map_are_larger_and_lie_farther_away(features):
    found = scaled_features(features, 1.1)
    np.testing.assert_allclose(found.origin, 1.1 * features.origin)
    np.testing.assert_array_equal(found.normals, features.normals)
    assert found.prepared.grid.voxel_size == pytest.approx(1.1 * features.prepared.grid.voxel_size)
    assert found.late is not features.late
    assert not found.coarser
