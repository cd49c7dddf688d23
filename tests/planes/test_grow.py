"""Region growing against the sequential loop."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from hand_made_surfaces import SIZE, surface_of
from oracles import surfaces
from voxjax import VoxelGrid
from voxjax.planes.grow import keep_large, segment_planes
from voxjax.planes.surface import find_surface


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**31))
def test_regions_equal_those_of_the_sequential_loop(seed):
    rng = np.random.default_rng(seed)
    index = np.argwhere(rng.random((7, 7, 3)) < 0.6)
    normal = rng.normal(size=(len(index), 3)) * 0.25 + [0, 0, 1.0]
    normal = (normal / np.linalg.norm(normal, axis=1, keepdims=True)).astype(np.float32)
    curvature = rng.uniform(0, 0.12, len(index)).astype(np.float32)
    surface = surface_of(index, normal, curvature)
    neighbours = [[] for _ in index]
    for i, j in surface.pairs.tolist():
        neighbours[i].append(j)
        neighbours[j].append(i)
    expected = surfaces.grow_regions(neighbours, surface.normal, surface.curvature, 15.0, 0.08)
    np.testing.assert_array_equal(segment_planes(surface, max_angle=15.0, max_curvature=0.08), expected)


def test_small_regions_lose_their_label():
    labels = np.asarray([0, 0, 1, 2, 2, 2, -1], np.int32)
    np.testing.assert_array_equal(keep_large(labels, 2), [0, 0, -1, 1, 1, 1, -1])
    np.testing.assert_array_equal(keep_large(labels, 9), np.full(7, -1))


def test_a_wall_seen_from_both_sides_has_two_faces():
    states = np.ones((14, 14, 9), np.uint8)
    states[:, :, 4] = 2
    surface = find_surface(VoxelGrid(states, np.zeros(3), SIZE))
    assert len(surface.index) == 2 * 14 * 14
    assert np.isclose(surface.normal[:, 2].sum(), 0.0, atol=1e-3)
    labels = segment_planes(surface)
    assert labels.max() == 1
    assert all(len({*np.sign(surface.normal[labels == k, 2])}) == 1 for k in (0, 1))
