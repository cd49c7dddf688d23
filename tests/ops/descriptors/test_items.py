import numpy as np
import pytest

from bumpy_patches import bumpy_patch, describe, near
from oracles.descriptors import histograms
from voxjax.ops.descriptors import items as descriptor_items
from voxjax.ops.descriptors.fpfh import point_feature_histograms, surface_normals


def test_all_neighbours_count_however_many_there_are():
    points, normals = bumpy_patch(5, n=400)
    expected = histograms(points.astype(float), normals.astype(float), 0.9, 0.2, 11)
    near_all = near(points, 0.9)
    assert np.bincount(near_all.own).max() >= 3  # more than one item a tile
    found = point_feature_histograms(points, normals, near_all, radius=0.9, spacing=0.2)
    np.testing.assert_allclose(found, expected, atol=2e-3)


@pytest.mark.parametrize("items", [1, 3])
def test_pieces_do_not_change_the_results(items, monkeypatch):
    points, normals = bumpy_patch(5, n=150)
    whole = describe(points, normals), surface_normals(points, near(points, 0.6), radius=0.6)
    monkeypatch.setattr(descriptor_items, "_ITEMS", items)
    np.testing.assert_allclose(describe(points, normals), whole[0], atol=1e-6)
    parts = surface_normals(points, near(points, 0.6), radius=0.6)
    np.testing.assert_allclose(parts[0], whole[1][0], atol=1e-4)
    np.testing.assert_allclose(parts[1], whole[1][1], atol=1e-5)
