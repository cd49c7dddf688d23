import numpy as np

from corner_rooms import SIZE, TURNS, room_grid
from oracles import box_room
from voxjax.features.paper import paper_corners


def test_paper_preset_finds_room_corners_at_voxels():
    grid, shift = room_grid(TURNS["straight"], thickness=0.5)
    stages = paper_corners(grid)
    assert len(stages.initial) > len(stages.kept) >= len(stages.corners.position) > 0
    index = (stages.corners.position - grid.origin) / SIZE - 0.5
    np.testing.assert_allclose(index, np.round(index), atol=1e-3)
    position = box_room.true_corners()[0][::2] * SIZE + shift
    distance = np.linalg.norm(stages.corners.position[None] - position[:, None], axis=2).min(axis=1)
    assert (distance < 2 * SIZE).sum() >= 6
