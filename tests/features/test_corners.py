import jax
import numpy as np
import pytest

from block_maps import far_apart, peak_of, ways
from corner_rooms import SIZE, TURNS, room_grid
from oracles import box_room
from small_worlds import draw_map, pose
from voxjax import VoxelGrid
from voxjax._checks import InputError
from voxjax.features.corners import detect_corners


def _match(corners, turn, shift):
    """For each true corner the distance [voxel], normal error [degree] and row of the nearest found one of its kind."""
    position, normals, convexity = box_room.true_corners()
    found = corners.trimmed()
    out = []
    for p, n, kind in zip(position * SIZE @ turn.T + shift, normals @ turn.T, convexity, strict=True):
        rows = np.flatnonzero(found.convexity == kind)
        distance = np.linalg.norm(found.position[rows] - p, axis=1) / SIZE
        row = rows[np.argmin(distance)]
        cosine = np.max(np.abs(found.normals[row] @ n.T) * (found.normals[row] @ n.T > 0), axis=1)
        out.append((distance.min(), np.degrees(np.arccos(np.clip(cosine.min(), 0, 1)))))
    return np.asarray(out)


@pytest.mark.parametrize("turn", TURNS.values(), ids=TURNS.keys())
def test_all_corners_of_a_room_with_a_box_are_found_in_any_frame(turn):
    grid, shift = room_grid(turn)
    corners = detect_corners(grid)
    assert corners.num_listed == int(corners.num_found) == 16
    distance, angle = _match(corners, turn, shift).T
    assert distance.max() < 1.0
    assert angle.max() < 4.0
    assert corners.trimmed().is_observed.all()


def test_normals_are_unit_right_handed_rows():
    corners = detect_corners(room_grid(TURNS["any"])[0]).trimmed()
    np.testing.assert_allclose(np.linalg.norm(corners.normals, axis=2), 1.0, atol=1e-5)
    assert (np.linalg.det(corners.normals) > 0.9).all()


def test_the_face_that_differs_comes_first():
    turn = TURNS["yaw"]
    corners = detect_corners(room_grid(turn)[0]).trimmed()
    foot = corners.convexity == 1
    assert foot.sum() == 4
    assert (corners.normals[foot, 0] @ turn[:, 2] > 0.99).all()


def test_corners_survive_noise():
    turn = TURNS["any"]
    grid, shift = room_grid(turn, noise=0.25, thickness=0.8)
    rooms = _match(detect_corners(grid), turn, shift)[::2]
    assert (rooms[:, 0] < 2.0).all()


def test_hidden_corners_are_found_where_the_planes_meet():
    states, vector = box_room.room_map(np.eye(3))
    low = np.floor(vector).astype(int)
    states[low[0] - 1 : low[0] + 9, low[1] - 1 : low[1] + 9, low[2] - 1 : low[2] + 9] = 0
    grid = VoxelGrid(states, np.zeros(3, np.float32), SIZE)
    place = (vector + 0.5) * SIZE
    seen = detect_corners(grid).trimmed()
    both = detect_corners(grid, virtual=True).trimmed()
    assert np.linalg.norm(seen.position - place, axis=1).min() > 3 * SIZE
    distance = np.linalg.norm(both.position - place, axis=1)
    assert distance.min() < SIZE
    assert not both.is_observed[np.argmin(distance)]
    assert both.convexity[np.argmin(distance)] == 255
    assert both.is_observed[: len(seen.position)].all()


def test_num_found_tells_of_virtual_corners_that_are_not_listed():
    grid, _ = room_grid(np.eye(3))
    few = detect_corners(grid, virtual=True, max_virtual=2)
    many = detect_corners(grid, virtual=True, max_virtual=500)
    assert int(few.num_found) == int(many.num_found) == many.num_listed > few.num_listed


def test_same_map_same_corners():
    grid, _ = room_grid(TURNS["any"])
    a, b = (detect_corners(grid, virtual=True) for _ in range(2))
    np.testing.assert_array_equal(a.position, b.position)
    np.testing.assert_array_equal(a.normals, b.normals)


@pytest.mark.parametrize("preset", ["default", "paper"])
@pytest.mark.parametrize("case", ["empty", "one voxel", "wall", "no free space"])
def test_maps_without_corners_give_none(preset, case):
    states = np.zeros((12, 12, 12), np.uint8)
    if case == "one voxel":
        states[5, 5, 5] = 2
    if case in ("wall", "no free space"):
        states[4] = 2
    if case == "wall":
        states[5:] = 1
    corners = detect_corners(VoxelGrid(states, np.zeros(3), SIZE), preset=preset, virtual=preset == "default")
    assert corners.num_listed == int(corners.num_found) == 0
    assert not np.asarray(corners.mask).any()


def test_unknown_preset_and_reach_are_refused():
    grid = VoxelGrid(np.zeros((3, 3, 3), np.uint8), np.zeros(3), SIZE)
    with pytest.raises(InputError, match="virtual_reach"):
        detect_corners(grid, virtual_reach=0.0)


def test_corners_are_the_same_in_blocks_and_in_tiles(monkeypatch):
    maps = ways(draw_map(pose(yaw=33.0, tilt=12.0)), monkeypatch, most=1 << 17)
    # Dense in one tile, and in blocks in several.
    found = [detect_corners(each, virtual=True) for number, each in enumerate(maps) if number in (0, 3)]
    assert found[0].num_listed > 20
    for one, two in zip(*map(jax.tree.leaves, found), strict=True):
        np.testing.assert_array_equal(one, two)


def test_corners_of_two_maps_far_apart_take_memory_for_these_and_not_for_the_box(monkeypatch):
    room = draw_map(pose(yaw=33.0, tilt=12.0))
    grid = far_apart(room)
    alone = detect_corners(room).num_listed
    # An estimate by the box would refuse the map.
    monkeypatch.setenv("VOXJAX_MEMORY", "0.1")
    found, peak = peak_of(lambda: detect_corners(grid).trimmed())
    is_far = found.position[:, 0] > 300.0
    assert alone > 5
    assert np.count_nonzero(is_far) == pytest.approx(alone, abs=1)
    assert np.count_nonzero(~is_far) == pytest.approx(alone, abs=1)
    assert peak < 60e6 < grid.num_voxels / 50
    with pytest.raises(InputError, match="finding corners"):
        detect_corners(grid, preset="paper")
