"""Generated sites: what is shared lies where the true pose says."""

import numpy as np
import pytest
from bench.sites import Site, paste, simulate_site

import voxjax as vx
from voxjax.synthetic import measure_overlap


@pytest.fixture(scope="module")
def pair():
    return simulate_site(5, Site(sides=(150.0, 50.0, 12.0), num_buildings=3, voxel_size=0.4))


def test_both_maps_show_the_part_that_they_share(pair):
    overlap = measure_overlap(pair.a, pair.b, pair.T_a_b)
    # Of the two buildings of map b map a has one, and a part of the roads.
    assert 0.25 < overlap < 0.75
    assert measure_overlap(pair.a, pair.b, np.eye(4)) < 0.1


def test_maps_are_kept_in_blocks_and_know_free_space(pair):
    for grid in (pair.a, pair.b):
        assert grid.is_sparse
        assert grid.num_free > grid.num_occupied > 1000
        assert max(grid.shape) > 150


def test_the_greatest_state_of_maps_that_overlap_is_kept():
    states = np.zeros((9, 9, 9), np.uint8)
    states[:5], states[4] = 1, 2
    one = vx.VoxelGrid(states, [0.3, -0.2, 0.1], 0.1)
    other = vx.VoxelGrid(states[::-1], [0.3, 0.1, 0.1], 0.1)
    pasted = paste([one, other])
    expected = np.zeros((9, 12, 9), np.uint8)
    expected[:, :9] = states
    expected[:, 3:] = np.maximum(expected[:, 3:], states[::-1])
    np.testing.assert_array_equal(pasted.states, expected)
    np.testing.assert_allclose(pasted.origin, [0.3, -0.2, 0.1])
