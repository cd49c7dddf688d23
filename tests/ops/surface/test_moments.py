from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from compilations import compilations
from oracles import surfaces
from voxjax._checks import InputError
from voxjax._runtime.pieces import one_by_one, over_pieces
from voxjax.ops.blocks import over_tiles
from voxjax.ops.surface import moments as module
from voxjax.ops.surface.ball_sums import ball_offsets
from voxjax.ops.surface.moments import surface_moments, tiled_moments


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
        assert float(moments.curvature[row]) == pytest.approx(curvature, abs=1e-5)
        if values[1] - values[0] > 0.01:
            assert abs(float(np.dot(moments.normal[row], normal))) > 1 - 1e-5


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


def _equal(ones, others):
    for one, other in zip(ones, others, strict=True):
        np.testing.assert_array_equal(np.asarray(one), np.asarray(other))
        assert np.asarray(one).dtype == np.asarray(other).dtype


def test_normals_of_a_post_point_away_from_it_and_not_along_it():
    states = np.full((12, 12, 16), 1, np.uint8)
    states[5:7, 5:7] = 2
    index = np.argwhere(states == 2).astype(np.int32)
    moments = surface_moments(states, index)
    away = np.where(index[:, :2] == 5, -1.0, 1.0) / np.sqrt(2.0)
    inner = (index[:, 2] > 3) & (index[:, 2] < 12)
    np.testing.assert_allclose(moments.normal[inner], np.pad(away, ((0, 0), (0, 1)))[inner], atol=1e-5)
    assert moments.has_free.all()


def test_turned_grids_have_turned_normals():
    states = np.random.default_rng(4).choice(3, (11, 12, 13), p=[0.5, 0.42, 0.08]).astype(np.uint8)
    states[3:5, 3:5] = 2  # a post, whose two small eigenvalues tie
    states[8, 2:10, 6] = 2  # and a rod
    index = np.argwhere(states == 2).astype(np.int32)
    moments = surface_moments(states, index)
    for axes in ((0, 1), (1, 2), (2, 0)):
        turned = np.ascontiguousarray(np.rot90(states, axes=axes))
        places, normal = index.copy(), moments.normal.copy()
        places[:, axes[0]] = states.shape[axes[1]] - 1 - index[:, axes[1]]
        places[:, axes[1]] = index[:, axes[0]]
        normal[:, axes[0]], normal[:, axes[1]] = -moments.normal[:, axes[1]], moments.normal[:, axes[0]]
        there = surface_moments(turned, places)
        np.testing.assert_array_equal(there.has_free, moments.has_free)
        assert moments.has_free.mean() > 0.9
        np.testing.assert_allclose(there.normal[moments.has_free], normal[moments.has_free], atol=2e-4)


@pytest.mark.parametrize("rest", [0, 1])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_where_nothing_tells_normals_apart_all_are_alike(axis, rest):
    lines = np.full((16, 16, 16), rest, np.uint8)
    walls = lines.copy()
    np.moveaxis(lines, axis, 0)[:, 8, 8] = 2
    np.moveaxis(walls, axis, 0)[8] = 2
    for states, along in ((lines, 0.0), (walls, 1.0)):
        index = np.argwhere(states == 2).astype(np.int32)
        inner = index[((index > 3) & (index < 12)).all(axis=1)]
        normal = surface_moments(states, inner).normal
        np.testing.assert_allclose(normal, normal[:1].repeat(len(normal), 0), atol=1e-5)
        np.testing.assert_allclose(np.abs(normal[:, axis]), along, atol=1e-5)


def test_pieces_and_threads_and_the_device_give_the_same_bits(monkeypatch):
    states = np.tile(_scene(), (3, 4, 5))
    index = np.argwhere(states == 2).astype(np.int32)
    assert len(index) > 10_000
    expected = surface_moments(states, index)
    assert all(isinstance(a, np.ndarray) for a in expected)
    _equal(surface_moments(jnp.asarray(states), jnp.asarray(index)), expected)
    _equal([a[::-1] for a in surface_moments(states, index[::-1])], expected)
    _equal(surface_moments(states, index[7000:7010]), [a[7000:7010] for a in expected])
    monkeypatch.setattr(module, "_PIECE", 4096)
    monkeypatch.setattr(module, "over_pieces", partial(over_pieces, run=one_by_one))
    _equal(surface_moments(states, index), expected)


def test_several_grids_at_once_under_vmap():
    states = np.stack([_scene(seed) for seed in range(2)])
    index = np.stack([np.argwhere(one == 2)[:40] for one in states]).astype(np.int32)
    batched = jax.vmap(lambda s, i: surface_moments(s, i, size=5))(states, index)
    for k in range(2):
        for one, other in zip(batched, surface_moments(states[k], index[k], size=5), strict=True):
            np.testing.assert_allclose(one[k], other, atol=1e-5)


def test_constants_of_a_traced_function_are_values():
    states = _scene()
    index = np.argwhere(states == 2).astype(np.int32)
    traced = jax.jit(lambda scale: scale * surface_moments(states, index).normal)(np.float32(1))
    np.testing.assert_array_equal(traced, surface_moments(states, index).normal)


def test_ten_grids_of_ten_sizes_share_their_kernels():
    kernel: Any = module._moments_of_piece.__wrapped__
    kernel.clear_cache()  # what earlier tests compiled would not be counted
    rng = np.random.default_rng(0)
    with compilations() as found:
        for side in (9, 12, 15, 20, 33, 47, 64, 90, 130, 170):
            states = rng.choice(3, (side, side + 3, side + 1), p=[0.45, 0.5, 0.05]).astype(np.uint8)
            index = np.argwhere(states == 2).astype(np.int32)
            surface_moments(states, index[: 20_000 + side])
    assert 1 <= found[kernel.__name__] <= 3


def test_voxels_outside_the_grid_are_refused():
    for outside in ([-1, 0, 0], [0, 0, 5]):
        with pytest.raises(InputError, match=r"inside the grid of \(5, 5, 5\)"):
            surface_moments(np.zeros((5, 5, 5), np.uint8), np.asarray([[0, 0, 0], outside], np.int32))


def test_moments_in_tiles_are_those_of_the_whole_box_to_the_bit(monkeypatch):
    rng = np.random.default_rng(4)
    states = rng.choice(np.asarray([0, 1, 2], np.uint8), (150, 70, 40), p=[0.5, 0.4, 0.1])
    index = rng.permutation(np.argwhere(states == 2).astype(np.int32))[:9000]
    windows = []

    def window(low, high):
        windows.append(tuple(high - low))
        return states[tuple(map(slice, low, high))]

    # A window that reaches farther than the steps along the normal, and steps that reach farther than the window.
    for size, reach in ((7, 3), (3, 3)):
        windows.clear()
        monkeypatch.setattr(over_tiles, "TILE", 1 << 17)
        found = tiled_moments(window, states.shape, index, size=size, reach=reach)
        assert len(windows) > 4
        for one, other in zip(surface_moments(states, index, size=size, reach=reach), found, strict=True):
            np.testing.assert_array_equal(one, other)
