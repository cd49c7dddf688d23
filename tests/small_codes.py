"""A small map with its evidence codes, points of another one under many poses, and what one device makes of them."""

from typing import Any, NamedTuple

import jax
import numpy as np
from scipy.spatial.transform import Rotation

from voxjax.ops.blocks.block_array import BlockArray
from voxjax.ops.blocks.block_builder import blocks_of
from voxjax.ops.evidence.lookup import Block
from voxjax.ops.evidence.map_tables import code_pool, map_pools
from voxjax.ops.evidence.scoring import score_poses
from voxjax.ops.window.classes import box_count, window_classes


class SmallCodes(NamedTuple):
    """A map in blocks and its codes, and points that are scored against it."""

    states: BlockArray
    index: np.ndarray
    codes: Any
    block: Block
    points: np.ndarray
    weights: np.ndarray
    whole_weights: np.ndarray
    poses: np.ndarray

    def scores(self, weights):
        """What one device gives."""
        return np.asarray(score_poses(self.codes, self.block, self.points, weights, self.poses))

    def counts(self):
        """Counts at the occupied voxels."""
        counts = np.asarray(box_count(self.states.dense() == 2))
        return counts[tuple(self.index.T)]

    def classes(self, min_change, **options):
        """Classes of all voxels."""
        return np.asarray(window_classes(self.states.dense() == 2, min_change, **options))


def small_codes(shape=(61, 37, 52), seed=0):
    """Walls and clutter in free space, whole blocks of each state, and a border that is unknown."""
    rng = np.random.default_rng(seed)
    states = np.zeros(shape, np.uint8)
    states[4:, :-3] = 1
    states[:, :, 17:19] = states[30] = 2
    states[16:32, :16, 16:40] = 2
    states[rng.random(shape) < 0.003] = 2
    blocks, index = blocks_of(states), np.argwhere(states == 2).astype(np.int32)
    pools = map_pools(blocks, index, radius=5)
    size, origin = np.float32(0.1), np.asarray([-3.0, 1.0, 0.5], np.float32)
    points = (rng.random((9000, 3)) * np.asarray(shape) * 0.1).astype(np.float32)
    poses = np.tile(np.eye(4, dtype=np.float32), (20, 1, 1))
    poses[1:, :3, :3] = Rotation.from_rotvec(rng.normal(0.0, 1.5, (19, 3))).as_matrix()
    poses[:, :3, 3] = origin + rng.normal(0.0, 1.0, (20, 3))
    return SmallCodes(
        blocks,
        index,
        code_pool(pools.states, pools.keys, pools.num_rows, hit_sq=2, clear_sq=4),
        Block(np.asarray(shape, np.int32), origin, size, pools.table),
        points,
        rng.random(9000).astype(np.float32),
        rng.integers(0, 5, 9000).astype(np.float32),
        poses,
    )


def mesh_of(devices=1):
    """A mesh of the first devices."""
    return jax.sharding.Mesh(np.asarray(jax.devices()[:devices]), ("part",))
