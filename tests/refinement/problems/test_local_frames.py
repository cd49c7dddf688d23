import jax
import jax.numpy as jnp
import numpy as np
import pytest

import voxjax as vx
from oracles.motions import random_pose
from voxjax.frames import from_local, image, to_local
from voxjax.refinement.problems.local_frames import local_frames


@pytest.fixture
def grids():
    states = np.random.default_rng(0).integers(0, 3, (5, 6, 7)).astype(np.uint8)
    return {
        name: vx.VoxelGrid(states, place, 0.1)
        for name, place in (("a", [4e5, 5e6, 0.0]), ("b", [1.0, 2.0, 3.0]))
    }


def test_maps_go_to_local_frames_and_poses_come_back(grids):
    frames = local_frames(grids, is_wanted=True)
    assert list(frames.grids) == ["a", "b"]
    for grid, origin, own in zip(frames.grids.values(), frames.origins, grids.values(), strict=True):
        assert isinstance(grid, vx.VoxelGrid)
        np.testing.assert_allclose(grid.occupied_points() + origin, own.occupied_points(), rtol=0, atol=1e-8)
        assert np.abs(grid.occupied_points()).max() < 1.0
    T = from_local(random_pose(np.random.default_rng(1)), *frames.origins)
    local = to_local(T, *frames.origins).astype(np.float32)
    moved = local + np.eye(4, k=3, dtype=np.float32)
    found = frames.own_pose(np.stack([local, moved]), np.stack([local] * 2), np.stack([T] * 2))
    assert found.dtype == np.float64
    # What is the start comes back to the bit; the other is a metre off.
    np.testing.assert_array_equal(found[0], T)
    point = frames.origins[1]
    np.testing.assert_allclose(image(np.asarray(found[1]), point) - image(T, point), [1.0, 0, 0], atol=1e-5)


def test_poses_of_many_maps_come_back_and_those_that_stayed_to_the_bit(grids):
    frames = local_frames(grids, is_wanted=True)
    rng = np.random.default_rng(2)
    first = random_pose(rng)
    world = image(first, frames.origins[0])
    # The second map lies near the first one in the world, and its rotation has six digits.
    start = np.stack([first, from_local(random_pose(rng), world, frames.origins[1])])
    start[1, :3, :3] = np.round(start[1, :3, :3], 6)
    local = frames.local_poses(start, world)
    np.testing.assert_allclose(local[0, :3, 3], 0.0, atol=1e-6)
    is_held, middle = np.array([True, False]), frames.origins[1]
    np.testing.assert_array_equal(frames.own_poses(jnp.asarray(local), world, start, is_held), start)
    moved = local + np.array([0, 10], np.float32)[:, None, None] * np.eye(4, k=3, dtype=np.float32)
    own = np.asarray(frames.own_poses(jnp.asarray(moved), world, start, is_held))
    np.testing.assert_array_equal(own[0], start[0])
    step = image(own[1], middle) - image(start[1], middle)
    np.testing.assert_allclose(step, [10.0, 0, 0], rtol=0, atol=1e-4)


def test_maps_stay_where_something_is_traced_or_somebody_minds(grids):
    assert local_frames(grids, is_wanted=False).grids == grids

    def origins_of(log_odds):
        b = grids["b"]
        soft = vx.VoxelGrid(b.states, b.origin, b.voxel_size, log_odds)
        frames = local_frames(grids | {"b": soft}, is_wanted=True)
        assert frames.grids["b"] is soft
        # What is traced is found in the maps' own frames, and goes out as it is.
        pose = jnp.eye(4) + log_odds[0, 0, 0]
        assert frames.own_pose(pose, pose, pose) is pose
        return jnp.asarray(np.stack(frames.origins))

    np.testing.assert_array_equal(jax.jit(origins_of)(np.zeros((5, 6, 7), np.float32)), 0.0)


def test_traced_poses_keep_their_dtype(grids):
    frames = local_frames(grids, is_wanted=False)
    start = np.stack([np.eye(4), random_pose(np.random.default_rng(3))])
    world = image(start[0], frames.origins[0])

    @jax.jit
    def there_and_back(local):
        return frames.own_poses(local, world, start, np.array([True, False]))

    own = there_and_back(jnp.asarray(frames.local_poses(start, world)))
    assert own.dtype == jnp.float32
    np.testing.assert_allclose(own, start, atol=1e-6)
