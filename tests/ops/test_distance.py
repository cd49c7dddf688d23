"""Distance field: equal to a brute-force search and to SciPy's transform, whatever the shape."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

import voxjax as vx
from oracles.evidence import nearest_brute_force
from voxjax.ops.distance import MAX_RADIUS, distance_field
from voxjax.ops.evidence.nearest import nearest_field, split_keys


def brute_force(occupied, radius):
    """Distance [voxel] and flat index of the nearest occupied voxel; the lowest one on ties."""
    index = np.argwhere(occupied)
    if not len(index):
        return np.full(occupied.shape, float(radius)), np.full(occupied.shape, -1)
    cells = np.argwhere(np.ones_like(occupied))
    squared = ((cells[:, None, :] - index[None, :, :]) ** 2).sum(-1)
    row = squared.argmin(axis=1)
    best = squared[np.arange(len(cells)), row]
    flat = np.ravel_multi_index(tuple(index[row].T), occupied.shape)
    distance = np.minimum(np.sqrt(best), radius)
    return distance.reshape(occupied.shape), np.where(best <= radius**2, flat, -1).reshape(occupied.shape)


@settings(max_examples=25, deadline=None)
@given(
    st.sampled_from([(9, 8, 7), (1, 1, 20), (1, 17, 2), (6, 1, 5), (1, 1, 1)]),
    st.sampled_from([1, 5, 8]),
    st.sampled_from([0.0, 0.01, 0.1, 1.0]),
    st.integers(0, 2**31),
)
def test_field_equals_brute_force(shape, radius, share, seed):
    occupied = np.random.default_rng(seed).random(shape) < share
    distance, nearest = distance_field(occupied, radius=radius, voxel_size=0.1)
    expected, expected_nearest = brute_force(occupied, radius)
    np.testing.assert_allclose(distance, 0.1 * expected, rtol=1e-6)
    np.testing.assert_array_equal(nearest, expected_nearest)


@pytest.mark.parametrize("radius", [2, MAX_RADIUS])
def test_field_is_scipys_truncated(radius):
    occupied = np.random.default_rng(radius).random((40, 33, 50)) < 5e-4
    distance, nearest = map(np.asarray, distance_field(occupied, radius=radius, voxel_size=1.0))
    exact = np.asarray(ndimage.distance_transform_edt(~occupied))
    np.testing.assert_allclose(distance, np.minimum(exact, radius), rtol=1e-6)
    np.testing.assert_array_equal(nearest >= 0, exact <= radius)
    assert occupied.reshape(-1)[nearest[nearest >= 0]].all()


def test_rows_of_nearest_field_are_the_same_voxels():
    occupied = np.random.default_rng(4).random((20, 18, 16)) < 0.01
    index = np.argwhere(occupied).astype(np.int32)
    dims = np.asarray(occupied.shape, np.int32)
    keys = nearest_field(index, np.ones(len(index), bool), dims, flat_size=occupied.size, radius=7)
    row, squared = map(np.asarray, split_keys(keys))
    flat = np.ravel_multi_index(tuple(index.T), occupied.shape)
    expected = np.where(squared < 63, flat[np.minimum(row, len(flat) - 1)], -1)
    nearest = distance_field(occupied, radius=7, voxel_size=1.0).nearest
    np.testing.assert_array_equal(np.asarray(nearest).reshape(-1), expected)
    oracle_squared, _ = nearest_brute_force(index, occupied.shape, 7)
    np.testing.assert_array_equal(squared, oracle_squared)


def test_turned_grids_give_turned_distances():
    occupied = np.random.default_rng(2).random((12, 9, 15)) < 0.01
    for axes in ((1, 2, 0), (2, 1, 0)):
        turned = distance_field(np.transpose(occupied, axes), radius=6, voxel_size=1.0).distance
        whole = np.asarray(distance_field(occupied, radius=6, voxel_size=1.0).distance)
        np.testing.assert_array_equal(turned, np.transpose(whole, axes))


def test_the_field_works_under_jit_and_vmap_and_keeps_its_dtypes():
    occupied = jnp.asarray(np.random.default_rng(5).random((3, 8, 9, 10)) < 0.02)
    sizes = jnp.asarray([0.1, 0.2, 0.4], jnp.float32)
    batch = jax.jit(jax.vmap(lambda o, s: distance_field(o, radius=4, voxel_size=s)))(occupied, sizes)
    assert batch.distance.dtype == jnp.float32
    assert batch.nearest.dtype == jnp.int32
    for k in range(3):
        single = distance_field(occupied[k], radius=4, voxel_size=float(sizes[k]))
        np.testing.assert_allclose(batch.distance[k], single.distance, rtol=1e-6)
        np.testing.assert_array_equal(batch.nearest[k], single.nearest)


@pytest.mark.parametrize("radius", [0, 16])
def test_a_radius_that_does_not_fit_is_refused(radius):
    with pytest.raises(vx.InputError, match="radius"):
        distance_field(np.zeros((2, 2, 2), bool), radius=radius, voxel_size=1.0)


def test_a_voxel_size_that_is_not_positive_is_refused():
    with pytest.raises(vx.InputError, match="voxel_size"):
        distance_field(np.zeros((2, 2, 2), bool), radius=2, voxel_size=0.0)
