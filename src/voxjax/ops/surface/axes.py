"""What the sums over windows say of the surface there: its normal, its curvature, where it is free.

Columns in and columns out, a list of voxels in each; every step is short enough for the compiler to fuse.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float32, Int, Int32, UInt8

from ..._types import Array
from ..eigen import eigen_by_columns
from .packed_states import PackedStates

TIED = 1e-3
"""Eigenvalues that differ by less than this share of the largest count as equal: rounding decides no normal."""


class WindowSums(NamedTuple):
    """The sums over the occupied voxels of a window, and where its free voxels lie.

    Attributes:
        count: Number of occupied voxels.
        mean: (3, n): their mean offset from the voxel in the middle [voxel].
        covariance: (6, n): xx, yy, zz, xy, xz, yz [voxel^2].
        lean: (3, n): sum over the free voxels of their offset from the mean [voxel].
    """

    count: Int32[Array, "n"]
    mean: Float32[Array, "3 n"]
    covariance: Float32[Array, "6 n"]
    lean: Float32[Array, "3 n"]


def central_sums(sums: Int[Array, "14 n"]) -> WindowSums:
    """Moments about the mean, from what `window_sums` gives.

    Differences are taken of whole numbers, of which none is above 2^31 in a ball of diameter 25: nothing cancels.
    """
    count, *rest = (sums[k].astype(jnp.int32) for k in range(14))
    first, second, free_count, free = rest[:3], rest[3:9], rest[9], rest[10:]
    share = 1 / jnp.maximum(count, 1).astype(jnp.float32)
    pairs = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    scatter = [count * second[k] - first[i] * first[j] for k, (i, j) in enumerate(pairs)]
    # Each free voxel's offset is from the mean, so the mean comes off as often as there are free voxels.
    lean = [count * f - free_count * s for f, s in zip(free, first, strict=True)]
    return WindowSums(
        count,
        jnp.stack([s.astype(jnp.float32) * share for s in first]),
        jnp.stack([s.astype(jnp.float32) * (share * share) for s in scatter]),
        jnp.stack([a.astype(jnp.float32) * share for a in lean]),
    )


class Axes(NamedTuple):
    """The decomposition of a covariance, as far as the surface needs it.

    Attributes:
        curvature: Smallest eigenvalue over the sum of all; 0 where all vanish.
        low, high: (3, n): unit vectors of the smallest and of the largest eigenvalue.
        is_low, is_high: Whether they stand apart from the others, so that the vector is defined up to the sign.
    """

    curvature: Float32[Array, "n"]
    low: Float32[Array, "3 n"]
    high: Float32[Array, "3 n"]
    is_low: Bool[Array, "n"]
    is_high: Bool[Array, "n"]


def principal_axes(covariance: Float32[Array, "6 n"]) -> Axes:
    """Curvature and axes of the occupied voxels."""
    eigen = eigen_by_columns(covariance, tolerance=TIED)
    # Rounding may leave the least value of a flat window a little below 0.
    low, middle, high = (jnp.maximum(eigen.values[k], 0) for k in range(3))
    total = low + middle + high
    curvature = low / jnp.where(total > 0, total, 1)
    return Axes(curvature, eigen.vectors[0], eigen.vectors[2], eigen.is_defined[0], eigen.is_defined[2])


def surface_normal(sums: WindowSums, axes: Axes) -> tuple[Array, Array, Array]:
    """Normal (3, n), whether one side is free, and the offset of the plane along the normal.

    Where the smallest eigenvalues tie (posts, lines, lone voxels), all normals across the line fit equally well; the
    one nearest to the mean of the free voxels is taken, and where that is none either, one nearest to an axis.
    """
    # A direction along no plane that small whole numbers describe: gives normals a sign where nothing else does.
    askew = np.asarray([0.547, 0.683, 0.484], np.float32)
    # Lines closer to x than this cosine get a normal toward y, other lines one toward x.
    along_x = 0.75
    # Sum of the free voxels' offsets [voxel] from which on a side is free.
    min_lean = 0.5
    lean, low, high = tuple(sums.lean), tuple(axes.low), tuple(axes.high)

    def across(direction: tuple) -> tuple:
        # A direction keeps what is across the line; where there is no line, it stays whole.
        along = jnp.where(axes.is_high, _dot(direction, high), 0)
        return tuple(d - along * h for d, h in zip(direction, high, strict=True))

    is_along_x = axes.is_high & (jnp.abs(high[0]) > along_x)
    x, y = ((~is_along_x).astype(jnp.float32), is_along_x.astype(jnp.float32))
    toward_axis = across((x, y, jnp.zeros_like(x)))
    toward_free = across(lean)
    is_free_told = _dot(toward_free, toward_free) > min_lean**2
    chosen = tuple(jnp.where(is_free_told, f, a) for f, a in zip(toward_free, toward_axis, strict=True))
    # Either choice has some length: that toward free voxels by its bound, the other because its axis is
    # not along the line.
    inverse = 1 / jnp.sqrt(_dot(chosen, chosen))
    axis = tuple(jnp.where(axes.is_low, a, inverse * c) for a, c in zip(low, chosen, strict=True))

    # Sign: toward the free side, else by a fixed direction, so that equal neighbourhoods have equal normals.
    toward = _dot(lean, axis)
    has_free = jnp.abs(toward) > min_lean
    is_turned = jnp.where(has_free, toward, _dot(tuple(askew), axis)) < 0
    normal = tuple(jnp.where(is_turned, -a, a) for a in axis)
    return jnp.stack(normal), has_free, _dot(tuple(sums.mean), normal)


def steps_along(
    packed: PackedStates, normal: Float32[Array, "3 n"], reach: int
) -> tuple[Int32[Array, "r n"], Int32[Array, "r n"]]:
    """Steps along the normal: words to go on, and voxels up."""
    # The largest component of a unit vector is never small, so that it can be divided by.
    largest = jnp.max(jnp.abs(normal), axis=0)
    words, up = [], []
    for step in range(1, reach + 1):
        # Scaled so that each step enters a new voxel along the direction's largest axis.
        x, y, z = (jnp.round(step * normal[k] / largest).astype(jnp.int32) for k in range(3))
        words.append(packed.steps(x, y))
        up.append(z)
    return jnp.stack(words), jnp.stack(up)


def free_distances(
    packed: PackedStates, margin: int, group: Array, shift: Array, words: Array, up: Array
) -> UInt8[Array, "2 n"]:
    """Steps to the first free voxel before anything unknown, on both sides; reach + 1 if none."""
    # The bits begin `margin` voxels below the voxel, so that steps to either side are shifts of 0 or more.
    reach, middle = words.shape[0], shift.astype(jnp.int32) + margin
    distances = []
    # A side is open as long as only occupied voxels were met: what lies behind an unknown one is no free side.
    for side in (1, -1):
        distance = jnp.full(group.shape, reach + 1, jnp.uint8)
        is_open = jnp.ones(group.shape, jnp.bool_)
        for step in range(reach):
            at = (middle + side * up[step]).astype(jnp.uint32)
            occupied, free = (bits & 1 == 1 for bits in packed.look(group + side * words[step], at))
            distance = jnp.where(is_open & free, jnp.uint8(step + 1), distance)
            is_open = is_open & occupied
        distances.append(distance)
    return jnp.stack(distances)


def _dot(a: tuple, b: tuple) -> Array:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
