"""Rigid resampling: laws and the voxel-by-voxel definition."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from tests import dense_fusion
from tests.ops.blocks.boxes import random_boxes

import voxjax as vx
from oracles import resampling as oracle
from oracles.motions import cube_rotations, pose_of
from voxjax import InputError
from voxjax.ops.blocks.block_array import BlockArray
from voxjax.ops.blocks.block_builder import blocks_of
from voxjax.ops.resampling.interpolate import resample_nearest
from voxjax.ops.resampling.rigid import resample_rigid, source_from_target

SIZE = 0.1
CUBE_ROTATIONS = cube_rotations()
ZERO = np.zeros(3)


def make_pose(rotation=None, translation=(0.0, 0.0, 0.0)) -> np.ndarray:
    return pose_of(rotation, translation).astype(np.float32)


def make_states(seed=0, shape=(6, 5, 4)) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 3, shape).astype(np.uint8)


def test_the_cube_has_24_rotations():
    assert len(CUBE_ROTATIONS) == 24


@pytest.mark.parametrize("rotation", CUBE_ROTATIONS)
def test_rotations_of_the_cube_with_whole_shifts_are_exact(rotation):
    states, low, shift = make_states(), np.array([3, -7, 11]), np.array([4, 0, -9])
    moved, origin, _ = resample_rigid(
        states, (low * SIZE).astype(np.float32), SIZE, make_pose(rotation, shift * SIZE)
    )
    centres = (np.argwhere(states >= 0) + low + 0.5) @ rotation.T + shift
    index = np.rint(centres - 0.5 - np.rint(origin / SIZE)).astype(int)
    expected = np.zeros_like(moved)
    expected[tuple(index.T)] = states.reshape(-1)
    assert moved.size == states.size
    np.testing.assert_array_equal(moved, expected)


def test_a_whole_rotation_and_its_inverse_give_the_grid_back():
    states, origin = make_states(), np.array([0.3, -0.7, 1.1], np.float32)
    log_odds = np.random.default_rng(1).normal(size=states.shape).astype(np.float32)
    T = make_pose(CUBE_ROTATIONS[7], (0.5, 0.1, -2.0))
    there = resample_rigid(states, origin, SIZE, T, log_odds)
    back = resample_rigid(*there[:2], SIZE, np.linalg.inv(T), there[2])
    np.testing.assert_array_equal(back[0], states)
    np.testing.assert_allclose(back[1], origin, atol=1e-6)
    np.testing.assert_array_equal(back[2], log_odds)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=10, deadline=None)
def test_any_motion_looks_up_the_voxel_that_holds_the_centre_moved_back(seed):
    rng = np.random.default_rng(seed)
    states = make_states(seed)
    T = make_pose(Rotation.random(rng=rng).as_matrix(), rng.uniform(-3, 3, 3))
    low = rng.integers(-20, 20, 3)
    moved, origin, _ = resample_rigid(states, (low * SIZE).astype(np.float32), SIZE, T)
    cell = np.rint(origin / SIZE).astype(int)
    np.testing.assert_allclose(cell * SIZE, origin, atol=1e-5)
    expected = oracle.nearest(states, low * SIZE, SIZE, T, cell, moved.shape)
    assert np.mean(moved != expected) < 0.01  # float32 may round a centre over a border
    wider = oracle.nearest(states, low * SIZE, SIZE, T, cell - 2, tuple(side + 4 for side in moved.shape))
    wider[2:-2, 2:-2, 2:-2] = 0
    assert not wider.any(), "known voxels lie outside the result"


@pytest.mark.parametrize("seed", range(3))
def test_a_rotated_solid_has_no_holes(seed):
    rng = np.random.default_rng(seed)
    states = np.full((20, 20, 20), 2, np.uint8)
    T = make_pose(Rotation.random(rng=rng).as_matrix(), rng.uniform(-3, 3, 3))
    moved, origin, _ = resample_rigid(states, np.zeros(3, np.float32), SIZE, T)
    centres = (np.argwhere(moved >= 0) + 0.5) * SIZE + origin
    inside = (centres - T[:3, 3]) @ T[:3, :3]
    is_inside = ((inside > 0.01) & (inside < 20 * SIZE - 0.01)).all(axis=1).reshape(moved.shape)
    assert (moved[is_inside] == 2).all()
    assert abs(int((moved == 2).sum()) - 8000) < 80


def test_a_half_voxel_shift_neither_doubles_nor_drops_a_layer():
    states = np.repeat(np.arange(60) % 3, 4).reshape(60, 2, 2).astype(np.uint8)
    moved, _, _ = resample_rigid(states, np.array([0.05, 0, 0], np.float32), SIZE, make_pose())
    layers = moved[:, 0, 0]
    assert any(np.array_equal(layers[k : k + 60], states[:, 0, 0]) for k in range(len(layers) - 59))


def test_a_large_grid_in_several_chunks_equals_the_whole_grid_kernel():
    states = make_states(3, (140, 130, 90))
    T = make_pose(Rotation.from_euler("z", 0.3).as_matrix(), (1.0, 2.0, 3.0))
    moved, origin, _ = resample_rigid(states, np.zeros(3, np.float32), SIZE, T)
    assert moved.size > 1 << 20
    affine = source_from_target(T, np.zeros(3, np.float32), SIZE, np.rint(origin / SIZE), SIZE)
    whole = np.asarray(resample_nearest(states, affine, target_shape=moved.shape))
    assert np.mean(moved != whole) < 1e-4  # sums in another order


def test_maps_of_nothing_become_one_unknown_voxel():
    T = make_pose(Rotation.from_euler("z", 0.3).as_matrix())
    for shape in ((3, 3, 3), (0, 2, 2)):
        moved, _, odds = resample_rigid(
            np.zeros(shape, np.uint8), np.zeros(3, np.float32), SIZE, T, np.zeros(shape, np.float32)
        )
        assert odds is not None
        assert moved.shape == odds.shape == (1, 1, 1)
        assert not moved.any()


def test_a_result_that_fits_no_memory_is_refused():
    T = make_pose(Rotation.from_euler("xyz", (0.5, 0.6, 0.7)).as_matrix())
    states = np.broadcast_to(np.uint8(1), (1, 1, 1 << 22))
    with pytest.raises(InputError, match="crop it"):
        resample_rigid(states, np.zeros(3, np.float32), SIZE, T)


def make_map(seed, shape, *, frame=ZERO):
    """A map whose log-odds are not 0 everywhere where nothing is known."""
    states = random_boxes(shape, seed=seed, num_boxes=8)
    log_odds = np.array([0.0, -2.0, 1.5], np.float32)[states]
    odd = np.random.default_rng(seed).random(shape) < 0.002
    log_odds[odd] = 0.25
    return vx.VoxelGrid(states, np.array([0.3, -0.52, 1.1]) + frame, SIZE, log_odds)


@pytest.mark.parametrize("number", range(12))
@pytest.mark.parametrize("is_turned", [True, False], ids=["turned", "cube"])
def test_a_sparse_map_is_moved_to_the_bits_of_the_dense_way(number, is_turned):
    rng = np.random.default_rng(number)
    grid = make_map(number, (37, 25, 18), frame=np.array([4e5, 5e6, 300.0]) if number % 3 == 0 else ZERO)
    rotation = Rotation.random(rng=rng).as_matrix() if is_turned else CUBE_ROTATIONS[2 * number + 1]
    T = pose_of(rotation, rng.uniform(-3, 3, 3) if is_turned else SIZE * rng.integers(-30, 30, 3))
    sparse = vx.VoxelGrid(grid.state_blocks(), grid.origin, SIZE, grid.log_odds_blocks())
    expected, moved = dense_fusion.transformed(grid, T), sparse.transformed(T)
    assert moved.is_sparse
    for found in (moved, grid.transformed(T)):
        assert found.shape == expected.shape
        np.testing.assert_array_equal(found.origin, expected.origin)
        np.testing.assert_array_equal(found.states, expected.states)
        np.testing.assert_array_equal(found.log_odds, expected.log_odds)
    assert moved.num_occupied > 10


def test_a_sparse_map_in_a_huge_box_is_moved_at_the_cost_of_what_is_in_it():
    room = random_boxes((40, 33, 20), seed=1)
    blocks = blocks_of(room)
    table = np.zeros((512, 512, 128), np.int32)
    table[300:305, 17:22, 90:93] = blocks.table
    huge = BlockArray(table, blocks.pool, (4096, 4096, 1024))
    T = pose_of(CUBE_ROTATIONS[5], (1.0, 2.0, -3.0))
    moved = vx.VoxelGrid(huge, np.zeros(3), SIZE).transformed(T)
    assert sorted(moved.shape) == [1024, 4096, 4096]
    assert moved.num_occupied == np.count_nonzero(room == 2)
    # The same room alone, where it lies in the huge box.
    alone = vx.VoxelGrid(room, SIZE * 8 * np.array([300, 17, 90]), SIZE).transformed(T)
    low = np.rint((alone.origin - moved.origin) / SIZE).astype(int)
    np.testing.assert_array_equal(moved.states_in(low, low + alone.shape), alone.states)
