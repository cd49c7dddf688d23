"""The voxel painter: what is near hides what is far, sizes, ceilings."""

import numpy as np
import pytest

from voxjax.view.paint import _cube_stamp, ceiling_cut, paint_isometric, paint_top

RED, BLUE = (255, 0, 0), (0, 0, 255)


def _has_color(picture, channel):
    """Whether any pixel is clearly of that channel's colour."""
    others = picture[..., [c for c in range(3) if c != channel]].max(axis=-1).astype(int)
    return bool((picture[..., channel].astype(int) - others > 60).any())


@pytest.mark.parametrize("half", [1, 2, 5])
def test_top_faces_of_neighbours_tile_the_plane(half):
    count = np.zeros((40 * half, 60 * half), int)
    for i in range(8):
        for j in range(8):
            for dx, dy, face in _cube_stamp(half):
                if face == 0:
                    count[half * (i + j) + dy, 30 * half + 2 * half * (j - i) + dx] += 1
    assert count.max() == 1
    assert count.sum() == 64 * 4 * half * half
    assert (count[7 * half : 9 * half, 28 * half : 32 * half] == 1).all()


def test_a_voxel_behind_its_three_visible_neighbours_is_hidden():
    index = np.asarray([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    color = np.asarray([RED, BLUE, BLUE, BLUE], np.uint8)
    assert not _has_color(paint_isometric(index, color, width=120, height=90), 0)
    assert _has_color(paint_isometric(index[:3], color[:3], width=120, height=90), 0)


def test_the_order_of_the_voxels_does_not_change_the_picture():
    rng = np.random.default_rng(0)
    index = np.argwhere(rng.random((9, 8, 7)) < 0.4)
    color = rng.integers(0, 256, (len(index), 3)).astype(np.uint8)
    order = rng.permutation(len(index))
    first = paint_isometric(index, color, width=200, height=160)
    np.testing.assert_array_equal(first, paint_isometric(index[order], color[order], width=200, height=160))


def test_x_goes_to_the_lower_left_and_y_to_the_lower_right():
    for axis, is_left in ((0, True), (1, False)):
        index = np.zeros((21, 3), int)
        index[:, axis] = np.arange(21)
        color = np.full((21, 3), 160, np.uint8)
        color[-1] = RED  # the far end of the axis, nearest to the eye
        picture = paint_isometric(index, color, width=200, height=200).astype(int)
        rows, columns = np.nonzero(picture[..., 0] - picture[..., 1] > 60)
        assert rows.mean() > 100
        assert (columns.mean() < 100) == is_left


@pytest.mark.parametrize("shape", [(1, 1, 1), (3, 200, 2), (150, 4, 90)])
def test_pictures_have_the_size_asked_for_and_show_something(shape):
    states = np.ones(shape, bool)
    color = np.full((states.sum(dtype=np.int64), 3), 80, np.uint8)
    for picture in (
        paint_isometric(np.argwhere(states), color, width=130, height=90),
        paint_top(states, ~states, np.full((*shape[:2], 3), 80, np.uint8), width=130, height=90),
    ):
        assert picture.shape == (90, 130, 3)
        assert (picture < 200).any()


def test_empty_maps_are_blank():
    nothing = np.zeros((4, 4, 4), bool)
    blank = paint_isometric(np.zeros((0, 3), np.int64), np.zeros((0, 3), np.uint8), width=30, height=20)
    assert (blank == 255).all()
    assert (paint_top(nothing, nothing, np.zeros((4, 4, 3), np.uint8), width=30, height=20) == 255).all()


def test_the_view_from_above_has_y_up_and_x_to_the_right():
    occupied = np.zeros((20, 20, 3), bool)
    occupied[19, :, 0] = occupied[:, 19, 0] = True
    color = np.zeros((20, 20, 3), np.uint8)
    picture = paint_top(occupied, np.ones_like(occupied), color, width=100, height=100)
    assert picture[2, 50].max() < 60  # y = 19 lies at the top
    assert picture[50, 97].max() < 60  # x = 19 lies at the right
    assert picture[97, 2].min() > 200


def test_a_ceiling_is_cut_and_an_open_terrain_is_not():
    room = np.zeros((30, 30, 20), bool)
    room[:, :, [0, 19]] = room[[0, 29]] = room[:, [0, 29]] = True
    assert ceiling_cut(room) == 14
    terrain = np.zeros((30, 30, 20), bool)
    terrain[:, :, 0] = terrain[15, 15, :] = True
    assert ceiling_cut(terrain) == 20
    assert ceiling_cut(np.zeros((3, 3, 3), bool)) == 3
