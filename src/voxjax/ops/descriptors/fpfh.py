"""Local descriptors of points: normals and fast point feature histograms (FPFH), from all neighbours within a radius.

Neighbours come as tiles that are near each other (`near_tiles`), so that no list of them is ever made. On a CPU the
items of work go in pieces of one size, side by side: memory is bounded, and another number of points compiles nothing.
"""

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float32

from ..._checks import InputError
from ..._runtime.buckets import bucket_size, pad_rows
from ..._runtime.forks import refused_after_fork
from ..._runtime.pieces import over_pieces
from ..._runtime.placement import are_numpy, on_host
from ..._types import Array
from ..eigen import eigen_by_columns
from .items import ItemWork
from .pairs import MOST_BINS, bytes_of, closeness, count_bins, is_within, monomials, pair_bins
from .tiles import LEAF, TILE, NearTiles, padded_tiles


@refused_after_fork
def surface_normals(
    points: Float32[Array, "n 3"], near: NearTiles, *, radius: float | Float32[Array, ""]
) -> tuple[Float32[Array, "n 3"], Float32[Array, "n"]]:
    """Fit a plane to the points within a radius of each point, itself included.

    Args:
        points: Float32 (n, 3) [m], centred well enough for float32.
        near: Tiles of these points near each other, of this radius or a larger one.
        radius: Neighbours farther than this [m] are left out.

    Returns:
        Unit normals (n, 3) of arbitrary sign, and the surface variation (n,) in [0, 1/3]: the share of the variance
        that is along the normal, 0 on a plane; 1/3 for points with fewer than three neighbours. They are NumPy
        arrays where NumPy arrays were given.
    """
    if not are_numpy(points, near):
        return _normals_kernel(points, near, jnp.float32(radius))
    if on_host():
        return _normals(points, near, np.float32(radius), from_host=True)
    normals, variation = _normals_kernel(*_on_ladder(near, points), jnp.float32(radius))
    return np.asarray(normals)[: len(points)], np.asarray(variation)[: len(points)]


def _normals(points: Any, near: NearTiles, radius: Any, *, from_host: bool) -> tuple[Any, Any]:
    """`surface_normals`, piece by piece or in one kernel."""
    work = ItemWork(near, from_host)
    tables, square = work.tables(points.T), radius * radius

    def moments(tiles: Any, halves: Any) -> Any:
        own, others = work.take(tables, tiles, halves)
        terms = work.xp.asarray(monomials(own, others))
        return work.mix(is_within(own, others, square), lambda part: terms[part])

    sums = work.by_point(work.add_up(moments, (TILE, 10)).reshape(-1, 10), points.shape[0]).T
    normals, variation = _fit_pieces(sums) if from_host else _fit(sums)
    return normals.T, variation


_normals_kernel = jax.jit(partial(_normals, from_host=False))


@refused_after_fork
def point_feature_histograms(
    points: Float32[Array, "n 3"],
    normals: Float32[Array, "n 3"],
    near: NearTiles,
    *,
    radius: float | Float32[Array, ""],
    spacing: float | Float32[Array, ""],
    num_bins: int = 11,
) -> Float32[Array, "n d"]:
    """Describe each point by how the normals around it lie.

    Every pair (point p with normal n, neighbour q with normal m) gives three angles in the frame u = n,
    v = (q - p)/|q - p| x u, w = u x v: v.m, u.(q - p)/|q - p| and atan2(w.m, u.m). Their histograms over the
    neighbours are the simple descriptor (SPFH); the descriptor of a point is the mean of the simple descriptors
    of its neighbours with weights 1 / distance. The frame always stands on p: the original's choice of the end
    with the smaller angle is decided by rounding wherever two normals are parallel, and walls are flat.

    Args:
        points: Float32 (n, 3) [m].
        normals: Unit normals (n, 3), with one meaning of the sign over the whole map.
        near: Tiles of these points near each other, of this radius or a larger one.
        radius: Neighbours farther than this [m] are left out; so are points at the same place.
        spacing: Distance between neighbouring points [m]; weights stop growing below half of it.
        num_bins: Bins of each of the three histograms, 2 to 255; the publication has 11.

    Returns:
        (n, 3 num_bins): the square roots of the three histograms, each histogram summing to 1 (to 0 for
        points without neighbours), so that a Euclidean distance is the Hellinger distance of the histograms. It is a
        NumPy array where NumPy arrays were given.

    Raises:
        InputError: If the number of bins is out of range.

    References:
        Rusu, Blodow, Beetz: Fast Point Feature Histograms (FPFH) for 3D Registration, ICRA 2009, Sec. III.
    """
    if not 2 <= num_bins <= MOST_BINS:
        raise InputError(f"num_bins must be from 2 to {MOST_BINS}, got {num_bins!r}.")
    # Both forms of the kernels compare float32 with float32, whatever type a caller's numbers have.
    scales = jnp.float32(radius), jnp.float32(spacing)
    if not are_numpy(points, normals, near):
        return _histograms_kernel(points, normals, near, *scales, num_bins=num_bins)
    if on_host():
        scales = np.float32(radius), np.float32(spacing)
        return _histograms(points, normals, near, *scales, num_bins=num_bins, from_host=True)
    found = _histograms_kernel(*_on_ladder(near, points, normals), *scales, num_bins=num_bins)
    return np.asarray(found)[: len(points)]


def _histograms(
    points: Any, normals: Any, near: NearTiles, radius: Any, spacing: Any, *, num_bins: int, from_host: bool
) -> Any:
    """`point_feature_histograms`, piece by piece or in one kernel."""
    work = ItemWork(near, from_host)
    xp, width, square = work.xp, 3 * num_bins, radius * radius
    # Places and normals lie in one table, so that one lookup brings both.
    tables = work.tables(xp.concatenate([points, normals], axis=1).T)

    # First pass: the simple descriptor of each point, as counts of bytes.
    def simple(tiles: Any, halves: Any) -> Any:
        word = pair_bins(*work.take(tables, tiles, halves), square, num_bins=num_bins)
        bins = bytes_of(np.asarray(word) if from_host else word)
        return count_bins(bins, num_bins=num_bins)

    def shares(counts: Any) -> Any:
        # A word of bins has four bytes, and there are three angles: the last byte is left out.
        by_point = counts.reshape(-1, num_bins, TILE, 4).transpose(0, 2, 3, 1)[:, :, :3]
        # Half tiles are what neighbours are listed by, so the second pass finds the histograms of one in one place.
        by_point = by_point.reshape(-1, LEAF, width)
        # Each neighbour counts once in all three histograms, so the first one has the number for all. A point without
        # neighbours keeps zeros.
        return by_point / xp.maximum(by_point[..., :num_bins].sum(axis=2, keepdims=True), xp.float32(1))

    histograms = work.by_parts(shares, work.add_up(simple, (num_bins, 4 * TILE)))
    histograms = histograms.reshape(-1, LEAF, width)
    # The weights depend on distances alone: normals are not looked up again.
    places = tables[0][:3], tables[1][:3]

    # Second pass: each point takes the mean of its neighbours' simple descriptors, the near ones weighing more.
    def smooth(tiles: Any, halves: Any) -> Any:
        weights = closeness(*work.take(places, tiles, halves), square, spacing)
        return work.mix(weights, lambda part: xp.take(histograms, halves[part], axis=0))

    # The weights need no sum of their own: each histogram is brought to the sum 1 before the roots.
    def roots(total: Any) -> Any:
        total = total.reshape(-1, 3, num_bins)
        mass = total.sum(axis=2, keepdims=True)
        return xp.sqrt(total / xp.where(mass > 0, mass, xp.float32(1))).reshape(-1, width)

    smoothed = work.by_parts(roots, work.add_up(smooth, (TILE, width)))
    return work.by_point(smoothed.reshape(-1, width), points.shape[0])


_histograms_kernel = jax.jit(partial(_histograms, from_host=False), static_argnames="num_bins")


def _on_ladder(near: NearTiles, *lists: Array) -> tuple[Any, ...]:
    """Lists of points padded to a rung of `bucket_size`, and their tiles with them: a kernel belongs to its shapes."""
    size = bucket_size(len(lists[0]), 512)
    return *(pad_rows(np.asarray(rows), size) for rows in lists), padded_tiles(near, len(lists[0]), size)


@jax.jit
def _fit(sums: Float32[Array, "10 n"]) -> tuple[Float32[Array, "3 n"], Float32[Array, "n"]]:
    """Normal and surface variation from the number of points, their sums and sums of products."""
    count = sums[0]
    x, y, z, xx, yy, zz, xy, xz, yz = (row / jnp.maximum(count, 1.0) for row in sums[1:])
    # Offsets count from a point of the same tile: mean squares and squared means are small, and their
    # difference keeps its digits.
    covariance = jnp.stack([xx - x * x, yy - y * y, zz - z * z, xy - x * y, xz - x * z, yz - y * z])
    values, vectors, _ = eigen_by_columns(covariance)
    total = values[0] + values[1] + values[2]
    # Fewer than three points fit no plane: they count as what scatters alike in all directions.
    is_defined = (count >= 3.0) & (total > 0.0)
    # Rounding may leave the least value of flat surroundings a little below 0.
    variation = jnp.maximum(values[0], 0.0) / jnp.where(is_defined, total, 1.0)
    return vectors[0], jnp.where(is_defined, variation, 1.0 / 3.0)


def _fit_pieces(sums: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """`_fit`, always for as many points at once."""
    # Points whose planes are fitted at once on a CPU: one size, so that another number of points compiles nothing.
    fits = 4096

    def fit(rows: np.ndarray, _: np.int32) -> tuple[np.ndarray, Array]:
        normals, variation = _fit(rows.T)
        return np.asarray(normals).T, variation

    normals, variation = over_pieces(fit, [sums.T], size=fits)
    return normals.T, variation
