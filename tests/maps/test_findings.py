"""Remarks about maps, from numbers alone."""

import json

import numpy as np
import pytest

from voxjax.maps.findings import (
    dropped_remark,
    duplicates_remark,
    emptiness_remark,
    estimate_remark,
    faces_remark,
    far_frame_remark,
    grid_remarks,
    isolated_remark,
    rounded_origin_remark,
    units_remark,
)
from voxjax.maps.isolated import isolated_pieces


def test_remarks_are_plain_data():
    remark = estimate_remark(0.05, 0.043, None)
    assert json.loads(json.dumps(remark.as_dict(), allow_nan=False)) == {
        "code": "estimated_voxel_size",
        "text": remark.text,
        "voxel_size": 0.05,
        "spacing_m": 0.043,
    }
    assert "0.043 m" in remark.text
    on_lattice = estimate_remark(0.3, np.inf, 0.3)
    assert "lattice of 0.3 m" in on_lattice.text
    assert np.isfinite(on_lattice.numbers["spacing_m"])


def test_pieces_are_named_with_their_number_and_distance():
    room = np.argwhere(np.ones((9, 9, 9))).astype(float)
    far = [[100.0, 0, 0], [101.0, 0, 0], [0, -5000.0, 0]]
    remark = isolated_remark(isolated_pieces(np.concatenate([room, far])))
    assert remark is not None
    assert remark.text.startswith("isolated from the rest by 92 to 5,000 m: 3 occupied voxels in 2 pieces;")
    one = isolated_remark(isolated_pieces(np.concatenate([room, far[2:]])), is_dropped=True)
    assert one is not None
    assert one.text == "isolated from the rest by 5,000 m: 1 occupied voxel in 1 piece; they were left out"
    assert isolated_remark(isolated_pieces(room)) is None


def test_points_that_were_dropped_are_counted():
    assert dropped_remark(0, 10) is None
    remark = dropped_remark(1204, 30_000)
    assert remark is not None
    assert remark.text == "1,204 of 30,000 points are NaN or infinite and were dropped"


def test_the_place_of_most_duplicates_is_named():
    points = np.array([[0, 0, 0]] * 5 + [[1, 0, 0]] + [[2, 0, 0]] * 2, float)
    is_first = np.array([True, False, False, False, False, True, True, False])
    remark = duplicates_remark(points, is_first)
    assert remark is not None
    assert "5 of 8 points are equal to others, 4 of them at (0, 0, 0), as rays" in remark.text
    assert duplicates_remark(points[[0, 5, 6]], is_first[[0, 5, 6]]) is None


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("frame", [0.0, 3000.0])
def test_points_on_faces_are_seen_beside_chance(dtype, frame):
    rng = np.random.default_rng(0)
    anywhere = rng.uniform(0, 30, (4000, 3)) + frame
    assert faces_remark(anywhere.astype(dtype), 0.1) is None
    # Millimetres, as text files have them, meet faces of voxels of 5 cm by chance.
    assert faces_remark(np.round(anywhere, 3).astype(dtype), 0.05) is None
    corners = (np.floor(anywhere / 0.1) * 0.1).astype(np.float32).astype(dtype)
    remark = faces_remark(corners, 0.1)
    assert remark is not None
    assert remark.numbers["share"] == 1.0
    assert "half a voxel" in remark.text
    one_axis = anywhere.astype(dtype)
    one_axis[:2000, 2] = corners[:2000, 2]
    remark = faces_remark(one_axis, 0.1)
    assert remark is not None
    assert remark.numbers["share"] == pytest.approx(0.5, abs=0.05)
    assert faces_remark((corners + 0.05).astype(dtype), 0.1) is None


@pytest.mark.parametrize(
    ("spacing", "sides", "factor"),
    [
        (0.02, (4, 3, 3), None),  # a fragment of a kitchen
        (0.1, (62, 28, 11), None),
        (0.3, (176, 151, 19), None),
        (2.0, (8000, 6000, 900), None),  # a valley
        (50.0, (9000, 7000, 2800), 0.001),  # rooms in millimetres
        (2.0, (9000, 7000, 2800), 0.001),
        (np.inf, (9000, 7000, 2800), 0.001),
        (0.328084, (33, 26, 10), 0.3048),  # 10 cm in feet
        (0.164042, (33, 26, 10), 0.3048),
        (3.28084, (3000, 2000, 100), 0.3048),
        (0.3048, (33, 26, 10), None),  # feet that somebody has brought to metres
        (0.0437, (22, 14, 11), None),
    ],
)
def test_lengths_that_no_robot_has_hint_at_another_unit(spacing, sides, factor):
    remark = units_remark(spacing, np.asarray(sides))
    if factor is None:
        assert remark is None
    else:
        assert remark is not None
        assert remark.numbers["factor"] == factor
        assert f"multiply all coordinates by {factor:g}" in remark.text
        json.dumps(remark.as_dict(), allow_nan=False)


@pytest.mark.parametrize(
    ("centre", "voxel_size", "is_far"),
    [
        ((0, 0, 0), 0.1, False),
        ((2000, -900, 30), 0.1, False),
        ((4.5e5, 5.4e6, 300), 0.1, True),
        ((4.5e5, 0, 0), 5.0, False),
    ],
)
def test_a_frame_is_far_where_single_precision_would_lose_places(centre, voxel_size, is_far):
    low, high = np.asarray(centre) - 10.0, np.asarray(centre) + 10.0
    remark = far_frame_remark(low, high, voxel_size)
    assert (remark is not None) == is_far
    if remark is not None:
        assert "5,418,718 m from the origin" in remark.text
        assert remark.numbers["float32_step_m"] == 0.5


def test_a_box_is_nearly_empty_where_even_its_largest_side_would_hold_far_more():
    assert emptiness_remark((500, 500, 50), 250_000) is None
    assert emptiness_remark((500, 500, 50), 2_500) is None
    assert emptiness_remark((500, 500, 50), 0) is None
    remark = emptiness_remark((500, 50, 500), 2_400)
    assert remark is not None
    assert remark.numbers["share_known"] == pytest.approx(2400 / (500 * 500 * 50))


def test_strays_say_more_than_that_a_box_is_empty():
    low, high = np.zeros(3), np.array([500.0, 500.0, 50.0])
    assert [r.code for r in grid_remarks(low, high, 1.0, 100, has_strays=False)] == ["nearly_empty"]
    assert grid_remarks(low, high, 1.0, 100, has_strays=True) == []
    assert grid_remarks(low, high, 1.0, 100_000, has_strays=False) == []


def test_an_origin_that_single_precision_holds_is_no_remark():
    assert rounded_origin_remark(np.array([100.0, -200.0, 0.0]), 0.1) is None
    remark = rounded_origin_remark(np.array([100.0, -3e4, 0.0]), 0.05)
    assert remark is not None
    assert remark.numbers["float32_step_m"] == pytest.approx(0.00195, rel=0.01)
    assert "float64" not in remark.text
