"""Isolated pieces of maps as leaves, and of the same maps as voxels."""

import numpy as np
import pytest

from oracles import octree as oracle
from voxjax.io.leaf_strays import split_leaves, stray_bytes
from voxjax.io.leaves import Leaves, leaf_map
from voxjax.io.octomap import decode_bt, decode_ot
from voxjax.io.octomap_leaves import leaves_of_bt
from voxjax.io.strays import without_strays

AT = 33000


def room(side=12):
    """Walls of a cube of voxels around free space, as leaves of a file: {(key, depth): state}."""
    index = np.argwhere(np.ones((side, side, side)))
    is_wall = ((index == 0) | (index == side - 1)).any(axis=1)
    return {(*(AT + i).tolist(), 16): 2 if wall else 1 for i, wall in zip(index, is_wall, strict=True)}


def test_a_map_without_isolated_pieces_stays_as_it_is():
    leaves = leaves_of_bt(oracle.file_of(room()))
    rest, strays = split_leaves(leaves)
    assert rest is leaves
    assert len(strays.num_voxels) == len(strays.distance) == 0
    np.testing.assert_allclose(strays.sides, 1.2)


@pytest.mark.parametrize("with_log_odds", [False, True])
def test_strays_and_the_rays_to_them_are_left_out(with_log_odds):
    near = room()
    ray = {(AT + 12 + i, AT + 5, AT + 5, 16): 1 for i in range(200)}
    strays = {
        (AT + 212, AT + 5, AT + 5, 16): 2,
        (AT + 5, AT + 5, AT - 140, 16): 2,
        (AT + 6, AT + 5, AT - 140, 16): 2,
    }
    both = near | ray | strays
    values = {key: (-0.5, 0.5)[state - 1] for key, state in both.items()} if with_log_odds else both
    data, decode = (
        oracle.file_of(values, with_log_odds=with_log_odds),
        decode_ot if with_log_odds else decode_bt,
    )
    told = []
    grid = decode(data, drop_isolated=True, note=told.append)
    # The main part is 12 voxels wide, and its diagonal 12 * sqrt(3) = 20.8: so long is what stays of the ray.
    assert grid.shape == (12 + 21, 12, 12)
    assert grid.num_occupied == sum(state == 2 for state in near.values())
    assert told[0].num_voxels.tolist() == [1, 2]
    np.testing.assert_allclose(told[0].distance, [20.1, 14.0], rtol=1e-3)
    np.testing.assert_allclose(told[0].sides, 1.2)
    dense, (remark,) = without_strays(decode(data), is_dropped=True)
    assert dense == grid
    assert remark.numbers["num_voxels"] == 3
    assert remark.numbers["nearest_m"] == pytest.approx(told[0].distance[1])
    told.clear()
    assert decode(data, note=told.append).shape[0] == 213
    assert told[0].num_voxels.tolist() == [1, 2]


def test_strays_are_judged_within_the_crop():
    data = oracle.file_of(room() | {(AT + 212, AT, AT, 16): 2, (AT, AT + 500, AT, 16): 2})
    told = []
    high = np.array([np.inf, (AT + 100 - 32768) * 0.1, np.inf])
    grid = decode_bt(data, crop=(np.full(3, -np.inf), high), drop_isolated=True, note=told.append)
    assert grid.shape == (12, 12, 12)
    assert told[0].num_voxels.tolist() == [1]


def test_a_wide_leaf_counts_as_its_voxels():
    solid = {(AT // 32 * 32, AT // 32 * 32, AT // 32 * 32, 11): 2}
    far = {(AT // 32 * 32 + 800, AT, AT, 16): 2, (AT, AT // 4 * 4, AT // 4 * 4 + 400, 14): 2}
    rest, strays = split_leaves(leaves_of_bt(oracle.file_of(solid | far)))
    assert strays.num_voxels.tolist() == [1, 64]
    assert rest.shape == (32, 32, 32)
    dense, (remark,) = without_strays(decode_bt(oracle.file_of(solid | far)), is_dropped=True)
    assert dense.shape == (32, 32, 32)
    assert remark.numbers["num_voxels"] == 65
    assert strays.distance[0] == pytest.approx(remark.numbers["farthest_m"], rel=0.005)


@pytest.mark.parametrize(("side", "depth", "samples"), [(16, 10, 64), (20, 10, 8), (50, 15, 1)])
def test_solid_blocks_take_memory_by_their_leaves_not_their_volume(side, depth, samples):
    width = 1 << (16 - depth)
    key = np.argwhere(np.ones((side, side, side))).astype(np.int32) * width + 1024
    key[-1] += 40_000
    solid = leaf_map([Leaves(depth, key, np.full(len(key), 2, np.uint8))], 0.1, has_log_odds=False)
    assert stray_bytes(solid) == solid.num_bytes + 125 * samples * len(key)
    rest, strays = split_leaves(solid)
    assert rest.num_leaves == side**3 - 1
    assert strays.num_voxels.tolist() == [width**3]
    np.testing.assert_allclose(strays.sides, side * width * 0.1, rtol=0.02)
