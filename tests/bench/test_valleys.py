"""Generated valleys: both maps show one ground, and the truth lays them onto each other."""

from dataclasses import replace

import numpy as np
import pytest
from bench.valleys import Valley, simulate_valley, valley_rows

from voxjax.synthetic import measure_overlap

SMALL = Valley(side=60.0, relief=4.0, houses=1500.0, trees=6000.0)


@pytest.mark.parametrize("has_free_space", [True, False])
def test_the_truth_lays_the_maps_onto_each_other(has_free_space):
    pair = simulate_valley(3, replace(SMALL, has_free_space=has_free_space))
    assert (pair.a.num_free > 0) == has_free_space
    moved = np.array(pair.T_a_b)
    at_truth = measure_overlap(pair.a, pair.b, moved)
    moved[2, 3] += 20.0
    # Half of each map is seen by both; twenty metres above the ground is nothing.
    assert at_truth > 0.35 > 0.1 > measure_overlap(pair.a, pair.b, moved)


def test_the_ground_lies_below_the_houses_and_the_air_above_it():
    grid = simulate_valley(4, SMALL).a
    states = np.asarray(grid.states)
    x, y = np.nonzero((states == 2).any(axis=2))
    lowest = (states == 2).argmax(axis=2)[x, y]
    highest = states.shape[2] - 1 - (states == 2)[:, :, ::-1].argmax(axis=2)[x, y]
    assert (highest - lowest).max() >= 5
    # Nothing is seen of what lies below the ground.
    below = np.arange(states.shape[2])[None, :] < (lowest - 2)[:, None]
    assert (states[x, y][below] == 1).mean() < 0.01


def test_rows_have_a_verdict_and_errors_for_each_kind_of_map():
    rows = list(valley_rows(5, (1.0,), width=48))
    assert [row["free space"] for row in rows] == ["from the air", "none"]
    # With the air between them known, the pose is trusted.
    assert rows[0]["verdict"] == "accepted"
    for row in rows:
        # Both poses are right: a wrong truth, or errors of another pose, would be tens of voxels.
        assert row["error [voxel]"] < 2.0
        assert row["error [deg]"] < 3.0
        assert row["seconds"] > 0.0
