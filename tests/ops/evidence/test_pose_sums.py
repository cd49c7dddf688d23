"""Sums under many poses, on a field whose sums are known."""

import contextlib
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Float32

from device_path import device_path
from voxjax._types import Array
from voxjax.ops.evidence.pose_sums import PoseField, pose_sums, sums_of, sums_of_piece


class Near(NamedTuple):
    """Weights of the points that a pose puts within a distance of the origin, and their heights."""

    reach: Float32[Array, ""]

    def sums(self, T: Array, points: Array, weights: Array) -> Float32[Array, "2"]:
        """Sums under one pose; columns in."""
        x, y, z = (points[i] + T[i, 3] for i in range(3))
        inside = jnp.where(x**2 + y**2 + z**2 <= self.reach**2, weights, 0.0)
        return sums_of([inside, inside * z])


@jax.jit
def _near_piece(field: Near, *piece: Array) -> Float32[Array, "p 2"]:
    return sums_of_piece(field, *piece)


@pytest.mark.parametrize("form", [contextlib.nullcontext, device_path])
@pytest.mark.parametrize(("num_points", "num_poses"), [(1, 1), (130, 3), (3000, 700), (0, 2), (5, 0)])
def test_sums_are_those_of_all_points_however_they_are_cut(form, num_points, num_poses):
    rng = np.random.default_rng(0)
    points = rng.uniform(-1, 1, (num_points, 3)).astype(np.float32)
    weights = rng.random(num_points).astype(np.float32)
    poses = np.tile(np.eye(4, dtype=np.float32), (num_poses, 1, 1))
    poses[:, :3, 3] = rng.uniform(-0.5, 0.5, (num_poses, 3))
    field = Near(np.asarray(0.8, np.float32))
    assert isinstance(field, PoseField)
    with form():
        found = pose_sums(_near_piece, field, (points, weights), poses, most=1024, batch_size=8)
    moved = points[None] + poses[:, None, :3, 3]
    inside = weights * ((moved**2).sum(axis=2) <= np.float32(0.8) ** 2)
    expected = np.stack([inside.sum(axis=1), (inside * moved[..., 2]).sum(axis=1)], axis=1)
    np.testing.assert_allclose(np.asarray(found).reshape(-1, 2), expected, rtol=1e-3, atol=0.02)
