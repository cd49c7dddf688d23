"""The voxel size that follows from the spacing of points."""

import json
import math
import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from clouds import room_points
from voxjax.io.clouds import ordered_points, rounding_of
from voxjax.io.ply import decode_ply
from voxjax.io.spacing import closing_lengths, cloud_spacing, lattice_step, round_length


def spacing_of(points):
    return cloud_spacing(ordered_points(points).distinct, rounding_of(points))


@pytest.mark.parametrize("spacing", [0.02, 0.05, 0.5, 2.0])
def test_rooms_get_the_voxel_size_at_which_their_walls_are_closed(spacing):
    points = room_points(spacing)
    found = spacing_of(points)
    # Of points thrown at random with one a square, half have a neighbour in each quadrant within 1.53 sides.
    assert found.closing == pytest.approx(1.53 * spacing, rel=0.05)
    assert found.lattice is None
    assert found.voxel_size == round_length(found.closing)
    # Few places on the walls are then without a point in the voxel around them, and many in one of half the width.
    places = room_points(spacing, seed=1)

    def share_of_holes(size):
        is_filled = {tuple(index) for index in np.floor(points / size).astype(int)}
        return np.mean([tuple(index) not in is_filled for index in np.floor(places / size).astype(int)])

    assert share_of_holes(found.closing) < 0.2
    assert share_of_holes(found.closing / 2) > 0.4


@given(st.floats(1e-4, 1e4))
@settings(max_examples=20, deadline=None)
def test_a_scaled_cloud_has_its_lengths_scaled(scale):
    points = ordered_points(room_points(1.0, sides=(12, 10, 8))).distinct
    expected = scale * np.asarray(closing_lengths(points))
    np.testing.assert_allclose(closing_lengths(scale * points), expected, rtol=1e-6)
    assert spacing_of(scale * points).voxel_size == round_length(expected[0])


def test_a_square_lattice_is_closed_at_its_step():
    plane = np.stack(np.meshgrid(np.arange(40.0), np.arange(40.0), 0.0), -1).reshape(-1, 3) @ turn()
    # Turned, so that no coordinates are multiples of the step.
    found = spacing_of(0.3 * plane)
    assert found.closing == pytest.approx(0.3, rel=1e-6) or found.closing == pytest.approx(0.3 * math.sqrt(2))
    assert found.nearest == pytest.approx(0.3)
    assert found.lattice is None


def turn():
    return np.linalg.qr(np.array([[1.0, 0.4, -0.2], [-0.3, 1.0, 0.5], [0.2, -0.6, 1.0]]))[0]


@pytest.mark.parametrize("density", [10, 40])
def test_scan_lines_are_as_far_apart_as_their_neighbours(density):
    rng = np.random.default_rng(0)
    along, line = rng.uniform(0, 30, 40 * 30 * density), rng.integers(0, 40, 40 * 30 * density)
    points = np.stack([along, 0.5 * line, np.zeros(len(along))], 1) @ turn()
    found = spacing_of(points)
    assert found.nearest < 0.05
    assert 0.5 <= found.closing < 0.55


def test_a_lidar_on_the_ground_is_measured_where_half_of_its_points_are():
    # Beams at equal angles: rings whose distance grows with the square of their radius.
    angle = np.radians(np.linspace(2, 25, 32))
    radius, azimuth = 1.7 / np.tan(angle), np.linspace(0, 2 * np.pi, 1500, endpoint=False)
    rings = [
        radius[:, None] * np.cos(azimuth),
        radius[:, None] * np.sin(azimuth),
        0 * radius[:, None] * azimuth,
    ]
    points = np.stack(np.broadcast_arrays(*rings), -1).reshape(-1, 3)
    found = spacing_of(points)
    # Half of the rings lie within the median radius, where the next one out is this far.
    median_gap = np.sort(np.abs(np.diff(radius)))[len(radius) // 2]
    assert median_gap / 2 < found.closing < 2 * median_gap
    # Distances to the nearest point, which follow the azimuth alone, would give a tenth of it.
    assert found.nearest < found.closing / 5


@pytest.mark.parametrize(("step", "dtype"), [(0.04, np.float32), (0.3, np.float32), (1 / 3, np.float64)])
@pytest.mark.parametrize("shift", [0.0, 0.37])
def test_centres_of_voxels_have_the_step_of_their_lattice(step, dtype, shift):
    index = np.unique(np.floor(room_points(1.0, sides=(30, 20, 15))), axis=0)
    points = ((index + 0.5 + shift) * step).astype(dtype)
    found = spacing_of(points)
    assert found.lattice == pytest.approx(step, rel=1e-12)
    assert found.voxel_size == found.lattice
    # What is left of a map when most of its voxels are thrown away is no surface at the old step.
    few = spacing_of(points[np.random.default_rng(0).random(len(points)) < 0.1])
    assert few.lattice == pytest.approx(step, rel=1e-12)
    assert round(few.voxel_size / step, 9) in (2, 5)
    assert few.voxel_size <= few.closing


def test_a_line_of_voxels_has_a_lattice_though_it_is_no_surface():
    points = np.zeros((30, 3))
    points[:, 0] = np.arange(30) * 0.2
    found = spacing_of(points)
    assert math.isinf(found.closing)
    assert found.voxel_size == 0.2


def test_coordinates_of_few_digits_are_no_centres_of_voxels():
    points = room_points(0.05)
    found = spacing_of(np.round(points, 3))
    assert found.lattice is None
    assert found.voxel_size == spacing_of(points).voxel_size


def test_what_lies_on_no_lattice_has_no_step():
    points = room_points(0.05, sides=(12, 10, 8))
    assert lattice_step(points, 1e-9) is None
    assert lattice_step(np.zeros((3, 3)), 1e-9) is None
    lattice = np.stack(np.meshgrid(*[np.arange(5.0)] * 3), -1).reshape(-1, 3)
    assert lattice_step(lattice, 1e-6) == 1.0
    assert lattice_step(lattice, 0.3) is None
    assert lattice_step(np.concatenate([lattice, [[2.4, 0, 0]]]), 1e-6) is None


def test_many_neighbours_take_little_memory():
    # On a line nothing lies across, so that as many neighbours are asked for as may be.
    points = room_points(0.05) * [1, 0, 0]
    tracemalloc.start()
    try:
        closing_lengths(points)
        assert tracemalloc.get_traced_memory()[1] < 24e6
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("count", [0, 1, 2, 4])
def test_few_points_have_no_voxel_size(count):
    points = np.random.default_rng(0).random((count, 3))
    assert math.isinf(spacing_of(points).voxel_size)


@pytest.mark.parametrize(
    ("length", "rounded"),
    [
        (0.0316, 0.02),
        (0.0317, 0.05),
        (0.07, 0.05),
        (0.08, 0.1),
        (0.99, 1.0),
        (1.41, 1.0),
        (1.42, 2.0),
        (80.0, 100.0),
    ],
)
def test_lengths_are_rounded_by_ratio(length, rounded):
    assert round_length(length) == rounded
    assert round_length(math.inf) == math.inf


@pytest.mark.real_maps
def test_clouds_of_real_places_get_about_the_voxel_size_that_people_gave_them(maps_folder):
    found = 0
    for path in sorted((maps_folder / "real").glob("*/?.ply")):
        chosen = json.loads((path.parent / "truth.json").read_text())["resolution"]
        size = spacing_of(decode_ply(path.read_bytes())).voxel_size
        assert 0.5 <= size / chosen <= 2.0, (path, size, chosen)
        found += 1
    assert found > 10
