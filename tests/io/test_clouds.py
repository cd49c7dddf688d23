"""Which points of a cloud are places, which are equal, and what rounding has left of them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from clouds import room_points
from voxjax import InputError
from voxjax.io.clouds import (
    check_no_duplicates,
    check_precision,
    chosen_spacing,
    filled_voxels,
    lost_steps,
    ordered_points,
    usable_cloud,
)

UTM = np.array([4.5e5, 5.4e6, 300.0])
POINTS = np.array([[0, 0, 0], [np.nan, 1, 2], [1, 1, 1], [2, -np.inf, 2], [3, 3, 3]])


def test_what_is_no_place_is_left_out_with_its_sensor():
    cloud = usable_cloud(POINTS, np.arange(15).reshape(5, 3), strict=False)
    np.testing.assert_array_equal(cloud.points[:, 0], [0, 1, 3])
    assert cloud.sensor_origins is not None
    np.testing.assert_array_equal(cloud.sensor_origins[:, 0], [0, 6, 12])
    assert (cloud.num_dropped, cloud.num_rows) == (2, 5)
    one = usable_cloud(POINTS, [1, 2, 3], strict=False).sensor_origins
    np.testing.assert_array_equal(one, [1, 2, 3])


@pytest.mark.parametrize(
    ("points", "origins", "strict", "sentence"),
    [
        (POINTS, None, True, r"2 of 5 points .* strict \(--strict\) refuses"),
        (POINTS[1:2], None, False, "all 1 points of the cloud are NaN or infinite"),
        (POINTS[:0], None, False, "no points"),
        (POINTS * 1e20, None, False, r"2 of 5 points lie beyond 1e\+12 m"),
        (POINTS, "here", False, "sensor_origins must be an array of numbers"),
    ],
)
def test_what_cannot_be_used_is_refused(points, origins, strict, sentence):
    with np.errstate(invalid="ignore"), pytest.raises(InputError, match=sentence):
        usable_cloud(points, origins, strict=strict)


def test_each_place_is_counted_once():
    points = np.array([[1, 2, 3], [0, 2, 3], [1, 2, 3], [-0.0, 2, 3], [1, 2, 4]], np.float32)
    ordered = ordered_points(points)
    assert {tuple(point) for point in ordered.distinct} == {(1, 2, 3), (0, 2, 3), (1, 2, 4)}
    assert len(ordered.distinct) == 3
    with pytest.raises(
        InputError, match=r"2 of 5 points are equal to others.*, which strict \(--strict\) refuses"
    ):
        check_no_duplicates(ordered)
    check_no_duplicates(ordered_points(ordered.distinct))


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=30, deadline=None)
def test_filled_voxels_are_those_of_the_points(seed):
    rng = np.random.default_rng(seed)
    points = rng.normal(0, 10 ** rng.uniform(0, 12), (50, 3)) * 10 ** rng.uniform(-2, 0, 3)
    points = np.repeat(points, 2, axis=0)
    size = 10 ** rng.uniform(-3, 2)
    expected = np.unique(np.floor(points / size), axis=0)
    np.testing.assert_array_equal(filled_voxels(points, size), expected)


def test_a_cloud_that_single_precision_rounded_is_recognised():
    points = room_points(0.05) + UTM
    assert lost_steps(points.astype(np.float32)).tolist() == [0.03125, 0.5, 2.0**-15]
    # What keeps the numbers now does not matter, and what was never rounded lost nothing.
    assert lost_steps(points.astype(np.float32).astype(np.float64)).max() == 0.5
    assert lost_steps(points).max() == 0.0
    assert lost_steps(np.floor(points).astype(np.float32)).max() == 0.0
    assert lost_steps(room_points(0.05).astype(np.float32)).max() < 1e-6


def test_a_stray_far_out_makes_no_cloud_too_coarse():
    points = np.concatenate([room_points(0.05), [[1e8, 0, 0]]]).astype(np.float32)
    check_precision(points, 0.05, "voxels of 0.05 m")


def test_lost_digits_are_refused_with_the_reason():
    points = (room_points(0.05) + UTM).astype(np.float32)
    with pytest.raises(InputError) as caught:
        check_precision(points, 0.1, "voxels of 0.1 m")
    for words in ("its y coordinates", "5,400,000 m", "0.5 m apart", "voxels of 0.1 m", "doubles", "offset"):
        assert words in str(caught.value)
    check_precision(points, 0.5, "voxels of 0.5 m")
    # A voxel size that is estimated would be that of the rounding.
    with pytest.raises(InputError, match=r"the spacing of the points, which seems to be 0\.0"):
        chosen_spacing(ordered_points(points), points)


def test_a_coarse_cloud_far_out_keeps_its_spacing():
    points = (room_points(2.0) + UTM).astype(np.float32)
    assert chosen_spacing(ordered_points(points), points).voxel_size == 2.0


def test_points_without_a_surface_need_a_voxel_size():
    points = np.random.default_rng(0).random((3, 3))
    with pytest.raises(InputError, match=r"cannot be estimated.*--voxel-size"):
        chosen_spacing(ordered_points(points), points)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("far", [600.0, 1e6, 1e11])
def test_a_stray_does_not_decide_the_spacing(dtype, far):
    index = np.floor(room_points(0.1) / 0.15)
    points = ((np.unique(index, axis=0) + 0.5) * 0.15).astype(dtype)
    stray = np.array([[far, 0.0, 0.0]], dtype)  # beside the lattice of the others
    both = np.concatenate([points, stray])
    found = chosen_spacing(ordered_points(both), both)
    assert found == chosen_spacing(ordered_points(points), points)
    assert found.voxel_size == 0.15
