"""Isolated far pieces, against all closed sets of small maps."""

import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from voxjax.maps.isolated import isolated_pieces


def main_part(points, size=1.0):
    """The smallest closed set with 98 % of the points: the chains of closed sets around each of them."""
    distance = np.linalg.norm(points[:, None] - points[None], axis=-1)
    enough, smallest = len(points) - int(0.02 * len(points)), np.ones(len(points), bool)
    for seed in range(len(points)):
        inside = np.arange(len(points)) == seed
        while not inside.all():
            to_inside = distance[:, inside].min(axis=1)
            box = points[inside].max(axis=0) - points[inside].min(axis=0) + size
            near = to_inside <= np.linalg.norm(box)
            if (near == inside).all():
                if inside.sum() >= enough:
                    break
                near |= to_inside <= to_inside[~inside].min()
            inside = near
        if inside.sum() < smallest.sum():
            smallest = inside
    return smallest


def building(rng, num, side=60.0, at=(0.0, 0.0, 0.0)):
    """Points on the walls of a box, in voxels of 1."""
    points = rng.uniform(0, side, (num, 3))
    wall = rng.integers(0, 3, num)
    points[np.arange(num), wall] = side * rng.integers(0, 2, num)
    return np.floor(points) + at


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=60, deadline=None)
def test_what_is_isolated_is_all_but_the_smallest_closed_set(seed):
    rng = np.random.default_rng(seed)
    parts = [building(rng, rng.integers(20, 80), 10 ** rng.uniform(0, 2)) for _ in range(rng.integers(1, 3))]
    parts = [part + rng.normal(0, 10 ** rng.uniform(0, 3), 3) for part in parts]
    strays = rng.normal(0, 1, (rng.integers(0, 4), 3)) * 10 ** rng.uniform(0, 5, (1, 1))
    points = np.concatenate([*parts, strays])
    found = isolated_pieces(points)
    is_main = main_part(points)
    np.testing.assert_array_equal(found.piece == -1, is_main)
    to_main = np.linalg.norm(points[:, None] - points[None, is_main], axis=-1).min(axis=1)
    for piece, (count, distance) in enumerate(zip(found.num_voxels, found.distance, strict=True)):
        assert count == (found.piece == piece).sum() > 0
        assert distance == pytest.approx(to_main[found.piece == piece].min())
    assert (np.diff(found.distance) <= 0).all()
    box = points[is_main].min(axis=0) - 0.5, points[is_main].max(axis=0) + 0.5
    wider = np.linalg.norm(box[1] - box[0])
    np.testing.assert_allclose(found.low, box[0] - wider)
    np.testing.assert_allclose(found.high, box[1] + wider)
    np.testing.assert_allclose(found.sides, box[1] - box[0])


@pytest.mark.parametrize("shift", [0.0, 5.4e6])
def test_a_stray_far_from_a_building_is_isolated_wherever_the_frame_lies(shift):
    metres = building(np.random.default_rng(0), 2000) * 0.1 + shift
    stray = metres[:1] + [600.0, 0, 0]
    found = isolated_pieces(np.concatenate([metres, stray]), voxel_size=0.1)
    assert found.num_voxels.tolist() == [1]
    assert found.piece[-1] == 0
    assert 593 < found.distance[0] < 607


def test_strays_in_several_directions_are_pieces_of_their_own():
    rng = np.random.default_rng(1)
    strays = np.array([[600, 0, 0], [601, 1, 0], [-900, 0, 0], [0, 5000, 0], [0, 0, -100_000]])
    found = isolated_pieces(np.concatenate([building(rng, 500), strays]).astype(np.int64))
    assert found.num_voxels.tolist() == [1, 1, 1, 2]
    assert found.piece[-5:].tolist() == [3, 3, 2, 1, 0]


def test_buildings_far_apart_are_no_isolated_pieces_of_each_other():
    rng = np.random.default_rng(2)
    both = np.concatenate([building(rng, 500), building(rng, 500, at=(2000.0, 0.0, 0.0))])
    assert not len(isolated_pieces(both).distance)
    # What is far from both, though, is isolated: farther than the two span together.
    for away, number in ((1500, 0), (3000, 1)):
        assert len(isolated_pieces(np.concatenate([both, [[1000, away, 0]]])).distance) == number


def test_a_stray_above_a_flat_map_is_isolated_only_beyond_its_width():
    ground = np.argwhere(np.ones((40, 30, 1)))
    for height, number in ((45, 0), (80, 1)):
        assert len(isolated_pieces(np.concatenate([ground, [[20, 15, height]]])).distance) == number


def test_rings_that_thin_out_belong_to_the_map():
    radius = np.geomspace(2, 2000, 14)
    angle = np.linspace(0, 2 * np.pi, 90, endpoint=False)
    rings = np.stack(
        np.broadcast_arrays(radius[:, None] * np.cos(angle), radius[:, None] * np.sin(angle), 0), -1
    )
    assert not len(isolated_pieces(rings.reshape(-1, 3)).distance)


def test_a_point_that_stands_for_many_counts_as_many():
    rng = np.random.default_rng(3)
    points = np.concatenate([building(rng, 300), [[5000, 0, 0], [0, 7000, 0]]])
    for weight in (1, 3, 5):
        weights = np.ones(len(points), np.int64)
        weights[-2] = weight
        repeated = isolated_pieces(np.repeat(points, weights, axis=0))
        found = isolated_pieces(points, weights=weights)
        assert found.num_voxels.tolist() == repeated.num_voxels.tolist()
        np.testing.assert_array_equal(np.repeat(found.piece, weights), repeated.piece)
    # Seven of 308 are more than 2 %, and what is nearer than they are is not isolated either.
    assert not len(isolated_pieces(points, weights=np.append(np.ones(301), 7)).distance)


@pytest.mark.parametrize("num", [0, 1, 49])
def test_small_maps_have_no_isolated_pieces(num):
    points = np.zeros((num, 3))
    points[:1] = 1e6
    found = isolated_pieces(points)
    assert found.piece.tolist() == [-1] * num
    assert found.num_voxels.shape == found.distance.shape == (0,)


def test_memory_follows_the_points_not_their_box():
    points = np.concatenate([building(np.random.default_rng(4), 100_000, 600.0), [[1e9, 0, 0]]])
    tracemalloc.start()
    found = isolated_pieces(points)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert len(found.distance) == 1
    assert peak < 200 * len(points)
