"""Faces that meet at a point: samples of the map on the quarter planes around candidate corners.

Three planes through a point cut space into eight octants, each bounded by three quarter planes ("patches").
Octant o has bit i set where it lies on the negative side of plane i. Seen from inside an octant, a patch is a
face if it is occupied and the space just before it is free.
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float32, Int32, UInt8

from ..._runtime.pieces import over_pieces
from ..._runtime.placement import are_numpy, to_device
from ..._runtime.precision import in_full_precision
from ..._runtime.tables import as_table, check_cells, table_length
from ..._types import FREE, OCCUPIED, Array

OCTANT_SIGNS = np.asarray([[1 - 2 * ((o >> i) & 1) for i in range(3)] for o in range(8)], np.int32)
"""Side of each plane on which octant o lies, int32 (8, 3)."""


class CornerFaces(NamedTuple):
    """Shares of samples around each candidate, float32.

    Attributes:
        seen: (m, 8, 3): share of patch i of octant o that is occupied with free space before it inside the octant.
        occupied: (m, 8, 3): share of patch i of octant o that is occupied (the same for both octants that share the
            patch).
        free: (m, 8): share of octant o that is free.
    """

    seen: Float32[Array, "m 8 3"]
    occupied: Float32[Array, "m 8 3"]
    free: Float32[Array, "m 8"]


def edge_directions(normals: Float32[Array, "*m 3 3"]) -> Float32[Array, "*m 3 3"]:
    """Unit vectors along the edges of three planes: row i lies in the two other planes, on the positive side of i."""
    crosses = jnp.stack(
        [jnp.cross(normals[..., (i + 1) % 3, :], normals[..., (i + 2) % 3, :]) for i in range(3)], axis=-2
    )
    # Which way a cross product points depends on the handedness of the three normals, which nobody has ordered.
    side = jnp.sign(jnp.sum(crosses * normals, axis=-1, keepdims=True))
    return side * crosses / jnp.maximum(jnp.linalg.norm(crosses, axis=-1, keepdims=True), 1e-9)


def corner_faces(
    states: UInt8[Array, "x y z"],
    position: Float32[Array, "m 3"],
    normals: Float32[Array, "m 3 3"],
    *,
    low: Int32[Array, "3"] | None = None,
    first: float = 1.5,
    last: float = 5.5,
) -> CornerFaces:
    """Sample the patches and octants around candidate corners.

    A sample of a patch counts as occupied if a voxel within one voxel along the plane's normal is; space
    before it is free if a voxel 1.5 or 2.5 voxels into the octant is.

    Args:
        states: 0 unknown, 1 free, 2 occupied; outside counts as unknown.
        position: Candidates in voxel coordinates: the centre of voxel (i, j, k) is (i, j, k).
        normals: Unit normals of the three planes, rows; not all in one plane.
        low: The voxel of those coordinates that the states begin with, where they are a window; None for (0, 0, 0).
        first: Distance of the first samples from the edges [voxel]; samples follow every voxel ...
        last: ... up to this distance.

    Returns:
        `CornerFaces`.

    Raises:
        InputError: If the grid has more voxels than int32 can count.
    """
    check_cells(states.size, 0, "states", "crop the grid, or work tile by tile")
    run = partial(_faces_kernel, first=first, last=last)
    # Lowest voxel and number of voxels along x, y, z.
    box = np.zeros(3, np.int32) if low is None else low, np.asarray(states.shape, np.int32)
    if are_numpy(states, position, normals):
        flat = np.ascontiguousarray(states).reshape(-1)
        return _faces_on_host(run, flat, box, np.asarray(position), np.asarray(normals))
    return run(states.reshape(-1), box, position, normals)


def faces_reach(last: float) -> int:
    """How far from a candidate `corner_faces` looks along an axis, at most [voxel].

    Args:
        last: Distance of the last samples from the edges [voxel].
    """
    # Samples of a patch lie twice that far where its edges are close together, those of an octant nine voxels.
    return max(int(np.ceil(3 * last)) + 4, 10)


def _faces_on_host(
    run: Callable[..., CornerFaces],
    flat: np.ndarray,
    box: tuple[Array, np.ndarray],
    position: np.ndarray,
    normals: np.ndarray,
) -> CornerFaces:
    """Any number of candidates on a block of any size, compiling nothing new."""
    # Candidates that a core looks at, on host arrays.
    group = 512
    table = to_device(as_table(flat, table_length(flat.size)))

    def look(some: np.ndarray, planes: np.ndarray, _: np.int32) -> CornerFaces:
        return run(table, box, some, planes)

    # Padding gets three planes that meet, so that it has edges as well.
    fills = [0.0, np.eye(3, dtype=np.float32)]
    return over_pieces(look, [position, normals], size=group, fills=fills)


@partial(jax.jit, static_argnames=("first", "last"))
@in_full_precision
def _faces_kernel(
    flat: UInt8[Array, "flat"],
    box: tuple[Int32[Array, "3"], Int32[Array, "3"]],
    position: Float32[Array, "m 3"],
    normals: Float32[Array, "m 3 3"],
    *,
    first: float,
    last: float,
) -> CornerFaces:
    """`corner_faces` on a flat block, so that maps of other shapes compile nothing."""
    # Candidates of one step of the kernel.
    chunk = 64
    margin = faces_reach(last)
    low, shape = box
    strides = jnp.stack([shape[1] * shape[2], shape[2], jnp.ones_like(shape[2])])
    # The end is half a step beyond the last sample, so that rounding does not lose it.
    steps = jnp.arange(first, last + 0.5, 1.0, dtype=jnp.float32)
    signs = jnp.asarray(OCTANT_SIGNS, jnp.float32)

    def look_up(points: Array) -> Array:
        # Far points are clipped first, so that whole numbers cannot overflow.
        index = jnp.round(jnp.clip(points, -margin, 1e6)).astype(jnp.int32)
        index = index - jnp.broadcast_to(low, index.shape)
        inside = jnp.all((index >= 0) & (index < jnp.broadcast_to(shape, index.shape)), axis=-1)
        linear = jnp.sum(
            jnp.where(inside[..., None], index, 0) * jnp.broadcast_to(strides, index.shape),
            axis=-1,
            dtype=jnp.int32,
        )
        return jnp.where(inside, flat[linear], jnp.uint8(0))

    def one(candidate: tuple[Array, Array]) -> CornerFaces:
        centre, n = candidate
        edges = edge_directions(n)
        seen, occupied = [], []
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            # Samples of the quarter plane: every voxel along both edges, on the octant's side of the other planes.
            # The axes are octants, steps along one edge, steps along the other, and x, y, z.
            along_j = steps[None, :, None, None] * signs[:, None, None, j, None] * edges[j][None, None, None]
            along_k = steps[None, None, :, None] * signs[:, None, None, k, None] * edges[k][None, None, None]
            points = centre[None, None, None] + along_j + along_k
            inward = signs[:, None, None, i, None] * n[i][None, None, None]
            # The surface may lie a voxel off the plane; so free space is only looked for beyond that voxel.
            hit = jnp.stack([look_up(points + t * inward) == OCCUPIED for t in (-1.0, 0.0, 1.0)]).any(axis=0)
            open_ = jnp.stack([look_up(points + t * inward) == FREE for t in (1.5, 2.5)]).any(axis=0)
            occupied.append(jnp.mean(hit, axis=(1, 2), dtype=jnp.float32))
            seen.append(jnp.mean(hit & open_, axis=(1, 2), dtype=jnp.float32))
        # The octant itself is sampled off its faces, because a surface may lie a voxel off its plane.
        depth = jnp.asarray([1.5, 3.0], jnp.float32)
        a, b, c = jnp.meshgrid(depth, depth, depth, indexing="ij")
        inner = jnp.stack([a, b, c], axis=-1).reshape(1, 8, 3) * signs[:, None, :]
        free = look_up(centre[None, None] + inner @ edges) == FREE
        return CornerFaces(
            jnp.stack(seen, axis=-1), jnp.stack(occupied, axis=-1), jnp.mean(free, axis=1, dtype=jnp.float32)
        )

    return jax.lax.map(one, (position, normals), batch_size=chunk)
