"""What residuals need of a map: samples of its voxels, and tables."""

import numpy as np

from voxjax.refinement.problems.parts import centre_of, points_of, radius_of, sample_of, target_of
from voxjax.refinement.problems.views import hard_view


def test_samples_are_voxels_of_the_map_with_equal_weights(prepared):
    view = hard_view(prepared[0])
    sample = sample_of(view, 300)
    np.testing.assert_allclose(sample.weights, 1 / 300, rtol=1e-6)
    anchors = {tuple(row) for row in np.asarray(view.anchors)[: prepared[0].num_points].tolist()}
    assert {tuple(row) for row in np.asarray(sample.points).tolist()} <= anchors
    centre, radius = centre_of(view, 300)
    np.testing.assert_allclose(centre, prepared[0].centroid, atol=1e-5)
    distance = np.linalg.norm(np.asarray(sample.points) - np.asarray(sample.centroid), axis=1)
    np.testing.assert_allclose(radius, np.sqrt((distance**2).mean()), rtol=1e-5)
    np.testing.assert_allclose(radius_of(sample), radius, rtol=1e-6)


def test_only_what_the_kinds_read_is_made(prepared):
    view = hard_view(prepared[0])
    target = target_of(view, ("planes",))
    assert target.distances is None
    assert target.opinions is None
    target = target_of(view, ("distances", "occupancies"))
    assert target.distances is not None
    assert target.opinions is not None
    assert points_of(view, ("planes",), 50).opinions is None


def test_opinions_of_points_are_those_of_the_states(prepared):
    grid = prepared[0].grid
    opinions = points_of(hard_view(prepared[0]), ("occupancies",), 200).opinions
    assert opinions is not None
    sample, said = opinions
    place = np.floor((np.asarray(sample.points) - np.asarray(grid.origin)) / grid.voxel_size).astype(int)
    np.testing.assert_array_equal(np.where(np.asarray(grid.states)[tuple(place.T)] == 2, 1.0, -1.0), said)
    assert (np.asarray(said) == 1.0).sum() == (np.asarray(said) == -1.0).sum() == 100
