"""The residuals between two maps that are asked for by name."""

from typing import Any

import numpy as np
import pytest

from voxjax import InputError
from voxjax.refinement.problems.pair import checked_residuals, pose_problem
from voxjax.refinement.residuals.distance import Distances
from voxjax.refinement.residuals.occupancy import Occupancies
from voxjax.refinement.residuals.planes import PointToPlane

WEIGHTS = {"planes": 1.0, "distances": 0.5, "occupancies": 0.3}


def test_each_kind_and_way_has_its_part_of_the_weight(prepared):
    problem = pose_problem(*prepared, residuals=WEIGHTS, num_points=256, both_ways=True)
    assert [type(term) for term in problem.terms] == [
        PointToPlane,
        PointToPlane,
        Distances,
        Distances,
        Occupancies,
        Occupancies,
    ]
    terms: list[Any] = list(problem.terms)
    assert [bool(term.is_inverse) for term in terms] == [False, True] * 3
    total = [float(np.sum(np.asarray(term.sample.weights))) for term in terms]
    np.testing.assert_allclose(total, [0.5, 0.5, 0.25, 0.25, 0.15, 0.15], rtol=1e-4)


def test_the_centre_is_that_of_the_map_that_moves(prepared):
    problem = pose_problem(*prepared, num_points=256)
    np.testing.assert_allclose(problem.centroid, prepared[1].centroid, atol=1e-5)
    assert 0.5 < float(problem.radius) < 10.0
    (term,) = problem.terms
    assert isinstance(term, PointToPlane)
    assert not term.is_inverse


@pytest.mark.parametrize(
    ("given", "word"), [({"corners": 1.0}, "among"), ({"planes": 0.0}, "positive"), ({}, "at least")]
)
def test_kinds_that_are_none_are_refused(given, word):
    with pytest.raises(InputError, match=word):
        checked_residuals(given)
    assert checked_residuals(None) == {"planes": 1.0}
