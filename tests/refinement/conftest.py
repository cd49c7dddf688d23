"""A furnished room in two frames, and the problems between the two maps."""

import numpy as np
import pytest

import voxjax as vx
from oracles.motions import random_pose
from oracles.rooms import VOXEL, furnished_room
from voxjax.registration.prepared import prepare_map


@pytest.fixture(scope="session")
def room():
    """Map a, map b, and the true pose of b in a."""
    a = vx.VoxelGrid(furnished_room(), np.zeros(3, np.float32), VOXEL)
    T = random_pose(np.random.default_rng(3), metres=3, degrees=40)
    return a, a.transformed(np.linalg.inv(T)), T


@pytest.fixture(scope="session")
def prepared(room):
    return prepare_map(room[0]), prepare_map(room[1])
