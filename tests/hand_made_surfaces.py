"""Surfaces and rooms made by hand, for the tests of planes."""

import numpy as np

from oracles import box_room
from voxjax import VoxelGrid
from voxjax.planes.surface import Surface, neighbour_pairs

SIZE = 0.1


def room_grid(turn, **options):
    """A box room turned in its map, and where its corner lies in the map [m]."""
    states, vector = box_room.room_map(turn, **options)
    return VoxelGrid(states, np.zeros(3, np.float32), SIZE), (vector + 0.5) * SIZE


def surface_of(index, normal, curvature):
    """A surface of given elements; normals all signed."""
    n = len(index)
    return Surface(
        index=index.astype(np.int32),
        normal=normal.astype(np.float32),
        curvature=curvature.astype(np.float32),
        is_signed=np.ones(n, bool),
        pairs=neighbour_pairs(index.astype(np.int32)),
    )


def sheet(nx, ny, z=0):
    """Voxels of a flat rectangle."""
    x, y = (a.ravel() for a in np.meshgrid(np.arange(nx), np.arange(ny), indexing="ij"))
    return np.stack([x, y, np.full(nx * ny, z)], axis=1)
