import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oracles.raycast import crossed_by_clipping
from voxjax.ops.resampling import raycast
from voxjax.ops.resampling.raycast import crossed_voxels, mark_crossed_voxels

SHAPE = (9, 7, 5)
ROUNDING = 1e-4  # voxels: float32 may give or withhold a voxel that the ray only touches


def places(seed, count):
    rng = np.random.default_rng(seed)
    return rng.uniform(0.0, 1.0, (count, 3)) * np.asarray(SHAPE)


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_crossed_voxels_are_those_that_hold_a_piece_of_the_ray(seed):
    start, end = places(seed, 2)
    marked = crossed_voxels(start[None], end[None], SHAPE)
    length = crossed_by_clipping(start, end, SHAPE)
    assert marked[length > ROUNDING].all()
    assert not marked[length < -ROUNDING].any()
    steps = np.abs(np.floor(end) - np.floor(start)).sum()
    assert marked.sum() == steps + 1


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("sign", [1, -1])
def test_ray_along_an_axis_crosses_a_straight_row(axis, sign):
    start = np.full(3, 2.5)
    end = start.copy()
    end[axis] += sign * 2
    marked = crossed_voxels(start[None], end[None], SHAPE)
    index = np.argwhere(marked)
    assert len(index) == 3
    assert set(index[:, axis]) == {2, 2 + sign, 2 + 2 * sign}


def test_many_rays_mark_the_union_whatever_the_batches(monkeypatch):
    starts, ends = places(1, 300), places(2, 300)
    whole = crossed_voxels(starts, ends, SHAPE)
    monkeypatch.setattr(raycast, "_RAYS_PER_BATCH", 64)
    assert np.array_equal(whole, crossed_voxels(starts, ends, SHAPE))
    single = [crossed_voxels(s[None], e[None], SHAPE) for s, e in zip(starts[:20], ends[:20], strict=True)]
    assert np.array_equal(np.any(single, axis=0), crossed_voxels(starts[:20], ends[:20], SHAPE))


def test_masked_rays_mark_nothing():
    index = jnp.zeros((2, 3), jnp.int32)
    offset = jnp.full((2, 3), 0.5, jnp.float32)
    strides = jnp.asarray([35, 5, 1], jnp.int32)
    ends = jnp.asarray([[3, 0, 0], [0, 3, 0]], jnp.int32)
    mask = jnp.asarray([True, False])
    marked = mark_crossed_voxels(jnp.zeros(315, bool), index, offset, ends, offset, strides, mask)
    assert np.flatnonzero(np.asarray(marked)).tolist() == [0, 35, 70, 105]


def test_a_ray_over_a_border_by_less_than_float32_tells_reaches_its_end():
    for axis in range(3):
        start = np.full(3, 2.5)
        start[axis] = 3.0 - 1e-12
        end = np.full(3, 2.5)
        end[axis] = 3.0
        other = 0 if axis else 1
        end[other] += 2.0
        for first, last in ((start, end), (end, start)):
            marked = crossed_voxels(first[None], last[None], SHAPE)
            assert marked[tuple(np.floor(first).astype(int))]
            assert marked[tuple(np.floor(last).astype(int))]
            assert np.count_nonzero(marked) == 4
