"""Checks of what is laid on several devices and of what is scored there: one sentence each, before any device works.

A mistake that only a device meets is told in words of JAX's, and in runs of many processes by one of them alone.
"""

from math import prod

import jax
import numpy as np
from jax.sharding import Mesh
from jaxtyping import Int, Shaped

from ..._checks import InputError, check_positive, check_type, shown
from ..._runtime.placement import is_traced
from ..._types import Array
from ..blocks.block_array import lattice_shape
from ..evidence.lookup import Block


def check_mesh(mesh: object) -> None:
    """Raise if nothing can be laid on a mesh.

    Raises:
        InputError: If it is no mesh of JAX, or has no devices.
    """
    check_type("mesh", mesh, Mesh, 'make it with jax.make_mesh((jax.device_count(),), ("part",))')
    if mesh.devices.size == 0:  # pyright: ignore[reportAttributeAccessIssue]
        raise InputError("mesh must have one device or more, got an empty mesh; take those of jax.devices().")


def place_of(block: Block) -> tuple[tuple[int, int, int], Int[np.ndarray, "a b c"]]:
    """Size of a block [voxel], and its table over the box.

    Raises:
        InputError: If the block has no table or one that is too short, or its place or size are none.
    """
    if block.table is None:
        raise InputError("block must have a table of blocks, as that of a prepared map; got a dense field.")
    dims = as_array(block.dims)
    if dims.shape != (3,) or dims.dtype.kind not in "ui" or dims.min() < 1:
        raise InputError(
            f"block.dims must be three whole numbers of voxels, 1 or more, got {shown(block.dims)}."
        )
    if _numbers("block.origin", block.origin).shape != (3,):
        raise InputError(f"block.origin must be three numbers [m], got {shown(block.origin)}.")
    check_positive("block.voxel_size", block.voxel_size, "m")
    x, y, z = (int(n) for n in dims)
    lattice, table = lattice_shape((x, y, z)), as_array(block.table)
    if table.ndim != 1 or table.dtype.kind not in "ui" or len(table) < prod(lattice):
        raise InputError(
            f"block.table must be a flat array of {prod(lattice)} rows or more, one for each block of 8 x 8 x 8 voxels "
            f"of {x} x {y} x {z}, got {table.dtype} of shape {table.shape}; give the one that was made with the codes."
        )
    table = table[: prod(lattice)].reshape(lattice)
    if table.min() < 0:
        raise InputError(
            f"block.table must hold rows from 0 on, got {table.min()}; give the one that was made with the codes."
        )
    return (x, y, z), table


def scored_lists(points: object, weights: object, poses: object) -> tuple[Array, Array, Array]:
    """Points (n, 3), weights (n,) and poses (k, 4, 4) in float32, on the host; traced ones are left as they are.

    Raises:
        InputError: If some are no real numbers or have another shape, or there is not one weight for each point.
    """
    points, weights = _list_of("points", points, (3,)), _list_of("weights", weights, ())
    if len(points) != len(weights):
        raise InputError(
            f"weights must be as many as points, got {len(weights)} for {len(points)}; give each point one."
        )
    return points, weights, _list_of("poses", poses, (4, 4))


def as_array(values: object) -> np.ndarray:
    """What was given as an array; one of None for rows of several lengths, which a check of its dtype refuses."""
    try:
        return np.asarray(values)
    except ValueError:
        return np.asarray(None)


def _list_of(name: str, values: object, row: tuple[int, ...]) -> Array:
    """Rows of a shape; an empty list has none."""
    array = values if is_traced(values) else _numbers(name, values)
    assert isinstance(array, (np.ndarray, jax.Array))
    if array.shape == (0,):
        array = array.reshape(0, *row)
    if array.shape[1:] != row or array.ndim == 0:
        wanted = ", ".join(map(str, ("n", *row))) if row else "n,"
        raise InputError(
            f"{name} must be an array of shape ({wanted}), got shape {array.shape}; put one alone into a list."
        )
    return array


def _numbers(name: str, values: object) -> np.ndarray:
    """Real numbers as float32; those too large for it are infinite."""
    array = as_array(values)
    try:
        # NumPy would make numbers of texts, and drop a part of complex ones.
        if array.dtype.kind in "OSUcMm":
            raise TypeError(f"{array.dtype} holds no real numbers")
        with np.errstate(over="ignore"):
            return array.astype(np.float32, copy=False)
    except (TypeError, ValueError):
        raise InputError(
            f"{name} must be an array of real numbers, got {shown(values)}; make it with numpy.asarray."
        ) from None


def check_finite(name: str, values: Shaped[np.ndarray, "n *row"]) -> None:
    """Raise if some rows hold what is no number, or too large for float32.

    Raises:
        InputError: If there are such rows.
    """
    is_bad = ~np.isfinite(values).all(axis=tuple(range(1, values.ndim)))
    if is_bad.any():
        raise InputError(
            f"{name} must be finite, but {is_bad.sum()} of {len(values)} are not; leave those out."
        )
