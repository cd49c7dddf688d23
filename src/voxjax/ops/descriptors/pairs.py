"""What the points of a tile see in the points near it: moments, histograms of angles, weighted sums of histograms.

Kernels on batches of items (`descriptor_tiles`): `own` has 16 points an item and `others` 128, both by columns. All is
elementwise work on (items, 128, 16) pairs, which compilers turn into vector loops. Places without a point hold
`FAR`. Split where fusing would cost: XLA for CPUs computes a fused producer again for each of the 33 bins.
"""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float32, UInt8, UInt32

from ..._types import Array

FAR = 1e9
"""Coordinate of places without a point; its square is a float32 still."""
MOST_BINS = 255
"""Bins a histogram may have; one byte is left for none."""


def _offsets(own: Array, others: Array) -> tuple[list[Array], Array]:
    """Offset from each own point to each other, by column, and its square: (items, others, own)."""
    steps = [others[k, :, :, None] - own[k, :, None, :] for k in range(3)]
    return steps, steps[0] * steps[0] + steps[1] * steps[1] + steps[2] * steps[2]


@jax.jit
def is_within(
    own: Float32[Array, "c i 16"], others: Float32[Array, "c i 128"], square: Float32[Array, ""]
) -> Float32[Array, "i 128 16"]:
    """1 where two points are at most so far apart, else 0.

    Args:
        own: Rows x, y, z, whatever follows.
        others: Rows x, y, z of the other points, whatever follows.
        square: Square of the largest distance.
    """
    return (_offsets(own, others)[1] <= square).astype(jnp.float32)


@jax.jit
def monomials(own: Float32[Array, "c i 16"], others: Float32[Array, "c i 128"]) -> Float32[Array, "i 128 10"]:
    """1, x, y, z, xx, yy, zz, xy, xz, yz of the others, relative to the first own point; 0 for those FAR away."""
    # All items of a tile count from the same point, so that their sums add up; and from one nearby, for products of
    # small offsets keep the digits that float32 loses of squared coordinates.
    x, y, z = (others[k] - own[k, :, :1] for k in range(3))
    is_point = others[0] < 0.5 * FAR
    x, y, z = (jnp.where(is_point, c, 0.0) for c in (x, y, z))
    one = is_point.astype(jnp.float32)
    return jnp.stack([one, x, y, z, x * x, y * y, z * z, x * y, x * z, y * z], axis=2)


@jax.jit
def closeness(
    own: Float32[Array, "c i 16"],
    others: Float32[Array, "c i 128"],
    square: Float32[Array, ""],
    spacing: Float32[Array, ""],
) -> Float32[Array, "i 128 16"]:
    """Weights of neighbours: the spacing over the distance, at most 2; 0 beyond the radius and for equal points."""
    length = _offsets(own, others)[1]
    is_neighbor = (length <= square) & (length > 0.0)
    # Squares are compared: this bound is that of half the spacing, where weights stop growing.
    least = jnp.maximum(length, 0.25 * spacing * spacing)
    return jnp.where(is_neighbor, spacing * jax.lax.rsqrt(least), 0.0)


@partial(jax.jit, static_argnames=("num_bins",))
def pair_bins(
    own: Float32[Array, "6 i 16"],
    others: Float32[Array, "6 i 128"],
    square: Float32[Array, ""],
    *,
    num_bins: int,
) -> UInt32[Array, "i 128 16"]:
    """Bins of the three angles of each pair, in the three low bytes; 255 for points too far apart or in one place.

    With d the offset, n and m the normals: v = d x n, so that v.m = d.(n x m) and (n x v).m = d.m - (n.d)(n.m), both
    over |v| = sqrt(d.d - (n.d)^2): no vector but the cross product of the normals is ever formed.

    Args:
        own: Rows x, y, z and those of the normal n.
        others: Places of the other points and their normal m, as columns.
        square: Square of the radius.
        num_bins: Bins of each histogram.
    """
    # Three bytes of 255, which is the number of no bin.
    none = 0xFFFFFF
    (x, y, z), length = _offsets(own, others)
    is_neighbor = (length <= square) & (length > 0.0)
    nx, ny, nz = (own[k, :, None, :] for k in range(3, 6))
    mx, my, mz = (others[k, :, :, None] for k in range(3, 6))
    # These are n.d, d.m, n.m and d.(n x m) of the docstring.
    ahead, back, along = x * nx + y * ny + z * nz, x * mx + y * my + z * mz, nx * mx + ny * my + nz * mz
    volume = x * (ny * mz - nz * my) + y * (nz * mx - nx * mz) + z * (nx * my - ny * mx)
    safe = jnp.maximum(length, 1e-12)
    # Where d is along n within the rounding of float32, v has no direction, and its angles are taken for flat.
    across = jax.lax.rsqrt(jnp.maximum(safe - ahead * ahead, 1e-6 * safe))
    # Where d is almost along n, the root of the difference has few digits, and the quotient by it may leave [-1, 1]: it
    # is clipped. The one by |d| leaves it by rounding alone, which the slack of the bins takes up.
    word = (
        _share_bin(jnp.clip(volume * across, -1.0, 1.0), num_bins, byte=0)
        | _share_bin(ahead * jax.lax.rsqrt(safe), num_bins, byte=1)
        | _turn_bin((back - ahead * along) * across, along, num_bins) << 16
    )
    return jnp.where(is_neighbor, word, none).astype(jnp.uint32)


def _share_bin(cosine: Array, num_bins: int, *, byte: int) -> Array:
    """Bin of a number in [-1, 1], in one byte of a word: the integer part, read from the bits of a float32.

    Above a power of two beyond the number of bins the bits of a float32 are those of the integer part and then those of
    the fraction. Converting to integers takes several times as long, as it must hold for all numbers.
    """
    # How much narrower half a histogram is [bin]: more than the rounding of a cosine, so that none is beyond the last.
    slack = 2.0**-14
    size = num_bins.bit_length()
    share = cosine * (0.5 * num_bins - slack) + (0.5 * num_bins + 2.0**size)
    shift = 23 - size - 8 * byte
    bits = jax.lax.bitcast_convert_type(share, jnp.int32)
    return (bits >> shift if shift >= 0 else bits << -shift) & ((1 << size) - 1 << 8 * byte)


def _turn_bin(sine: Array, cosine: Array, num_bins: int) -> Array:
    """Bin of the angle of (cosine, sine), by the borders it lies beyond: arctan2 is a scalar call on a CPU.

    The cosine over the sum of both magnitudes falls as the angle grows from 0 to pi. The angle of (0, 0) is 0.
    """
    # Borders between 0 and pi alone; the sign of the sine mirrors them. The sum of magnitudes scales the cosine without
    # the root that a length would take.
    half = num_bins // 2
    borders = np.pi * (2 * np.arange(1, half + 1) - num_bins % 2) / num_bins
    # With an even number of bins the last border is pi itself, beyond which no angle lies.
    borders = borders[borders < np.pi - 1e-9]
    size = jnp.abs(cosine) + jnp.abs(sine)
    beyond = jnp.zeros_like(sine, jnp.int32)
    for c, s in zip(np.cos(borders), np.sin(borders), strict=True):
        beyond += (cosine < float(c / (abs(c) + s)) * size).astype(jnp.int32)
    return jnp.where(sine < 0.0, (num_bins - 1) // 2 - beyond, half + beyond)


def bytes_of(word: UInt32[Array, "i 128 16"]) -> UInt8[Array, "i 128 64"]:
    """The bytes of each word side by side, the lowest first; without a copy where the words are on the host."""
    if isinstance(word, np.ndarray):
        return word.astype("<u4", copy=False).view(np.uint8)
    return jax.lax.bitcast_convert_type(word, jnp.uint8).reshape(*word.shape[:2], -1)


@partial(jax.jit, static_argnames=("num_bins",))
def count_bins(bins: UInt8[Array, "i 128 k"], *, num_bins: int) -> UInt8[Array, "i b k"]:
    """How often each bin comes up among the others in each place, at most 128 times.

    A sum of terms, which compilers turn into a loop over bytes; of a reduction they make one over scalars.
    """
    which = jnp.arange(num_bins, dtype=jnp.uint8)[None, :, None]
    total = jnp.zeros((bins.shape[0], num_bins, bins.shape[2]), jnp.uint8)
    for other in range(bins.shape[1]):
        total += (bins[:, other, None] == which).astype(jnp.uint8)
    return total
