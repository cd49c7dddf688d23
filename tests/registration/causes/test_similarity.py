"""Alignment with a scale: it comes back to the truth, and knows how well."""

import numpy as np
import pytest

from voxjax.maps.mirrored import scaled
from voxjax.registration.causes.similarity import Samples, align_similarity

STEPS = {"num_steps": 20, "start_distance": 2.5, "final_distance": 1.0}


@pytest.mark.parametrize("factor", [1.0, 0.97, 1.04])
def test_the_scale_of_a_map_is_found_with_its_error(pair, factor):
    a, b, truth = (pair[0].prepared, scaled(pair[1].prepared, factor), pair[2])
    found = align_similarity(a, Samples.of(a, b, 2048), truth, **STEPS)
    assert abs(np.log(found.scale * factor)) < 3.0 * found.log_error
    assert found.log_error < 0.02
    # The similarity as a whole puts points of map b where the truth puts those of the map that was scaled.
    point = np.append(factor * np.asarray(pair[1].prepared.centroid, np.float64), 1.0)
    expected = truth @ [*(point[:3] / factor), 1.0]
    np.testing.assert_allclose((found.matrix @ point)[:3], expected[:3], atol=0.1)
    assert found.agreement > 0.3


def test_a_start_with_a_scale_is_one_of_the_scaled_map(pair):
    a, b, truth = (pair[0].prepared, scaled(pair[1].prepared, 1.3), pair[2])
    found = align_similarity(a, Samples.of(a, b, 1024), truth, scale=1.0 / 1.3, **STEPS)
    assert abs(found.scale * 1.3 - 1.0) < 0.01
    again = align_similarity(a, Samples.of(a, b, 1024), found.start.T_a_b, scale=found.start.scale, **STEPS)
    np.testing.assert_allclose(again.matrix, found.matrix, atol=0.01)


def test_maps_that_do_not_meet_have_no_scale(pair):
    a, b = pair[0].prepared, pair[1].prepared
    away = np.eye(4)
    away[:3, 3] = 1000.0
    found = align_similarity(a, Samples.of(a, b, 256), away, **STEPS)
    assert found.log_error == np.inf
    assert found.agreement == 0.0
    assert found.scale == 1.0


def test_errors_are_larger_where_the_surfaces_lie_near_together(pair):
    a, b, truth = pair[0].prepared, pair[1].prepared, pair[2]
    whole = Samples.of(a, b, 2048)
    image = whole.points @ truth[:3, :3].T + truth[:3, 3]
    is_near = np.linalg.norm(image - image.mean(axis=0), axis=1) < 2.0
    part = Samples(whole.points[is_near], whole.sides[is_near])
    errors = [align_similarity(a, some, truth, **STEPS).log_error for some in (whole, part)]
    assert errors[1] > 1.5 * errors[0]
