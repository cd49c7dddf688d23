"""Rolling terrain from the air."""

import numpy as np
import pytest

from voxjax.synthetic import measure_overlap
from voxjax.synthetic.families.terrain import Valley, simulate_terrain, simulate_valley

PLAIN = {"overlap": 0.6, "changed": 0.0, "elsewhere": False, "frame": "yaw", "has_free_space": False}


def _terrain(seed, **options):
    return simulate_terrain(np.random.default_rng(seed), **{**PLAIN, **options})


@pytest.fixture(scope="module")
def plain():
    return _terrain(0)


def test_the_truth_lays_the_maps_onto_each_other(plain):
    a, b = plain.grids
    overlap = measure_overlap(a, b, plain.T_a_b)
    assert 0.4 < overlap < 0.75
    T = np.array(plain.T_a_b)
    T[:3, 3] += 10.0 * a.voxel_size
    assert measure_overlap(a, b, T) < 0.5 * overlap


def test_changed_houses_and_trees_lower_the_overlap_and_the_ground_stays(plain):
    other = _terrain(0, changed=1.0)
    np.testing.assert_array_equal(other.grids[0].states, plain.grids[0].states)
    assert other.T_a_b is not None
    before = measure_overlap(plain.grids[0], plain.grids[1], plain.T_a_b)
    after = measure_overlap(other.grids[0], other.grids[1], other.T_a_b)
    assert 0.5 * before < after < before - 0.01


def test_maps_of_two_valleys_have_no_truth():
    assert _terrain(0, elsewhere=True).T_a_b is None


def test_a_valley_is_the_same_for_the_same_seed():
    small = Valley(side=40.0, relief=3.0, has_free_space=False)
    first, second, third = (simulate_valley(seed, small) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.grids[1].states, second.grids[1].states)
    assert first.grids[1].shape != third.grids[1].shape
