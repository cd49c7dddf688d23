"""The voxel painter: what is near hides what is far, sizes."""

import tracemalloc

import numpy as np
import pytest

from voxjax.view.columns import top_columns
from voxjax.view.paint import _cube_stamp, paint_isometric, paint_top

RED, BLUE = (255, 0, 0), (0, 0, 255)


def _from_above(occupied, free, color, **size):
    index = np.argwhere(occupied)
    columns = top_columns(index, np.broadcast_to(np.asarray(color, np.uint8), index.shape))
    return paint_top(columns, free.any(axis=2), np.zeros(2, np.int64), **size)


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
        _from_above(states, ~states, 80, width=130, height=90),
    ):
        assert picture.shape == (90, 130, 3)
        assert (picture < 200).any()


def test_empty_maps_are_blank():
    nothing = np.zeros((4, 4, 4), bool)
    blank = paint_isometric(np.zeros((0, 3), np.int64), np.zeros((0, 3), np.uint8), width=30, height=20)
    assert (blank == 255).all()
    assert (_from_above(nothing, nothing, 0, width=30, height=20) == 255).all()


def test_the_view_from_above_has_y_up_and_x_to_the_right():
    occupied = np.zeros((20, 20, 3), bool)
    occupied[19, :, 0] = occupied[:, 19, 0] = True
    picture = _from_above(occupied, np.ones_like(occupied), 0, width=100, height=100)
    assert picture[2, 50].max() < 60  # y = 19 lies at the top
    assert picture[50, 97].max() < 60  # x = 19 lies at the right
    assert picture[97, 2].min() > 200


def test_a_map_from_above_is_painted_some_rows_at_a_time(monkeypatch):
    rng = np.random.default_rng(0)
    occupied, free = rng.random((2, 500, 150, 2)) < 0.3
    whole = _from_above(occupied, free, (200, 90, 40), width=70, height=60)
    # Strips are as low as whole rows of the smaller picture allow.
    monkeypatch.setattr("voxjax.view.paint.CELLS_AT_ONCE", 1)
    np.testing.assert_array_equal(_from_above(occupied, free, (200, 90, 40), width=70, height=60), whole)


def test_voxels_are_made_larger_where_a_picture_would_be_too_large():
    corners = np.array([[0, 0, 0], [9000, 0, 0], [0, 9000, 0], [9000, 9000, 3]])
    index = np.concatenate([corners, np.argwhere(np.ones((400, 400, 1))) + [4300, 4300, 0]])
    color = np.full((len(index), 3), 60, np.uint8)
    tracemalloc.start()
    picture = paint_isometric(index, color, width=400, height=300)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert (picture[140:160, 190:210] < 200).any()
    assert peak < 500_000_000
