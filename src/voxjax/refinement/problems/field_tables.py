"""Fields near the surfaces of a map, for the residuals that read values between voxel centres."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ..._runtime.buckets import pad_rows, wide_bucket_size
from ..._runtime.placement import to_device
from ..._runtime.tables import reserve
from ..._types import FREE, OCCUPIED, Array
from ...maps.prepared import FIELD_RADIUS, PreparedMap
from ...ops.evidence.nearest import INDEX_BITS, NOTHING_NEAR, split_keys
from ..residuals.distance import plane_distances
from ..residuals.fields import Field
from ..residuals.planes import NearestSurface


def field_length(num_values: int, *, smallest: int = 1 << 16) -> int:
    """Length of the table for the values of a field: lengths climb in wide steps, so that maps share kernels."""
    return wide_bucket_size(num_values, smallest)


def distance_field_of(prepared: PreparedMap, surface: NearestSurface) -> Field:
    """Truncated distances from the planes of a map, signed where its normals say which side is free.

    Row 0 of the values is the end of the reach, that of all voxels that are farther, and of what is outside.

    Args:
        prepared: The map.
        surface: Planes of the map, which may be traced: the field is differentiable in them.
    """
    keys, _ = prepared.near_cells()
    cells = np.flatnonzero(keys != NOTHING_NEAR)
    voxel_size = jnp.asarray(surface.voxel_size)
    reach = jnp.asarray(FIELD_RADIUS, voxel_size.dtype) * voxel_size
    # A sign needs free space on one side: elsewhere it would be that of an arbitrary normal.
    sides = np.asarray(prepared.sides)[: len(surface.points)]
    is_signed = sides.any(axis=1) & prepared.has_free_space
    length = field_length(len(cells))
    nearest = pad_rows(np.asarray(split_keys(keys[cells])[0]), length)
    centres = prepared.grid.world_from_index(prepared.voxels_at(cells)).astype(voxel_size.dtype)
    distances = plane_distances(
        pad_rows(centres, length),
        nearest,
        jnp.asarray(surface.points),
        jnp.asarray(surface.normals),
        is_signed,
        voxel_size=voxel_size,
        reach=reach,
    )
    rows = _rows(prepared, cells, 1)
    return _field(prepared, rows, jnp.concatenate([reach[None], distances]))


def opinion_field_of(prepared: PreparedMap, said: Float[Array, "x y z"] | None = None) -> Field:
    """What a map says of each voxel, 1 occupied, -1 free, 0 unknown, which is also what it says of all beyond it.

    Row 0 of the values is the unknown, row 1 all free space that is far from surfaces.

    Args:
        prepared: The map.
        said: Opinions of all voxels of its grid (see `residuals.occupancy.opinion`); they may be traced. None takes
            the states.
    """
    # Opinions of voxels within three voxels of a surface are told apart; beyond, free is free.
    band_sq = 9
    keys, states = prepared.near_cells()
    # Where nothing is near, the key gives a distance beyond all.
    is_near = keys >> INDEX_BITS <= band_sq
    cells = np.flatnonzero(is_near)
    length = field_length(len(cells))
    if said is None:
        near = np.where(states[cells] == OCCUPIED, 1.0, np.where(states[cells] == FREE, -1.0, 0.0))
        near = jnp.asarray(pad_rows(near.astype(np.float32), length))
    else:
        # Padding reads voxel 0, and nothing points to what it reads.
        near = jnp.asarray(said)[tuple(pad_rows(prepared.voxels_at(cells), length).T)]
    # Two numbers stand for most of the volume: a derivative is then as long as what is near surfaces.
    values = jnp.concatenate([jnp.asarray([0.0, -1.0], near.dtype), near])
    rows = _rows(prepared, cells, 2)
    rows[np.flatnonzero((states == FREE) & ~is_near)] = 1
    return _field(prepared, rows, values)


def _rows(prepared: PreparedMap, cells: np.ndarray, first: int) -> np.ndarray:
    """Rows of values for all cells of a map's pools: those of some cells from `first` on, 0 elsewhere."""
    # What is not written is row 0, that of all that is far, and takes no memory.
    rows = reserve(len(prepared.keys), dtype=np.int32)
    rows[cells] = np.arange(first, first + len(cells), dtype=np.int32)
    return rows


def _field(prepared: PreparedMap, rows: np.ndarray, values: Array) -> Field:
    dims, origin, voxel_size, table = prepared.block
    origin, voxel_size = (np.asarray(value, values.dtype) for value in (origin, voxel_size))
    return Field(to_device(rows), dims, origin, voxel_size, values, np.asarray(0, np.int32), table)
