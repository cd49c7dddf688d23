import numpy as np
import pytest

from oracles import surfaces
from voxjax.ops.moments import surface_moments
from voxjax.ops.window_bits import ball_offsets


def _scene(seed=0):
    """A noisy tilted wall in front of free space."""
    rng = np.random.default_rng(seed)
    x, y, z = np.meshgrid(*(np.arange(n) for n in (18, 16, 12)), indexing="ij")
    height = 0.45 * x + 0.2 * y + 1.0 + rng.uniform(-0.4, 0.4, x.shape)
    return np.where(np.abs(z - height) < 0.8, 2, np.where(z > height, 1, 0)).astype(np.uint8)


@pytest.mark.parametrize("size", [3, 5, 7])
def test_normals_and_curvature_equal_principal_components(size):
    states = _scene()
    index = np.argwhere(states == 2).astype(np.int32)[::7]
    moments = surface_moments(states, index, size=size)
    for row, place in enumerate(index):
        normal, curvature, count, values = surfaces.normal_and_curvature(states, place, size)
        assert int(moments.num_occupied[row]) == count
        if count >= 6 and values[1] - values[0] > 0.05:
            assert float(moments.curvature[row]) == pytest.approx(curvature, abs=2e-3)
            assert abs(float(np.dot(moments.normal[row], normal))) > 1 - 1e-4


def test_moved_along_their_normals_voxels_lie_on_the_wall():
    x, y, z = np.meshgrid(*(np.arange(n) for n in (24, 22, 16)), indexing="ij")
    gap = z - (0.23 * x + 0.11 * y + 2.3)
    states = np.where(np.abs(gap) < 0.5, 2, np.where(gap > 0, 1, 0)).astype(np.uint8)
    index = np.argwhere(states == 2).astype(np.int32)
    inner = index[((index > 3) & (index < np.asarray(states.shape) - 4)).all(axis=1)]
    moments = surface_moments(states, inner, size=7)
    up = np.asarray([-0.23, -0.11, 1.0]) / np.linalg.norm([-0.23, -0.11, 1.0])

    def distance(points):
        return points @ up - 2.3 * up[2]

    moved = inner + np.asarray(moments.offset)[:, None] * np.asarray(moments.normal)
    assert np.sqrt(np.mean(distance(inner) ** 2)) > 0.25
    assert np.sqrt(np.mean(distance(moved) ** 2)) < 0.06


def test_normals_point_into_free_space():
    states = _scene()
    index = np.argwhere(states == 2).astype(np.int32)
    moments = surface_moments(states, index, size=7)
    inner = ((index > 3) & (index < np.asarray(states.shape) - 4)).all(axis=1)
    up = np.asarray([-0.45, -0.2, 1.0]) / np.linalg.norm([-0.45, -0.2, 1.0])
    assert inner.any()
    assert (np.asarray(moments.normal)[inner] @ up > 0.8).all()
    assert np.asarray(moments.has_free)[inner].all()


def test_distance_to_free_space_is_counted_on_both_sides():
    states = np.full((9, 9, 11), 1, np.uint8)
    states[:, :, 4:6] = 2
    states[:, :, :3] = 0
    index = np.asarray([[4, 4, 4], [4, 4, 5]], np.int32)
    moments = surface_moments(states, index, size=7)
    up = np.sign(np.asarray(moments.normal)[:, 2])
    distance = np.asarray(moments.free_distance)
    above = np.where(up > 0, distance[:, 0], distance[:, 1])
    below = np.where(up > 0, distance[:, 1], distance[:, 0])
    np.testing.assert_array_equal(above, [2, 1])
    np.testing.assert_array_equal(below, [1, 2])


def test_unknown_space_hides_what_lies_behind_it():
    states = np.zeros((9, 9, 9), np.uint8)
    states[:, :, 4] = 2
    states[:, :, 6:] = 1
    moments = surface_moments(states, np.asarray([[4, 4, 4]], np.int32), reach=3)
    np.testing.assert_array_equal(np.asarray(moments.free_distance), [[4, 4]])


def test_padding_rows_change_nothing():
    states = _scene(1)
    index = np.argwhere(states == 2).astype(np.int32)[:50]
    padded = np.concatenate([index, np.zeros((14, 3), np.int32)])
    for a, b in zip(surface_moments(states, index), surface_moments(states, padded), strict=True):
        np.testing.assert_array_equal(np.asarray(a), np.asarray(b)[:50])


def test_lonely_voxels_and_empty_lists_are_no_error():
    states = np.zeros((5, 5, 5), np.uint8)
    states[2, 2, 2] = 2
    lonely = surface_moments(states, np.asarray([[2, 2, 2]], np.int32))
    assert int(lonely.num_occupied[0]) == 1
    assert float(lonely.curvature[0]) == 0.0
    assert np.isfinite(np.asarray(lonely.normal)).all()
    assert surface_moments(states, np.zeros((0, 3), np.int32)).normal.shape == (0, 3)


def test_window_is_a_ball():
    assert len(ball_offsets(3)) == 19
    assert len(ball_offsets(1)) == 1
    offsets = {tuple(o) for o in ball_offsets(7).tolist()}
    assert offsets == {(-x, z, y) for x, y, z in offsets}
