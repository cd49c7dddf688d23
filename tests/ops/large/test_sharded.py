import functools
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from host_devices import lines_of, start, start_joined
from oracles import sliding_window
from voxjax._checks import InputError
from voxjax.ops.large.sharded import gather_shards, map_shards, shard_grid
from voxjax.ops.window.classes import box_count, count_change

WORKER = Path(__file__).parent / "sharded_worker.py"
COUNT_5 = functools.partial(box_count, size=5)


def _mesh(shape=(2,)):
    return jax.make_mesh(shape, ("x", "y", "z")[: len(shape)])


def _random(shape, share=0.3, seed=0):
    return np.random.default_rng(seed).random(shape) < share


def test_counts_over_two_four_and_eight_devices_equal_the_definition():
    (lines,) = lines_of([start(WORKER, ["devices"], devices=8)])
    assert lines == [
        "equal on 2 devices as (2,)",
        "equal on 4 devices as (4,)",
        "equal on 8 devices as (8,)",
        "equal on 8 devices as (4, 2)",
        "equal on 8 devices as (2, 2, 2)",
    ]


def test_counts_over_two_processes_equal_the_definition():
    lines = lines_of(start_joined(WORKER, [], processes=2, devices=2))
    assert lines == [["equal on 4 devices as (4,)", "equal on 4 devices as (2, 2)"]] * 2


@settings(max_examples=10, deadline=None)
@given(st.sampled_from([(1, 1, 1), (2, 9, 4), (13, 3, 8), (16, 8, 8)]), st.sampled_from([2, 3]))
def test_shapes_that_do_not_divide_are_padded_and_cut(shape, max_halo):
    occupied = _random(shape, seed=sum(shape))
    grid = shard_grid(occupied, _mesh(), max_halo=max_halo)
    assert grid.values.shape[0] % 2 == 0
    assert not np.asarray(grid.values)[shape[0] :].any()
    np.testing.assert_array_equal(gather_shards(grid), occupied)
    counts = gather_shards(map_shards(COUNT_5, grid, halo=2))
    np.testing.assert_array_equal(counts, sliding_window.window_count(occupied, 5))
    assert counts.dtype == np.uint16


def test_padding_stays_empty_for_the_next_kernel():
    occupied = np.ones((5, 4, 4), bool)
    counts = map_shards(COUNT_5, shard_grid(occupied, _mesh()), halo=2)
    assert counts.values.shape[0] > 5
    assert not np.asarray(counts.values)[5:].any()


def test_kernels_may_add_axes():
    occupied = _random((14, 8, 7), 0.4)
    changes = functools.partial(count_change, size=3, shift=2)
    result = gather_shards(map_shards(changes, shard_grid(occupied, _mesh()), halo=3))
    np.testing.assert_array_equal(result, sliding_window.changes(occupied, 3, 2))


def test_the_same_kernel_is_traced_once():
    traces = []

    def kernel(block):
        traces.append(block.shape)
        return box_count(block, size=3)

    for seed in range(2):
        map_shards(kernel, shard_grid(_random((16, 4, 5), seed=seed), _mesh()), halo=1)
    assert traces == [(10, 4, 5)]


def test_gradients_cross_the_border_between_devices():
    values = np.random.default_rng(0).random((14, 3, 4)).astype(np.float32)
    mesh = jax.sharding.Mesh(np.asarray(jax.devices()[:2]), ("x",))

    def blurred(block):
        padded = jnp.pad(block, ((1, 1), (0, 0), (0, 0)))
        return padded[:-2] + 2 * padded[1:-1] + padded[2:]

    def loss(values, kernel):
        return jnp.sum(kernel(values) ** 2, dtype=jnp.float32)

    grid = shard_grid(values, mesh)
    sharded = jax.grad(lambda g: jnp.sum(map_shards(blurred, g, halo=1).values ** 2, dtype=jnp.float32))(grid)
    expected = jax.grad(loss)(jnp.asarray(values), blurred)
    # Sums of at most nine products of float32.
    np.testing.assert_allclose(gather_shards(sharded), np.asarray(expected), rtol=1e-5)


def test_wide_default_types_change_nothing():
    occupied = _random((13, 6, 5))
    with jax.enable_x64(True):
        counts = map_shards(COUNT_5, shard_grid(occupied, _mesh()), halo=2)
    np.testing.assert_array_equal(gather_shards(counts), sliding_window.window_count(occupied, 5))


def test_requests_that_cannot_be_met_are_refused():
    grid = shard_grid(np.zeros((8, 8, 8), bool), _mesh(), max_halo=2)
    with pytest.raises(InputError, match="at most 4 voxels, the thickness of a part"):
        map_shards(COUNT_5, grid, halo=5)
    with pytest.raises(InputError, match="halo must be 0"):
        map_shards(COUNT_5, grid, halo=-1)
    with pytest.raises(InputError, match="keep the shape"):
        map_shards(lambda block: block[1:], grid, halo=1)
    with pytest.raises(InputError, match="max_halo"):
        shard_grid(np.zeros((8, 8, 8), bool), _mesh(), max_halo=-1)
    with pytest.raises(InputError, match="must have voxels"):
        shard_grid(np.zeros((0, 8, 8), bool), _mesh())
    with pytest.raises(InputError, match="one to three axes"):
        shard_grid(np.zeros((8, 8, 8), bool), jax.make_mesh((1, 1, 1, 2), ("a", "b", "c", "d")))
