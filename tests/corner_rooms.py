"""A room with a box whose corners are known, as a map in any frame."""

import numpy as np

from oracles import box_room
from voxjax import VoxelGrid

SIZE = 0.1


TURNS = {
    "straight": np.eye(3),
    "yaw": box_room.rotation((0, 0, 1), 0.4),
    "any": box_room.rotation((1.0, -2.0, 0.7), 0.9),
}


def room_grid(turn, **options):
    states, vector = box_room.room_map(turn, **options)
    origin = np.asarray([5.0, -3.0, 1.0], np.float32)
    return VoxelGrid(states, origin, SIZE), (vector + 0.5) * SIZE + origin
