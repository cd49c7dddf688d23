"""Maps prepared for registration."""

import equinox as eqx
import jax
import numpy as np
import pytest

from small_worlds import draw_map, pose
from voxjax import VoxelGrid
from voxjax.maps.prepared import COARSE_FACTOR, draw_rows, map_surface, prepare_map
from voxjax.ops.blocks.block_builder import BlockBuilder
from voxjax.ops.evidence.lookup import lookup
from voxjax.ops.evidence.nearest import split_keys
from voxjax.ops.evidence.scoring import HIT


def test_rows_are_drawn_in_proportion_to_their_weights():
    rows = draw_rows(np.asarray([1.0, 0.0, 3.0]), 400)
    assert np.bincount(rows).tolist() == [100, 0, 300]
    assert draw_rows(np.ones(1), 3).tolist() == [0, 0, 0]


def test_unrefined_poses_are_compared_at_a_tolerance_of_their_own():
    prepared = prepare_map(draw_map(voxel_size=0.15))
    # Looser than the evidence of refined poses, and no looser than three quarters of a cell.
    hits, coarse_hits, other_hits = (
        np.asarray(codes)[: 512 * prepared.num_rows] == HIT
        for codes in (prepared.codes, prepared.coarse_codes(), prepared.coarse_codes(3))
    )
    assert (coarse_hits >= hits).all()
    squared = np.asarray(split_keys(prepared.near_cells()[0])[1])
    assert squared[coarse_hits].max() <= (0.75 * COARSE_FACTOR) ** 2
    # Cells of another width have codes of their own, made when they are asked for.
    assert other_hits.sum() > coarse_hits.sum()


def test_a_map_in_blocks_is_prepared_as_the_dense_one():
    grid = draw_map(pose(yaw=33.0, tilt=12.0), voxel_size=0.2)
    blocks = VoxelGrid(grid.state_blocks(), grid.origin, grid.voxel_size)
    assert blocks.is_sparse
    found, expected = (eqx.tree_at(lambda p: p.grid, prepare_map(each), None) for each in (blocks, grid))
    used = 512 * expected.num_rows
    for one, other in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
        np.testing.assert_array_equal(np.ravel(one)[:used], np.ravel(other)[:used])


def test_a_map_of_more_voxels_than_32_bits_count_is_prepared():
    small = map_surface(draw_map(voxel_size=0.2)).grid
    # The same voxels again in the far corner of a box of 3.1e9 voxels.
    shape = (2700, 3400, 340)
    builder = BlockBuilder(shape, np.uint8)
    far = np.asarray(shape) // 8 - np.asarray(small.state_blocks().table.shape) - 1
    for index, blocks in small.state_blocks().parts():
        builder.add(index, blocks)
        builder.add(index + far, blocks)
    grid = VoxelGrid(builder.finish(), small.origin, small.voxel_size)
    found, expected = prepare_map(grid), prepare_map(small)
    count = expected.num_points
    assert found.num_points == 2 * count
    np.testing.assert_array_equal(np.asarray(found.normals)[:count], np.asarray(expected.normals)[:count])
    # What is far apart does not know of each other: lookups near the first piece are those in it alone.
    points = np.asarray(expected.points)[:count]
    own, other = (lookup(part.codes, part.block, points, np.uint8(9)) for part in (found, expected))
    np.testing.assert_array_equal(own, other)
    # The pieces reach into the blocks around them, and nothing else has rows.
    assert found.num_rows < 8 * expected.num_rows
    assert found.free_share == pytest.approx(expected.free_share)


def test_a_known_surface_gives_the_same_prepared_map():
    grid = draw_map(voxel_size=0.2)
    surface, prepared = map_surface(grid), prepare_map(grid)
    assert surface.free_share == prepared.free_share > 0.5
    again = prepare_map(surface)
    assert again.grid.equals(prepared.grid)
    for found, expected in zip(jax.tree.leaves(again), jax.tree.leaves(prepared), strict=True):
        np.testing.assert_array_equal(found, expected)
