"""Coarser maps that lead far starts."""

import numpy as np
import pytest

from oracles.motions import nudged, pose_error
from oracles.rooms import VOXEL
from voxjax.refinement.problems.coarse_to_fine import coarse_factors
from voxjax.refinement.refine import refine

POINTS = 512


def test_far_starts_are_led_along_coarser_maps(prepared, room):
    start = nudged(room[2], prepared[1].centroid, np.random.default_rng(10), metres=1.0, degrees=12)
    near = pose_error(
        refine(prepared[0], prepared[1], start, num_points=POINTS).T_a_b, room[2], prepared[1].centroid
    )
    led = refine(prepared[0], prepared[1], start, num_points=POINTS, max_distance=1.6)
    error = pose_error(led.T_a_b, room[2], prepared[1].centroid)
    assert error[1] < 0.3 * VOXEL < near[1]
    assert led.cost_after <= led.cost_before


@pytest.mark.parametrize(
    ("voxels", "factors"), [(0.5, []), (4.0, []), (4.1, [2]), (8.0, [2]), (9.0, [4, 2]), (20.0, [8, 4, 2])]
)
def test_coarse_factors_reach_as_far_as_asked(voxels, factors):
    assert coarse_factors(voxels) == factors
