"""A small building given by formulas, drawn into a map in any frame: no scanner, no noise, exact truth."""

import numpy as np

import voxjax as vx
from oracles.motions import turned

# Free space: rooms and doors of one storey [m], (low, high); furniture is cut out of it.
ROOMS = (
    ((0.0, 0.0, 0.0), (5.0, 4.0, 2.6)),
    ((5.2, 0.0, 0.0), (9.0, 3.0, 2.6)),
    ((0.0, 4.2, 0.0), (3.0, 8.0, 2.6)),
    ((5.0, 1.0, 0.0), (5.2, 2.0, 2.0)),
    ((1.0, 4.0, 0.0), (2.0, 4.2, 2.0)),
)
FURNITURE = (
    ((0.5, 3.2, 0.0), (2.1, 4.0, 0.8)),
    ((3.9, 0.0, 0.0), (5.0, 0.7, 1.9)),
    ((7.4, 2.1, 0.0), (9.0, 3.0, 1.1)),
    ((0.0, 6.7, 0.0), (0.9, 8.0, 1.5)),
    ((2.1, 5.0, 0.0), (3.0, 5.6, 0.7)),
)
OTHER_ROOMS = (
    ((0.0, 0.0, 0.0), (3.1, 7.0, 3.1)),
    ((3.3, 2.0, 0.0), (10.0, 4.4, 3.1)),
    ((3.1, 2.4, 0.0), (3.3, 3.3, 2.1)),
)
OTHER_FURNITURE = (
    ((0.0, 0.0, 0.0), (1.4, 0.9, 2.2)),
    ((8.8, 2.0, 0.0), (10.0, 2.6, 0.5)),
    ((1.1, 5.9, 0.0), (3.1, 7.0, 0.9)),
)


def _distance(points, boxes):
    """Distance to the union of boxes, 0 inside."""
    best = np.full(len(points), np.inf)
    for low, high in boxes:
        outside = np.maximum(np.maximum(np.asarray(low) - points, points - np.asarray(high)), 0.0)
        best = np.minimum(best, np.linalg.norm(outside, axis=1))
    return best


def draw_map(T_map_world=None, *, voxel_size=0.15, rooms=ROOMS, furniture=FURNITURE, seen=None):
    """The building in a frame; `seen` limits it to a box of the world."""
    T = np.eye(4) if T_map_world is None else T_map_world
    low, high = np.min([r[0] for r in rooms], 0) - 0.3, np.max([r[1] for r in rooms], 0) + 0.3
    corners = np.stack(np.meshgrid(*zip(low, high, strict=True), indexing="ij"), -1).reshape(-1, 3)
    image = corners @ T[:3, :3].T + T[:3, 3]
    first = np.floor(image.min(0) / voxel_size)
    shape = (np.ceil(image.max(0) / voxel_size) - first).astype(int)
    index = np.stack(np.meshgrid(*(np.arange(n) for n in shape), indexing="ij"), -1).reshape(-1, 3)
    centres = (first + index + 0.5) * voxel_size
    world = (centres - T[:3, 3]) @ T[:3, :3]
    to_free = _distance(world, rooms)
    in_furniture = _distance(world, furniture) == 0.0
    states = np.where(to_free <= 0.0, 1, np.where(to_free <= 1.2 * voxel_size, 2, 0))
    states = np.where(in_furniture & (to_free <= 0.0), 2, states)
    if seen is not None:
        states = np.where(_distance(world, (seen,)) == 0.0, states, 0)
    grid = vx.VoxelGrid(
        states.reshape(shape).astype(np.uint8), (first * voxel_size).astype(np.float32), voxel_size
    )
    return grid.crop_to_known()


def pose(yaw=0.0, tilt=0.0, translation=(0.0, 0.0, 0.0)):
    """Yaw and tilt [deg], then a translation [m]."""
    return turned("zx", [yaw, tilt], translation, degrees=True)
