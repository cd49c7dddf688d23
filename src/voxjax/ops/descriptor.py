"""Local descriptors of surface points: normals and fast point feature histograms (FPFH), in batches.

Neighbours come as padded lists: `neighbors` holds row numbers and `distances` metres, infinite where a list has
no further neighbour. The kernels run in chunks of rows, so that memory stays bounded.
"""

from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Float, Int

from .._types import Array

NUM_BINS = 11
"""Bins of each of the three histograms, as in the publication of FPFH."""
_CHUNK = 512


@partial(jax.jit, static_argnames=("chunk",))
def surface_normals(
    points: Float[Array, "n 3"],
    neighbors: Int[Array, "n k"],
    distances: Float[Array, "n k"],
    *,
    radius: float | Float[Array, ""],
    chunk: int = _CHUNK,
) -> tuple[Float[Array, "n 3"], Float[Array, "n"]]:
    """Fit a plane to the neighbours within `radius` of each point.

    Args:
        points: Float (n, 3) [m], centred well enough for float32.
        neighbors: Rows of the neighbours; the point itself may be among them.
        distances: Distance to each neighbour [m], infinite where there is none.
        radius: Neighbours farther than this [m] are left out.
        chunk: Rows handled at once.

    Returns:
        Unit normals (n, 3) of arbitrary sign, and the surface variation (n,) in [0, 1/3]: the share of the
        variance that is along the normal, 0 on a plane; 1/3 for points with fewer than three neighbours.
    """

    def fit(row: tuple[Array, Array, Array]) -> tuple[Array, Array]:
        point, ids, distance = row
        weight = (distance <= radius).astype(points.dtype)[:, None]
        count = jnp.sum(weight, dtype=points.dtype)
        offset = points[ids] - point[None]
        mean = jnp.sum(offset * weight, axis=0, dtype=points.dtype) / jnp.maximum(count, 1.0)
        offset = (offset - mean[None]) * weight
        eigenvalues, eigenvectors = jnp.linalg.eigh(offset.T @ offset)
        total = jnp.sum(eigenvalues, dtype=points.dtype)
        is_defined = (count >= 3.0) & (total > 0.0)
        variation = jnp.maximum(eigenvalues[0], 0.0) / jnp.where(is_defined, total, 1.0)
        return eigenvectors[:, 0], jnp.where(is_defined, variation, 1.0 / 3.0)

    return jax.lax.map(fit, (points, neighbors, distances), batch_size=min(chunk, max(points.shape[0], 1)))


@partial(jax.jit, static_argnames=("num_bins", "chunk"))
def point_feature_histograms(
    points: Float[Array, "n 3"],
    normals: Float[Array, "n 3"],
    neighbors: Int[Array, "n k"],
    distances: Float[Array, "n k"],
    *,
    radius: float | Float[Array, ""],
    spacing: float | Float[Array, ""],
    num_bins: int = NUM_BINS,
    chunk: int = _CHUNK,
) -> Float[Array, "n d"]:
    """Describe each point by how the normals around it lie.

    Every pair (point p with normal n, neighbour q with normal m) gives three angles in the frame u = n,
    v = (q - p)/|q - p| x u, w = u x v: v.m, u.(q - p)/|q - p| and atan2(w.m, u.m). Their histograms over the
    neighbours are the simple descriptor (SPFH); the descriptor of a point is the mean of the simple descriptors
    of its neighbours with weights 1 / distance. The frame always stands on p: the original's choice of the end
    with the smaller angle is decided by rounding wherever two normals are parallel, and walls are flat.

    Args:
        points: Float (n, 3) [m].
        normals: Unit normals (n, 3), with one meaning of the sign over the whole map.
        neighbors: Rows of the neighbours; a point's own row, at distance 0, does not count.
        distances: Distance to each neighbour [m], infinite where there is none.
        radius: Neighbours farther than this [m] are left out.
        spacing: Distance between neighbouring points [m]; weights stop growing below half of it.
        num_bins: Bins of each of the three histograms.
        chunk: Rows handled at once.

    Returns:
        (n, 3 num_bins): the square roots of the three histograms, each histogram summing to 1 (to 0 for
        points without neighbours), so that a Euclidean distance is the Hellinger distance of the histograms.

    References:
        Rusu, Blodow, Beetz: Fast Point Feature Histograms (FPFH) for 3D Registration, ICRA 2009, Sec. III.
    """
    batch = min(chunk, max(points.shape[0], 1))
    dtype = points.dtype

    def simple(row: tuple[Array, Array, Array, Array]) -> Array:
        point, normal, ids, distance = row
        is_neighbor = (distance <= radius) & (distance > 0.0)
        scale = jnp.where(is_neighbor, distance, 1.0)
        direction = (points[ids] - point[None]) / scale[:, None]
        shares = _pair_shares(normal, normals[ids], direction)
        bins = jnp.clip((shares * num_bins).astype(jnp.int32), 0, num_bins - 1)
        hits = (bins[:, :, None] == jnp.arange(num_bins, dtype=jnp.int32)[None, None]) & is_neighbor[
            :, None, None
        ]
        count = jnp.sum(is_neighbor, dtype=dtype)
        return (jnp.sum(hits, axis=0, dtype=dtype) / jnp.maximum(count, 1.0)).reshape(-1)

    histograms = jax.lax.map(simple, (points, normals, neighbors, distances), batch_size=batch)

    def smooth(row: tuple[Array, Array]) -> Array:
        ids, distance = row
        is_neighbor = (distance <= radius) & (distance > 0.0)
        weight = jnp.where(is_neighbor, spacing / jnp.maximum(distance, 0.5 * spacing), 0.0)
        return weight.astype(dtype) @ histograms[ids]

    total = jax.lax.map(smooth, (neighbors, distances), batch_size=batch).reshape(-1, 3, num_bins)
    mass = jnp.sum(total, axis=2, keepdims=True, dtype=dtype)
    return jnp.sqrt(total / jnp.where(mass > 0.0, mass, 1.0)).reshape(-1, 3 * num_bins)


def _pair_shares(normal: Array, neighbor_normals: Array, direction: Array) -> Array:
    """The three angles of a point with its neighbours, each scaled to [0, 1]: (k, 3)."""
    slope = direction @ normal
    v = jnp.cross(direction, normal[None])
    length = jnp.sqrt(jnp.sum(v * v, axis=1, keepdims=True, dtype=v.dtype))
    v = v / jnp.maximum(length, 1e-6)
    w = jnp.cross(normal[None], v)
    along_v = jnp.sum(v * neighbor_normals, axis=1, dtype=v.dtype)
    along_w = jnp.sum(w * neighbor_normals, axis=1, dtype=v.dtype)
    turn = jnp.arctan2(along_w, neighbor_normals @ normal)
    return jnp.stack([0.5 * (along_v + 1.0), 0.5 * (slope + 1.0), turn / (2.0 * jnp.pi) + 0.5], axis=1)
