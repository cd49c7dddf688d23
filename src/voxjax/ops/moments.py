"""Surface moments at listed voxels: normal, curvature and the side on which space is free.

Work grows with the number of listed voxels, but for one pass over the volume that packs the states into bits.
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float32, Int, Int32, Shaped, UInt8

from .._buckets import bucket_size
from .._checks import check_odd_window
from .._types import Array
from .eigen import symmetric_eigen
from .window_bits import GROUP, PackedStates, pack_states, window_sums

_PIECE = 2048
_PIECES = 4
_CHUNK_ELSEWHERE = 1 << 17
"""Rows of one step on a CPU (what it writes stays in the cache of a core) and steps of a chunk; rows of a chunk on
other devices, whose steps are whole chunks."""
_SMALLEST_BLOCK = 1 << 20


class SurfaceMoments(NamedTuple):
    """What the neighbourhood of each listed voxel says about the surface there.

    Attributes:
        normal: float32 (n, 3) unit vectors, toward the free neighbours where there are any.
        curvature: float32 (n,): smallest eigenvalue of the covariance over the sum of all, 0 (plane) to 1/3.
        num_occupied: int32 (n,): occupied voxels in the window, the centre included.
        has_free: bool (n,): whether the window holds free voxels off the plane, so that the sign means
            something.
        offset: float32 (n,) [voxel]: from the voxel's centre along the normal to the plane through the mean of the
            occupied voxels in the window.
        free_distance: uint8 (n, 2) [voxel]: steps along +normal and along -normal to the first free voxel,
            where nothing unknown comes before; `reach + 1` where there is none.
    """

    normal: Float32[Array, "n 3"]
    curvature: Float32[Array, "n"]
    num_occupied: Int32[Array, "n"]
    has_free: Bool[Array, "n"]
    offset: Float32[Array, "n"]
    free_distance: UInt8[Array, "n 2"]


def surface_moments(
    states: UInt8[Array, "x y z"], index: Int32[Array, "n 3"], *, size: int = 7, reach: int = 3
) -> SurfaceMoments:
    """Normal, curvature and free sides of the surface at listed voxels (section III, reference 12).

    The normal is the eigenvector of the smallest eigenvalue of the covariance of the occupied voxels in a ball of
    diameter `size`, and points toward the mean offset of the free voxels in it. Host arrays are padded to a rung of
    the ladder of sizes, so that maps of other shapes compile nothing.

    Args:
        states: 0 unknown, 1 free, 2 occupied.
        index: Voxels to look at, inside the grid; rows may repeat (padding).
        size: Diameter of the window [voxel]; odd.
        reach: How many steps to look for free space along the normal [voxel].

    Returns:
        `SurfaceMoments`, rows as in `index`. Fewer than three voxels, or voxels on a line, leave a normal that is
        some unit vector; `curvature` is then 0 and `num_occupied` small.

    Raises:
        InputError: If the size is not odd or above 25, or the reach above 12.
    """
    margin = max(check_odd_window("size", size) // 2, reach)
    on_cpu = jax.default_backend() == "cpu"
    flat, dims = _padded_host(states, margin) if isinstance(states, np.ndarray) else _padded(states, margin)
    return _flat_moments(
        flat,
        dims,
        index,
        size=size,
        reach=reach,
        margin=margin,
        chunk=_PIECE * _PIECES if on_cpu else _CHUNK_ELSEWHERE,
        pieces=_PIECES if on_cpu else 1,
    )


def _padded_shape(states: Shaped[Array, "x y z"] | np.ndarray, margin: int) -> list[int]:
    """Shape of the block with the margin on each side, its depth a multiple of `GROUP`."""
    x, y, z = (side + 2 * margin for side in states.shape)
    return [x, y, -(-z // GROUP) * GROUP]


def _padded_host(states: np.ndarray, margin: int) -> tuple[np.ndarray, np.ndarray]:
    """The padded block in C order, on the ladder of sizes, and its shape; one copy of the states."""
    shape = _padded_shape(states, margin)
    num_cells = int(np.prod(shape))
    flat = np.zeros(bucket_size(num_cells, _SMALLEST_BLOCK), np.uint8)
    inner = tuple(slice(margin, margin + side) for side in states.shape)
    flat[:num_cells].reshape(shape)[inner] = states
    return flat, np.asarray(shape, np.int32)


def _padded(states: Array, margin: int) -> tuple[Array, np.ndarray]:
    """`_padded_host` for arrays on a device or under a transformation, without the ladder."""
    shape = _padded_shape(states, margin)
    widths = [(margin, full - margin - side) for full, side in zip(shape, states.shape, strict=True)]
    return jnp.pad(states.astype(jnp.uint8), widths).reshape(-1), np.asarray(shape, np.int32)


@partial(jax.jit, static_argnames=("size", "reach", "margin", "chunk", "pieces"))
def _flat_moments(
    flat: UInt8[Array, "flat"], dims: Int32[Array, "3"], index: Int32[Array, "n 3"],
    *, size: int, reach: int, margin: int, chunk: int, pieces: int,
) -> SurfaceMoments:  # fmt: skip
    """`surface_moments` on a flat block that is `margin` voxels wider on each side than the grid of `index`."""
    packed = pack_states(flat, dims, margin=margin)

    def place(rows: Array) -> tuple[Array, Array]:
        # The columns of the window begin at the group that holds the voxel `margin` below.
        group = packed.steps(rows[0] + margin, rows[1] + margin) + rows[2] // GROUP
        return group, (rows[2] % GROUP).astype(jnp.uint32)

    def one_chunk(rows: Array) -> tuple[Array, ...]:
        group, shift = _stepwise(place, pieces, rows.T)
        sums = _stepwise(
            lambda g, s: window_sums(packed, g, s + np.uint32(margin - size // 2), size=size),
            pieces, group, shift,
        )  # fmt: skip
        values, axis = _stepwise(_least_axis, pieces, sums)
        normal, *shape = _stepwise(_summarise, pieces, sums, values, axis)
        moves = _stepwise(lambda n: _moves(packed, n, reach), pieces, normal)
        distance = _stepwise(
            lambda *places: _free_distances(packed, margin, *places), pieces, group, shift, *moves
        )
        return normal.T, *shape, distance.T

    num_rows = index.shape[0]
    num_chunks = -(-num_rows // chunk)
    rows = jnp.pad(index.astype(jnp.int32), ((0, num_chunks * chunk - num_rows), (0, 0)))
    out = jax.lax.map(one_chunk, rows.reshape(num_chunks, chunk, 3))
    return SurfaceMoments(*(a.reshape(-1, *a.shape[2:])[:num_rows] for a in out))


def _stepwise(step: Callable, pieces: int, *columns: Array):
    """Apply a step to columns, piece by piece, and write its results down before the next step reads them.

    The loop is what makes XLA write them down on a CPU. Without it, each result of a later step computes those of
    the earlier ones again (`optimization_barrier` is gone before loops are fused), which takes ten times as long.
    """
    if pieces == 1:
        return jax.lax.optimization_barrier(step(*columns))
    split = [jnp.moveaxis(a.reshape(*a.shape[:-1], pieces, -1), -2, 0) for a in columns]
    done = jax.lax.map(lambda piece: step(*piece), split)
    return jax.tree.map(lambda a: jnp.moveaxis(a, 0, -2).reshape(*a.shape[1:-1], -1), done)


def _least_axis(sums: Int[Array, "14 n"]) -> tuple[Float32[Array, "3 n"], Float32[Array, "3 n"]]:
    """Eigenvalues of the covariance of the occupied voxels, ascending, and the vector of the least one."""
    sums = sums.astype(jnp.float32)
    count = jnp.maximum(sums[0], 1.0)
    mean, second = sums[1:4] / count[None], sums[4:10] / count[None]
    xx, yy, zz, xy, xz, yz = (
        second[k] - mean[i] * mean[j]
        for k, (i, j) in enumerate(((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))
    )
    rows = (jnp.stack(row, axis=-1) for row in ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz)))
    values, vectors = symmetric_eigen(jnp.stack(list(rows), axis=-2))
    return values.T, vectors[:, 0].T


def _summarise(
    sums: Array, values: Float32[Array, "3 n"], axis: Float32[Array, "3 n"]
) -> tuple[Array, Array, Array, Array, Array]:
    """Normal (3, n) toward free space, curvature, number of voxels, whether there is free space, offset."""
    count, *first = (sums[k].astype(jnp.float32) for k in range(4))
    free_count, *free = (sums[k].astype(jnp.float32) for k in range(10, 14))
    mean = [s / jnp.maximum(count, 1.0) for s in first]
    low, middle, high = (jnp.maximum(values[k], 0.0) for k in range(3))
    total = low + middle + high
    curvature = low / jnp.where(total > 0.0, total, 1.0)
    offset = sum(m * a for m, a in zip(mean, axis, strict=True))
    # The free voxels' offset from the surface, along the normal.
    lean = sum((f - free_count * m) * a for f, m, a in zip(free, mean, axis, strict=True))
    sign = jnp.where(lean < 0.0, jnp.float32(-1.0), jnp.float32(1.0))
    return sign[None] * axis, curvature, sums[0].astype(jnp.int32), jnp.abs(lean) > 0.5, sign * offset


def _moves(
    packed: PackedStates, normal: Float32[Array, "3 n"], reach: int
) -> tuple[Int32[Array, "r n"], Int32[Array, "r n"]]:
    """Steps along the normal: words to go on, and voxels up."""
    largest = jnp.max(jnp.abs(normal), axis=0)
    words, up = [], []
    for step in range(1, reach + 1):
        # Scaled so that each step enters a new voxel along the direction's largest axis.
        x, y, z = (jnp.round(step * normal[k] / largest).astype(jnp.int32) for k in range(3))
        words.append(packed.steps(x, y))
        up.append(z)
    return jnp.stack(words), jnp.stack(up)


def _free_distances(
    packed: PackedStates, margin: int, group: Array, shift: Array, words: Array, up: Array
) -> UInt8[Array, "2 n"]:
    """Steps to the first free voxel before anything unknown, on both sides; reach + 1 if none."""
    reach, middle = words.shape[0], shift.astype(jnp.int32) + margin
    distances = []
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
