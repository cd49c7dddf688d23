"""Rows of the list of occupied voxels."""

import functools
from collections.abc import Iterator

import jax
import jax.numpy as jnp
import numpy as np

from bench.kernel_row import KernelRow, Target
from bench.kernel_rows.checks import temporary_bytes
from bench.kernel_rows.scene import rooms
from voxjax._types import OCCUPIED
from voxjax.ops.blocks.compact import occupied_indices


def rows(*, quick: bool) -> Iterator[KernelRow]:
    """Rows of this module."""
    for side in (128,) if quick else (256, 512):
        yield _list(side)


def _list(side: int) -> KernelRow:
    host = rooms(side) == OCCUPIED
    grid, size = jnp.asarray(host), int(1.1 * np.count_nonzero(host))  # some room, as callers leave it
    ours = occupied_indices.lower(grid, size=size).compile()
    nonzero = jax.jit(lambda occupied: jnp.stack(jnp.nonzero(occupied, size=size), axis=1))
    expected = np.argwhere(host)
    indices, mask = ours(grid)
    np.testing.assert_array_equal(np.asarray(indices)[np.asarray(mask)], expected)
    np.testing.assert_array_equal(np.asarray(nonzero(grid))[: len(expected)], expected)
    return KernelRow(
        name=f"occupied_indices, {side}^3",
        ours="occupied_indices",
        candidates={
            "occupied_indices": functools.partial(ours, grid),
            "jnp.nonzero(size=)": functools.partial(nonzero, grid),
            "np.flatnonzero": functools.partial(np.flatnonzero, host),
            "np.argwhere": functools.partial(np.argwhere, host),
        },
        count=host.size,
        unit="voxel",
        bytes_moved=host.size + 12.0 * size,
        targets=(Target("jnp.nonzero(size=)", 5.0), Target("np.flatnonzero", 1.0)),
        temporary_bytes=temporary_bytes(ours),
        note=f"{100 * host.mean():.1f} % occupied; np.argwhere gives the same rows, np.flatnonzero one number each",
    )
