"""Planes fitted to segments by batched, robust least squares."""

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import numpy as np
import optimistix as optx
from jaxtyping import Bool, Float, Float32, Int32

from .._runtime.buckets import pad_rows, wide_bucket_size
from .._types import Array
from ..ops.eigen import symmetric_eigen


class Planes(eqx.Module):
    """Planes n . p = offset, padded to a capacity; rows beyond `num_found` are masked.

    Attributes:
        normal: float32 (k, 3) unit, toward free space.
        offset: float32 (k,) [unit of the points]: n . p of the points of the plane.
        centroid: float32 (k, 3): mean of the segment's points.
        rms: float32 (k,): root mean square distance of the points from the plane.
        num_voxels: int32 (k,): points in the segment.
        mask: bool (k,): rows that hold a plane.
        num_found: int32 scalar.
    """

    normal: Float32[Array, "k 3"]
    offset: Float32[Array, "k"]
    centroid: Float32[Array, "k 3"]
    rms: Float32[Array, "k"]
    num_voxels: Int32[Array, "k"]
    mask: Bool[Array, "k"]
    num_found: Int32[Array, ""]

    def trimmed(self) -> "Planes":
        """The found planes only, on the host."""
        k = int(self.num_found)
        rows = (
            np.asarray(a)[:k]
            for a in (self.normal, self.offset, self.centroid, self.rms, self.num_voxels, self.mask)
        )
        return Planes(*rows, num_found=np.asarray(k, np.int32))


def fit_planes(
    points: Float[np.ndarray, "n 3"],
    labels: Int32[np.ndarray, "n"],
    *,
    normals: Float[np.ndarray, "n 3"] | None = None,
    huber_scale: float | None = None,
    num_rounds: int = 4,
) -> Planes:
    """Fit a plane to the points of each label (section III), all segments at the same time.

    The start is the closed-form plane of each segment. Then `num_rounds` rounds of Huber weights, each
    minimised by optimistix' Levenberg-Marquardt over the plane's three parameters, vmapped over the segments.
    A segment's weighted residuals enter as a square root of their 4x4 moment matrix: four residuals whose sum
    of squares is exactly that of all points, however many these are.

    Args:
        points: Coordinates, any unit.
        labels: Segment of each point, 0 to k - 1; other points have -1.
        normals: Directions that tell which side is free; without them normals point away from the origin.
        huber_scale: Distance beyond which a point pulls linearly, not quadratically [unit of the points];
            None for plain least squares.
        num_rounds: Rounds of reweighting.

    Returns:
        `Planes` with a capacity of the next bucket, row i for label i.
    """
    num = int(labels.max(initial=-1)) + 1
    # There are few capacities and lengths, so that maps share compiled fits.
    capacity, length = wide_bucket_size(num, 256), wide_bucket_size(len(points), 32_768)
    # Moments are taken about the middle: in float32 those of points far from the origin lose the plane.
    middle = points.mean(axis=0, dtype=np.float64) if len(points) else np.zeros(3)
    local = pad_rows((points - middle).astype(np.float32), length)
    label = pad_rows(np.where(labels >= 0, labels, capacity).astype(np.int32), length, fill=capacity)
    # Without normals a plane faces away from the origin, as its points do, so the middle is added back for this
    # alone.
    toward = (
        local + middle.astype(np.float32) if normals is None else pad_rows(normals.astype(np.float32), length)
    )
    scale = np.float32(np.inf if huber_scale is None else huber_scale)
    normal, offset, centroid, rms, count = _fit(
        local, label, toward, scale, capacity=capacity, num_rounds=1 if huber_scale is None else num_rounds
    )
    # The offset goes back to the frame of the points in float64: a long middle times a unit normal would round.
    shift = np.asarray(normal, np.float64) @ middle
    return Planes(
        normal=np.asarray(normal),
        offset=(np.asarray(offset) + shift).astype(np.float32),
        centroid=(np.asarray(centroid) + middle).astype(np.float32),
        rms=np.asarray(rms),
        num_voxels=np.asarray(count),
        mask=np.arange(capacity) < num,
        num_found=np.asarray(num, np.int32),
    )


@partial(jax.jit, static_argnames=("capacity", "num_rounds"))
def _fit(points, label, toward, scale, *, capacity: int, num_rounds: int):
    """Closed-form start, reweighted LM, plane parameters relative to the origin of `points`."""

    def total(values: Array) -> Array:
        # A segment beyond the capacity takes the padding and what has no label, and is cut off.
        return jax.ops.segment_sum(values, label, num_segments=capacity + 1)[:capacity]

    count = total(jnp.ones(points.shape[0], jnp.float32))
    centroid = total(points) / jnp.maximum(count, 1.0)[:, None]
    # The padding has a label beyond all planes; it reads the last one instead, and what comes of it is cut off
    # by `total`.
    row = jnp.minimum(label, capacity - 1)
    local = points - centroid[row]
    weight = jnp.ones(points.shape[0], jnp.float32)
    normal = symmetric_eigen(_covariance(local, weight, total, count))[1][:, 0]
    facing = jnp.sum(total(toward) * normal, axis=1, dtype=jnp.float32)
    normal = jnp.where((facing < 0.0)[:, None], -normal, normal)
    depth = jnp.zeros(capacity, jnp.float32)

    def reweighted(plane: tuple[Array, Array], _: None) -> tuple[tuple[Array, Array], None]:
        normal, depth = plane
        distance = jnp.abs(jnp.sum(local * normal[row], axis=1, dtype=jnp.float32) - depth[row])
        # Huber's weight is 1 within the scale, and beyond it so much less that a point pulls linearly.
        weight = jnp.minimum(1.0, scale / jnp.maximum(distance, 1e-12))
        mass = total(weight)
        mean = total(weight[:, None] * local) / jnp.maximum(mass, 1e-12)[:, None]
        covariance = _covariance(local - mean[row], weight, total, mass)
        return jax.vmap(_minimise)(normal, depth, covariance, mean), None

    (normal, depth), _ = jax.lax.scan(reweighted, (normal, depth), None, length=num_rounds)
    distance = jnp.sum(local * normal[row], axis=1, dtype=jnp.float32) - depth[row]
    rms = jnp.sqrt(total(distance * distance) / jnp.maximum(count, 1.0))
    offset = jnp.sum(centroid * normal, axis=1, dtype=jnp.float32) + depth
    return normal, offset, centroid, rms, count.astype(jnp.int32)


def _covariance(local: Array, weight: Array, total, mass: Array) -> Array:
    """Weighted covariance of each segment, (k, 3, 3)."""
    pairs = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    products = jnp.stack([weight * local[:, i] * local[:, j] for i, j in pairs], axis=1)
    m = total(products) / jnp.maximum(mass, 1e-12)[:, None]
    rows = ((0, 3, 4), (3, 1, 5), (4, 5, 2))
    return jnp.stack([jnp.stack([m[:, k] for k in row], axis=-1) for row in rows], axis=-2)


def _minimise(normal: Array, depth: Array, covariance: Array, mean: Array) -> tuple[Array, Array]:
    """Least-squares plane of one segment from its weighted moments; falls back to the start if LM gives up."""
    values, vectors = symmetric_eigen(covariance)
    # In units of the segment's own width, so that tolerances mean the same for all segments.
    width = jnp.sqrt(jnp.maximum(values[2], 1e-12))
    # Rounding may leave the least eigenvalue of a flat segment below 0. The rows R have R^T R for the
    # covariance, so that the squares of R n add up to the variance along n.
    root = jnp.sqrt(jnp.maximum(values, 0.0))[:, None] / width * vectors
    # Any two directions across the normal serve; the axis least along it keeps the cross product away from zero.
    axis = jnp.argmin(jnp.abs(normal))
    u = jnp.cross(normal, jax.nn.one_hot(axis, 3, dtype=normal.dtype))
    u = u / jnp.linalg.norm(u)
    v = jnp.cross(normal, u)

    # Two tilts and a shift are all that a plane has: no constraint on the length of the normal is left to the
    # solver.
    def plane(parameters: Array) -> tuple[Array, Array]:
        n = normal + parameters[0] * u + parameters[1] * v
        return n / jnp.linalg.norm(n), parameters[2] * width

    def residual(parameters: Array, _: None) -> Array:
        n, d = plane(parameters)
        return jnp.concatenate([root @ n, ((jnp.sum(mean * n) - d) / width)[None]])

    # Four residuals and three unknowns are small enough for QR, which keeps digits that normal equations would
    # square away.
    solver = optx.LevenbergMarquardt(rtol=1e-5, atol=1e-6, linear_solver=lx.QR())
    start = jnp.stack([jnp.zeros_like(depth), jnp.zeros_like(depth), depth / width])
    solution = optx.least_squares(residual, solver, start, max_steps=32, throw=False)
    n, d = plane(solution.value)
    is_finite = jnp.all(jnp.isfinite(solution.value))
    return jnp.where(is_finite, n, normal), jnp.where(is_finite, d, depth)
