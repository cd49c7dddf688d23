"""Sheets: who saw what, colours, and pictures of maps that are odd."""

import tracemalloc

import numpy as np
import pytest
from scipy.spatial.distance import cdist

from oracles.motions import turned
from voxjax import VoxelGrid
from voxjax.ops.blocks.voxel_list import blocks_with
from voxjax.view import draw_grid, draw_maps, draw_merge, encode_png, grid_png
from voxjax.view.colors import SHARED_COLOR, map_color
from voxjax.view.sheet import seen_by, share_colors


def _grid(states, origin=(0.0, 0.0, 0.0), voxel_size=0.5):
    return VoxelGrid(np.asarray(states, np.uint8), origin, voxel_size)


def _random_grid(seed, shape=(9, 8, 7)):
    rng = np.random.default_rng(seed)
    return _grid(rng.choice([0, 1, 2], shape, p=(0.4, 0.4, 0.2)), rng.integers(-4, 4, 3) * 0.5)


@pytest.mark.parametrize("turn", [0, 90, 180])
def test_seen_by_is_the_chebyshev_distance_of_one_voxel(turn):
    grid, fused = _random_grid(1), _random_grid(2)
    T = turned("z", turn, (1.0, -0.5, 0.5), degrees=True).astype(np.float32)
    moved = grid.occupied_points() @ T[:3, :3].T + T[:3, 3]
    nearest = cdist(fused.occupied_points(), moved, "chebyshev").min(axis=1)
    np.testing.assert_array_equal(seen_by([grid], [T], fused)[0], nearest < 0.75)


def test_who_saw_what_far_out_takes_rotations_of_six_digits():
    grid, far = _random_grid(1), np.array([4e5, 5e6, 300.0])
    T = turned("z", 33.0, (1.0, -0.5, 0.5), degrees=True)
    T[:3, :3] = np.round(T[:3, :3], 6)
    moved = T.copy()
    moved[:3, 3] -= T[:3, :3] @ far  # the same pose for the map far out
    fused = grid.transformed(T)
    near = seen_by([grid], [T], fused)
    assert near.any()
    seen = seen_by([VoxelGrid(grid.states, grid.origin + far, 0.5)], [moved], fused)
    np.testing.assert_array_equal(seen, near)


def test_maps_that_were_left_out_saw_nothing():
    grid = _random_grid(3)
    assert not seen_by([grid, grid], [None, np.eye(4)], grid)[0].any()


def test_what_two_maps_saw_has_the_shared_color_and_else_the_map_s_own():
    colors = share_colors(np.asarray([[1, 0, 1, 0], [0, 1, 1, 0]], bool))
    np.testing.assert_array_equal(colors[:3], [map_color(0), map_color(1), SHARED_COLOR])


def test_a_merge_is_drawn_in_the_maps_colors():
    states = np.ones((24, 24, 6), np.uint8)
    states[:, :, 0] = 2
    left, right = _grid(states), _grid(states, (8.0, 0.0, 0.0))
    both = np.concatenate([states, states[:16]])
    sheet = draw_merge([left, right], [np.eye(4), np.eye(4)], _grid(both), names=["one", "two"])
    assert sheet.dtype == np.uint8
    for color in (map_color(0), map_color(1), SHARED_COLOR):  # the legend has them pure
        assert (sheet == np.asarray(color, np.uint8)).all(axis=-1).any()


@pytest.mark.parametrize("state", [0, 1, 2])
@pytest.mark.parametrize("shape", [(1, 1, 1), (1, 40, 1), (12, 1, 30)])
def test_uniform_and_thin_maps_are_drawn(shape, state):
    grid = _grid(np.full(shape, state))
    for view in ("isometric", "top"):
        assert draw_grid(grid, view=view, width=90, height=70).shape == (70, 90, 3)
    assert draw_merge([grid, grid, grid], [np.eye(4), None, np.eye(4)], grid).ndim == 3


def test_the_ceiling_hides_the_rooms_unless_it_is_cut():
    states = np.ones((20, 20, 10), np.uint8)
    states[:, :, [0, 9]] = states[[0, 19]] = states[:, [0, 19]] = 2
    states[10, :, :] = 2
    open_room, closed = draw_maps([_grid(states)]), draw_maps([_grid(states)], cut_ceiling=False)
    assert not np.array_equal(open_room, closed)


def _leaning_house(axis, degrees):
    """A closed house of two rooms that leans, and which of its occupied voxels are the floor."""
    states = np.zeros((150, 120, 20), np.uint8)
    states[:, :, [0, 1, 18, 19]] = states[[0, 1, 148, 149]] = states[:, [0, 1, 118, 119]] = states[70:72] = 2
    T = turned(axis, degrees, (0.0, 0.0, 0.0), degrees=True)
    house = _grid(states).transformed(T)
    height = house.occupied_points() @ T[:3, 2]
    return house, height - height.min() < 1.3


@pytest.mark.parametrize(("axis", "degrees"), [("z", 20), ("x", 7), ("y", -7), ("x", -30), ("y", 40)])
@pytest.mark.parametrize("view", ["isometric", "top"])
def test_the_rooms_of_a_leaning_house_are_seen(axis, degrees, view):
    house, is_floor = _leaning_house(axis, degrees)
    color = np.where(is_floor[:, None], (255, 0, 0), (0, 0, 255)).astype(np.uint8)
    seen = draw_grid(house, width=200, height=150, color=color, view=view).astype(int)
    floor, rest = ((seen[..., c] - seen[..., 2 - c] > 60).sum() for c in (0, 2))
    # The floor is most of what is drawn; from the side, walls hide a part of it.
    assert floor > {"isometric": 0.5, "top": 0.7}[view] * (floor + rest)


def test_grid_png_is_the_picture_of_the_grid():
    grid = _random_grid(5)
    assert grid_png(grid, width=80, height=60) == encode_png(draw_grid(grid, width=80, height=60))


def test_a_sheet_is_as_wide_as_asked():
    grid = _random_grid(6)
    margins = 2 * 24
    assert draw_merge([grid, grid], [np.eye(4)] * 2, grid, width=400).shape[1] == 400 + margins
    assert draw_maps([grid, grid], width=300).shape[1] == 300 + margins


def test_strays_far_away_change_the_titles_alone():
    grid = _random_grid(4, (24, 20, 6)).crop_to_known()
    states = np.zeros((400, *grid.shape[1:]), np.uint8)
    states[: grid.shape[0]] = grid.states
    states[-1, 3, 2] = 2
    stray = VoxelGrid(states, grid.origin, grid.voxel_size)
    pictures = [
        (draw_maps([grid]), draw_maps([stray])),
        (draw_merge([grid], [np.eye(4)], grid), draw_merge([stray], [np.eye(4)], stray)),
    ]
    for near, far in pictures:
        assert near.shape == far.shape
        differs = (near != far).any(axis=-1)
        # Of a title's height, and one title for each panel.
        assert differs.any()
        assert np.count_nonzero(differs.any(axis=1)) < 40


def test_a_map_in_blocks_is_drawn_as_the_dense_one():
    grid = _random_grid(7, (40, 31, 20))
    blocks = VoxelGrid(grid.state_blocks(), grid.origin, grid.voxel_size)
    np.testing.assert_array_equal(draw_maps([blocks]), draw_maps([grid]))
    poses = [np.eye(4), turned("z", 30, (1.0, 0.5, 0.0), degrees=True)]
    expected = draw_merge([grid, grid], poses, grid)
    np.testing.assert_array_equal(draw_merge([blocks, blocks], poses, blocks), expected)


def test_a_wide_map_is_drawn_by_what_it_holds():
    rng = np.random.default_rng(0)
    ground = np.unique(rng.integers(0, (3000, 3000, 2), (30_000, 3)), axis=0)
    grid = VoxelGrid(blocks_with(ground, np.uint8(2), (3000, 3000, 400)), np.zeros(3), 0.1)
    tracemalloc.start()
    sheet = draw_maps([grid], width=300)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert (sheet < 200).any()
    # The box has 3.6 billion voxels.
    assert peak < 600_000_000
