"""The voxel size at which maps are compared, and their features there."""

import numpy as np
import pytest

import voxjax as vx
from small_worlds import draw_map
from voxjax.pipeline.config import config_from
from voxjax.pipeline.features import features_at, working_voxel_size


def grid_of(voxel_size):
    return vx.VoxelGrid(np.full((2, 2, 2), 2, np.uint8), np.zeros(3), voxel_size)


@pytest.mark.parametrize(
    ("sizes", "settings", "expected"),
    [
        ((0.15, 0.2), {}, 0.2),
        ((0.05, 0.05), {}, 0.1),
        ((0.04, 0.09), {}, 0.09),
        ((0.03, 0.03), {}, 0.09),
        ((0.01, 0.3), {}, 0.3),
        ((0.05, 0.06), {"fine_voxel_size": 0.0}, 0.06),
        ((0.05, 0.05), {"usual_voxel_size": 0.2}, 0.2),
        ((0.05, 0.2), {"voxel_size": 0.5}, 0.5),
    ],
)
def test_the_coarser_map_decides_after_fine_ones_were_made_coarser(sizes, settings, expected):
    config = config_from({"map": settings})
    assert working_voxel_size([grid_of(size) for size in sizes], config) == pytest.approx(expected)


def test_features_follow_the_settings():
    few = config_from(
        {"rotation": {"num_normals": 64, "max_directions": 2}, "source": {"max_virtual_corners": 0}}
    )
    grid = draw_map()
    found = features_at(grid, voxel_size=grid.voxel_size, config=few)
    assert found.normals.shape == (64, 3)
    assert len(found.directions) == 2
    assert np.asarray(found.corners.trimmed().is_observed).all()
    with pytest.raises(vx.InputError, match="at least one occupied voxel"):
        features_at(vx.VoxelGrid(np.zeros((2, 2, 2), np.uint8), np.zeros(3), 0.1), voxel_size=0.1)
