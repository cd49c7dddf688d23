"""The voxel size at which maps are compared, and their features there."""

import numpy as np
import pytest

import voxjax as vx
from block_maps import far_apart, in_blocks, peak_of
from small_worlds import draw_map
from voxjax.pipeline.config import config_from
from voxjax.pipeline.features import features_at, working_voxel


def grid_of(voxel_size, side=2):
    return vx.VoxelGrid(np.full((side, side, side), 2, np.uint8), np.zeros(3), voxel_size)


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
    config = config_from({"map": {"min_surface": 0} | settings})
    assert working_voxel([grid_of(size) for size in sizes], config).size == pytest.approx(expected)


@pytest.mark.parametrize(
    ("maps", "expected", "reason"),
    [
        # 20, 26 and 32 cubed are 8,000, 17,576 and 32,768 voxels.
        ([(0.03, 20)], 0.03, "a map's own, for a coarser one would leave it fewer than 8,192"),
        ([(0.03, 26)], 0.03, "a map's own"),
        ([(0.03, 32)], 0.06, "2 voxels of a map that is finer than map.fine_voxel_size"),
        ([(0.05, 20), (0.03, 32)], 0.06, "2 voxels of a map"),
        ([(0.05, 32), (0.2, 2)], 0.2, "that of the coarsest map"),
    ],
)
def test_a_map_is_made_coarser_only_as_far_as_enough_surface_is_left(maps, expected, reason):
    voxel = working_voxel([grid_of(*each) for each in maps], config_from(None))
    assert voxel.size == pytest.approx(expected)
    assert voxel.reason.startswith(reason)
    chosen = working_voxel([grid_of(0.03)], config_from({"map": {"voxel_size": 0.5}}))
    assert chosen == (0.5, "as set by map.voxel_size")


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


def test_features_of_two_maps_far_apart_take_memory_for_these_and_not_for_the_box():
    room = draw_map()
    grid = far_apart(room)
    features_at(in_blocks(room), voxel_size=room.voxel_size)  # compiles, which takes memory of its own
    found, peak = peak_of(lambda: features_at(grid, voxel_size=grid.voxel_size))
    assert found.prepared.num_points == 2 * room.num_occupied
    assert found.num_isolated == 0
    assert peak < 60e6 < grid.num_voxels / 50
