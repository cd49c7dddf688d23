"""Pools of one map: the same cells by slabs, by one kernel and tile by tile, which are found as in dense fields."""

import contextlib

import jax
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from device_path import device_path
from near_fields import dense_field
from oracles.evidence import nearest_brute_force
from voxjax._checks import InputError
from voxjax.ops.blocks.block_builder import BlockBuilder, blocks_of
from voxjax.ops.evidence.align import align_poses
from voxjax.ops.evidence.lookup import Block
from voxjax.ops.evidence.map_tables import code_pool, map_pools
from voxjax.ops.evidence.nearest import NOTHING_NEAR, split_keys
from voxjax.ops.evidence.nearest_host import nearest_field_on_host
from voxjax.ops.evidence.scoring import CONFLICT, HIT, NEUTRAL, NOTHING, score_poses, surface_evidence

SHAPE = (19, 7, 12)


def random_states(shape, seed, free=0.7, occupied=0.1):
    """States with a few occupied voxels, and whole blocks of each kind."""
    rng = np.random.default_rng(seed)
    states = rng.choice(np.asarray([0, 1, 2], np.uint8), shape, p=[1 - free - occupied, free, occupied])
    x, y, z = (slice(int(n)) for n in rng.integers(0, np.asarray(shape) + 1))
    states[x, y, z] = rng.integers(0, 2)
    return states


def index_of(states):
    return np.argwhere(states == 2).astype(np.int32)


@pytest.mark.parametrize("form", [contextlib.nullcontext, device_path])
def test_cells_of_the_map_are_those_of_the_definition(form) -> None:
    states = random_states(SHAPE, 0)
    index = index_of(states)
    with form():
        pools = map_pools(blocks_of(states), index, radius=5)
        codes = np.asarray(code_pool(pools.states, pools.keys, pools.num_rows, hit_sq=2, clear_sq=4))
    assert len(codes) == len(pools.keys) == len(pools.states)
    keys, held, codes = (dense_field(pool, SHAPE, pools.table) for pool in (pools.keys, pools.states, codes))
    np.testing.assert_array_equal(held, states)
    row, squared = (np.asarray(part).reshape(-1) for part in split_keys(keys))
    expected_squared, expected_row = nearest_brute_force(index, SHAPE, 5)
    np.testing.assert_array_equal(squared, expected_squared)
    np.testing.assert_array_equal(row[expected_row >= 0], expected_row[expected_row >= 0])
    is_free, squared = states == 1, squared.reshape(SHAPE)
    undecided = np.where(is_free, np.where(squared >= 4, CONFLICT, NEUTRAL), NOTHING)
    np.testing.assert_array_equal(codes, np.where(squared <= 2, HIT, undecided))


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 999), long=st.integers(1, 150), occupied=st.sampled_from([0.0, 0.0005, 0.01]))
def test_tiles_give_what_the_whole_gives(seed: int, long: int, occupied: float) -> None:
    shape = tuple(np.random.default_rng(seed).permutation([long, 9, 70]).tolist())
    states = random_states(shape, seed, occupied=occupied)
    index = index_of(states)
    whole = map_pools(blocks_of(states), index, radius=5)
    tiled = map_pools(blocks_of(states), index, radius=5, tile=1)
    assert (whole.num_rows, whole.num_shared) == (tiled.num_rows, tiled.num_shared)
    # What follows the map is long, and nobody looks at it.
    for one, other in zip(whole[:3], tiled[:3], strict=True):
        np.testing.assert_array_equal(one[: 512 * whole.num_rows], other[: 512 * whole.num_rows])
    field = nearest_field_on_host(index, shape, length=states.size, radius=5).reshape(shape)
    np.testing.assert_array_equal(dense_field(whole.keys, shape, whole.table), field)


def test_tiles_on_a_device_give_what_the_host_gives() -> None:
    states = random_states((70, 9, 5), 3, occupied=0.01)
    blocks, index = blocks_of(states), index_of(states)
    expected = map_pools(blocks, index, radius=5)
    with device_path():
        found = map_pools(blocks, index, radius=5, tile=1)
    assert found.num_rows == expected.num_rows
    cells = 512 * found.num_rows
    np.testing.assert_array_equal(found.keys[:cells], np.asarray(expected.keys)[:cells])
    num_blocks = 9 * 2 * 1
    np.testing.assert_array_equal(found.table[:num_blocks], np.asarray(expected.table)[:num_blocks])


def test_memory_follows_the_surface_and_not_the_box() -> None:
    # 9.2e9 voxels: free space, a post in it, and another one in the last corner, which is cut in the middle of a block.
    shape = (4099, 4099, 547)
    builder = BlockBuilder(shape, np.uint8)
    free = np.argwhere(np.ones((30, 30, 4), bool)) + 100
    free[:, 2] -= 90
    post = np.full((1, 8, 8, 8), 1, np.uint8)
    post[0, 3, 4] = 2
    is_post = (free == (110, 110, 11)).all(axis=1)
    builder.put(free[~is_post], np.full((~is_post).sum(), 1, np.uint8))
    builder.add(free[is_post], post)
    builder.add(np.asarray([[512, 512, 68]]), post)
    states = builder.finish()
    index = states.where(2)
    pools = map_pools(states, index, radius=5)
    # The unknown, the free, and what is around the posts; of the corner's block three planes lie in the box, without
    # the post.
    assert len(index) == 8
    assert pools.num_shared == 3
    assert pools.num_rows <= 3 + 27
    near = np.asarray(pools.keys)[: 512 * pools.num_rows] != NOTHING_NEAR
    assert near.sum() == nearest_ball_of_a_post()


def nearest_ball_of_a_post():
    """Voxels within 5 voxels of a post of 8."""
    x, y, z = np.indices((11, 11, 18)) - 5
    beyond = np.maximum(np.maximum(-z, z - 7), 0)
    return int((x**2 + y**2 + beyond**2 <= 25).sum())


def test_more_blocks_than_kernels_count_are_refused(monkeypatch) -> None:
    states = random_states(SHAPE, 0)
    monkeypatch.setattr("voxjax._runtime.tables.MAX_POOL_ROWS", 3)
    with pytest.raises(InputError, match=r"a map must have at most .* blocks near surfaces .* crop the map"):
        map_pools(blocks_of(states), index_of(states), radius=5)


POINTS, POSES = 64, 4


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 999))
def test_lookups_in_pools_are_those_in_dense_fields(seed: int) -> None:
    rng = np.random.default_rng(seed)
    shape = tuple(rng.integers(1, 30, 3).tolist())
    states = random_states(shape, seed)
    # Lists of one length, and fields of another: each shape is compiled once, however many examples there are.
    listed = np.resize(np.concatenate([index_of(states), [[0, 0, 0]]]), (POINTS, 3)).astype(np.float32)
    index, length = index_of(states), 1 << 15
    pools = map_pools(blocks_of(states), index, radius=5)
    keys = nearest_field_on_host(index, shape, length=length, radius=5)
    flat = np.zeros(length, np.uint8)
    flat[: states.size] = states.reshape(-1)
    bounds = {"hit_sq": 2, "clear_sq": 4}
    codes = code_pool(flat, keys, length // 512, **bounds)
    pool = code_pool(pools.states, pools.keys, pools.num_rows, **bounds)
    dims, origin = np.asarray(shape, np.int32), rng.normal(size=3).astype(np.float32)
    dense, sparse = (Block(dims, origin, np.float32(0.2), table) for table in (None, pools.table))

    points = (origin + 0.2 * (listed + rng.uniform(-0.5, 1.5, (POINTS, 3)))).astype(np.float32)
    normals = np.zeros((1 << 14, 3), np.float32)
    normals[: len(index)] = Rotation.random(max(len(index), 1), rng=rng).as_matrix()[: len(index), 0]
    surface = np.zeros((1 << 14, 3), np.float32)
    surface[: len(index)] = origin + 0.2 * (index + 0.5)
    weights = rng.random(POINTS).astype(np.float32)
    poses = np.tile(np.eye(4, dtype=np.float32), (POSES, 1, 1))
    poses[1:, :3, :3] = Rotation.from_rotvec(rng.normal(0, 0.2, (POSES - 1, 3))).as_matrix()
    poses[1:, :3, 3] = rng.normal(0, 0.5, (POSES - 1, 3))
    given = points, normals[:POINTS], weights, poses

    def found(codes, keys, block):
        evidence = surface_evidence(codes, keys, block, normals, *given, True)
        scores = score_poses(codes, block, points, weights, poses)
        aligned = align_poses(keys, block, surface, normals, points, weights, poses, num_steps=5)
        return *evidence, scores, aligned

    for one, other in zip(found(pool, pools.keys, sparse), found(codes, keys, dense), strict=True):
        np.testing.assert_array_equal(one, other)

    # Under a transformation all is one kernel.
    one, other = (
        _score_each(codes, block, points, weights, poses)
        for codes, block in ((pool[: 1 << 17], sparse), (codes, dense))
    )
    np.testing.assert_array_equal(one, other)


@jax.jit
def _score_each(codes, block, points, weights, poses):
    return jax.vmap(lambda T: score_poses(codes, block, points, weights, T[None])[0])(poses)
