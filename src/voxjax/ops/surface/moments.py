"""Surface moments at listed voxels: normal, curvature and the side on which space is free.

Work grows with the number of listed voxels, but for one pass over the volume that packs the states into bits. Host
arrays are worked on in pieces of one size, side by side on all cores.
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float32, Int32, UInt8

from ..._checks import InputError, check_odd_window
from ..._runtime.forks import refused_after_fork
from ..._runtime.materialize import materialized
from ..._runtime.pieces import over_pieces
from ..._runtime.placement import are_numpy, on_host
from ..._runtime.programs import kept_program
from ..._types import Array
from ..blocks.over_tiles import Rows, over_tiles
from .axes import central_sums, free_distances, principal_axes, steps_along, surface_normal
from .ball_sums import window_sums
from .packed_states import PackedStates, pack_on_host, pack_states

_PIECE = 8192
"""Voxels of a compiled call on a CPU."""


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


@refused_after_fork
def surface_moments(
    states: UInt8[Array, "x y z"], index: Int32[Array, "n 3"], *, size: int = 7, reach: int = 3
) -> SurfaceMoments:
    """Normal, curvature and free sides of the surface at listed voxels (section III, reference 12).

    The normal is the eigenvector of the smallest eigenvalue of the covariance of the occupied voxels in a ball of
    diameter `size`, and points toward the mean offset of the free voxels in it. Where the smallest eigenvalues tie, as
    on posts and lines, all normals across fit equally well, and the one nearest to the free voxels is taken; where
    free voxels tell neither direction nor side, the choice is fixed, the same for voxels with the same neighbourhood.

    Host arrays of any shape and length share few compiled kernels; device arrays, and all under a transformation of
    JAX, have one kernel for each shape.

    Args:
        states: 0 unknown, 1 free, 2 occupied.
        index: Voxels to look at, inside the grid; rows may repeat (padding).
        size: Diameter of the window [voxel]; odd.
        reach: How many steps to look for free space along the normal [voxel].

    Returns:
        `SurfaceMoments`, rows as in `index`: host arrays if both arguments are, else device arrays. Fewer than three
        voxels, or voxels on a line, say little of a surface; `curvature` is then 0 and `num_occupied` small.

    Raises:
        InputError: If the size is not odd or above 25, the reach above 12, or host rows are outside the grid.
    """
    check_odd_window("size", size)
    if are_numpy(states, index):
        return _moments_on_host(np.asarray(states), np.asarray(index, np.int32), size=size, reach=reach)
    return _moments_kernel(jnp.asarray(states), jnp.asarray(index), size=size, reach=reach)


def tiled_moments(
    states_in: Callable[[np.ndarray, np.ndarray], np.ndarray],
    shape: tuple[int, ...],
    index: Int32[np.ndarray, "n 3"],
    *,
    size: int = 7,
    reach: int = 3,
) -> SurfaceMoments:
    """`surface_moments` in a box of any size, to the bit; a box of few voxels is one call.

    Args:
        states_in: Dense states of a window of the box, such as `VoxelGrid.states_in`.
        shape: Number of voxels of the box along x, y, z.
        index: Voxels to look at.
        size: Diameter of the window [voxel]; odd.
        reach: How many steps to look for free space along the normal [voxel].

    Returns:
        Host arrays.

    Raises:
        InputError: As from `surface_moments`.
    """
    # Before it decides how far tiles look beyond their voxels.
    check_odd_window("size", size)

    def moments(states: np.ndarray, low: np.ndarray, rows: Rows) -> SurfaceMoments:
        return surface_moments(states, index[rows] - low.astype(np.int32), size=size, reach=reach)

    return over_tiles(moments, states_in, index, shape, halo=_margin(size, reach))


def _moments_on_host(
    states: UInt8[np.ndarray, "x y z"], index: Int32[np.ndarray, "n 3"], *, size: int, reach: int
) -> SurfaceMoments:
    """The moments of host arrays, as host arrays."""
    packed = pack_on_host(states, margin=_margin(size, reach))
    # Constants of a function that is being traced are values all the same.
    with jax.ensure_compile_time_eval():
        # The words are put there once for all pieces; JAX takes reserved memory as it is, without a copy.
        packed = packed._replace(words=jax.device_put(packed.words))
    sides = np.asarray(states.shape, np.uint32)

    def moments(rows: np.ndarray, count: np.int32) -> SurfaceMoments:
        # Rows of padding are not checked: they name the first voxel, which an empty grid has not.
        if (rows[:count].view(np.uint32) >= sides).any():  # negative ones are large as such
            raise InputError(f"index must hold voxels inside the grid of {states.shape} voxels.")
        return _moments_of_piece(packed, rows, size=size, reach=reach)

    return over_pieces(moments, [index], size=_piece_length())


@partial(jax.jit, static_argnames=("size", "reach"))
def _moments_kernel(
    states: UInt8[Array, "x y z"], index: Int32[Array, "n 3"], *, size: int, reach: int
) -> SurfaceMoments:
    """The moments of arrays on a device or under a transformation: one kernel for each of their shapes."""
    packed = pack_states(states, margin=_margin(size, reach))
    num_rows, length = index.shape[0], _piece_length()
    num_pieces = -(-num_rows // length)
    # Padding looks at the first voxel of the grid, which is there; its results are cut off.
    rows = jnp.pad(index.astype(jnp.int32), ((0, num_pieces * length - num_rows), (0, 0)))
    done = jax.lax.map(
        lambda piece: _moments_of_piece(packed, piece, size=size, reach=reach),
        rows.reshape(num_pieces, length, 3),
    )
    return SurfaceMoments(*(a.reshape(-1, *a.shape[2:])[:num_rows] for a in done))


def _margin(size: int, reach: int) -> int:
    """How far from a voxel its states are looked up, at most [voxel]."""
    return max(size // 2, reach)


def _piece_length() -> int:
    # Accelerators need more voxels at once than cores of a CPU to be busy.
    return _PIECE if on_host() else 1 << 17


@kept_program
@partial(jax.jit, static_argnames=("size", "reach"))
def _moments_of_piece(
    packed: PackedStates, rows: Int32[Array, "n 3"], *, size: int, reach: int
) -> SurfaceMoments:
    """The moments of one piece of the list, some rows at a time, so that what steps write stays in the cache."""
    # Voxels of one step on a CPU: what it writes stays in the cache of a core.
    step = 2048
    steps = max(len(rows) // step, 1) if on_host() else 1
    if steps == 1:
        return _moments_of_rows(packed, rows, size=size, reach=reach)
    done = jax.lax.map(
        lambda some: _moments_of_rows(packed, some, size=size, reach=reach), rows.reshape(steps, -1, 3)
    )
    return jax.tree.map(lambda a: a.reshape(-1, *a.shape[2:]), done)


def _moments_of_rows(
    packed: PackedStates, rows: Int32[Array, "n 3"], *, size: int, reach: int
) -> SurfaceMoments:
    """The moments of a few rows, step by step: in one, each result would compute those before it again."""
    step = partial(materialized, is_valid=packed.depth > 0)
    margin = _margin(size, reach)
    group, shift = step(lambda: packed.place(rows.T, margin=margin))
    # Words begin `margin` voxels below, for the longer of window and steps; the window begins within it.
    below = np.uint32(margin - size // 2)
    sums = step(lambda: window_sums(packed, group, shift + below, size=size))
    central = step(lambda: central_sums(sums))
    axes = step(lambda: principal_axes(central.covariance))
    normal, has_free, offset = step(lambda: surface_normal(central, axes))
    words, up = step(lambda: steps_along(packed, normal, reach))
    distance = step(lambda: free_distances(packed, margin, group, shift, words, up))
    return SurfaceMoments(normal.T, axes.curvature, central.count, has_free, offset, distance.T)
