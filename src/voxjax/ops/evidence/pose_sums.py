"""Sums over the points of one map of what they meet in the other, for each of many poses; in pieces on a CPU."""

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float32

from ..._runtime.pieces import sum_over_pieces
from ..._runtime.placement import on_host
from ..._types import Array


@runtime_checkable
class PoseField(Protocol):
    """A tree of arrays into which points of another map are looked up."""

    @property
    def sums(self) -> Callable[..., Array]:
        """From a pose, and lists of one row a point by columns, to the sums under it."""
        ...


def sums_of(parts: Sequence[Array]) -> Float32[Array, "m"]:
    """Sum of each of many arrays of one length, in one pass.

    Apart, XLA writes each array down on a CPU before it sums it, and starts a kernel for either.
    """
    # Partial sums that run side by side in a vector, their number one that divides the length.
    lanes = math.gcd(parts[0].shape[0], 8)
    columns = tuple(part.astype(jnp.float32).reshape(-1, lanes) for part in parts)
    sums = jax.lax.reduce(columns, (jnp.float32(0),) * len(parts), _add_each, (0,))
    return jnp.sum(jnp.stack(sums), axis=1)


def _add_each(left: tuple, right: tuple) -> tuple:
    return tuple(a + b for a, b in zip(left, right, strict=True))


def sums_of_piece(field: PoseField, *piece: Array) -> Float32[Array, "p m"]:
    """Sums under the first `count` of some poses, what follows is of no use; `piece`: lists, poses, count."""
    *lists, poses, count = piece
    columns = [rows.T for rows in lists]
    # A step of the loop costs as much as some hundred lookups; but arrays of two axes cost twice those of one.
    # So short lists take some poses in one step, of about 1024 lookups.
    together = max(1024 // columns[0].shape[1], 1)

    def one(i: jax.Array, sums: jax.Array) -> jax.Array:
        return sums.at[i].set(field.sums(poses[i], *columns))

    def some(i: jax.Array, sums: jax.Array) -> jax.Array:
        # Lists have the lengths of `PIECES`, so `together` divides the 512 poses: no slice reaches past their end,
        # where JAX would move it back in silence.
        step = jax.lax.dynamic_slice_in_dim(poses, i * together, together)
        found = jax.vmap(lambda T: field.sums(T, *columns))(step)
        return jax.lax.dynamic_update_slice_in_dim(sums, found, i * together, 0)

    # The number of sums is asked of the shapes alone: nothing is computed for it.
    width = jax.eval_shape(field.sums, poses[0], *columns).shape[0]
    start = jnp.zeros((poses.shape[0], width), jnp.float32)
    num_steps = (count + together - 1) // together
    return jax.lax.fori_loop(0, num_steps, one if together == 1 else some, start)


@partial(jax.jit, static_argnames=("batch_size",))
def _sums_at_once(field: PoseField, lists: tuple, poses: Array, batch_size: int) -> Array:
    columns = [rows.T for rows in lists]
    return jax.lax.map(lambda T: field.sums(T, *columns), poses, batch_size=batch_size)


def pose_sums(
    kernel: Callable[..., Array],
    field: PoseField,
    lists: tuple[Array, ...],
    poses: Array,
    *,
    most: int,
    batch_size: int,
) -> Any:
    """Sums (k, m) of a field under poses (k, 4, 4).

    Args:
        kernel: `sums_of_piece` as a compiled program.
        field: What is looked into.
        lists: One row a point, the weights last.
        poses: Each maps the points into the frame of the field.
        most: Points of a piece at most.
        batch_size: Poses handled together where all is one kernel.
    """
    # Without points or poses there is no piece to sum; the one kernel gives sums of the right shape.
    if not on_host(field, lists, poses) or not (len(poses) and len(lists[0])):
        return _sums_at_once(field, lists, poses, batch_size)
    # The tables are put there once, and all pieces take them as they are.
    held = jax.device_put(field)
    found = sum_over_pieces(
        partial(kernel, held), [np.asarray(a) for a in lists], np.asarray(poses), most=most
    )
    # Pieces are added up in float64, in their order: the sum is the same however many cores there are.
    return found.astype(np.float32)
