"""Every translation of every rotation."""

import numpy as np
import pytest

from voxjax.metrics import pose_error
from voxjax.registration.hypotheses.exhaustive import (
    affordable_coarsening,
    exhaustive_hypotheses,
    upright_frame,
)
from voxjax.registration.hypotheses.settings import ExhaustiveConfig


def test_exhaustive_search_puts_the_truth_first(pair, exhaustive):
    a, b, truth = pair
    poses, scores = exhaustive(a, b)
    assert (np.diff(scores) <= 0).all()
    error = pose_error(poses[0], truth, np.asarray(b.prepared.centroid))
    assert error.degrees < 3.0
    assert error.metres < 0.5


def test_wider_cells_where_finer_ones_are_too_many(pair):
    a, b, truth = pair
    frame = upright_frame(a.directions, a.shares)
    options = {"conflict_weight": 3.0, "num_peaks": 1}
    fine, _ = exhaustive_hypotheses(a.prepared, b.prepared, truth[None, :3, :3], frame, **options)
    few = ExhaustiveConfig(max_cells=1, max_factor=4)
    wide, _ = exhaustive_hypotheses(
        a.prepared, b.prepared, truth[None, :3, :3], frame, settings=few, **options
    )
    centroid = np.asarray(b.prepared.centroid)
    assert not np.array_equal(fine, wide)
    assert pose_error(wide[0], truth, centroid).metres < 4 * a.prepared.grid.voxel_size


def test_no_rotation_gives_no_pose(pair):
    a, b, _ = pair
    poses, scores = exhaustive_hypotheses(
        a.prepared, b.prepared, np.zeros((0, 3, 3)), np.eye(3), conflict_weight=3.0
    )
    assert poses.shape == (0, 4, 4)
    assert scores.shape == (0,)


@pytest.mark.parametrize("directions", [np.zeros((0, 3)), np.eye(3)[:1], np.eye(3)])
def test_the_upright_frame_is_a_rotation_whatever_directions_there_are(directions):
    frame = upright_frame(directions, np.linspace(0.5, 0.1, len(directions)))
    np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(frame) > 0


def test_coarsening_is_the_least_whose_widest_cells_are_few_enough():
    settings = ExhaustiveConfig(max_factor=6, most_cells=1000)
    sides = np.array([120.0, 60.0, 30.0])
    assert affordable_coarsening(sides, settings) == 1  # 20 x 10 x 5 cells
    assert affordable_coarsening(sides + [1.0, 0.0, 0.0], settings) == 2
    assert affordable_coarsening(4.0 * sides, settings) == 4
