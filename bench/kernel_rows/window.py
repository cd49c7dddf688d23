"""Rows of the moving window: classes in one pass, and how the count changes when the window moves."""

import functools
from collections.abc import Callable, Iterator

import jax
import jax.numpy as jnp
import numpy as np

from bench.kernel_row import KernelRow, Target
from bench.kernel_rows.checks import check_equal, temporary_bytes
from bench.kernel_rows.scene import rooms
from voxjax._runtime.threads import num_cores
from voxjax._types import OCCUPIED
from voxjax.ops.window.box import box_count
from voxjax.ops.window.class_tiles import TILE
from voxjax.ops.window.classes import (
    classes_in_passes,
    classes_of_counts,
    classes_within,
    count_change,
    count_steady_directions,
    shift_directions,
    window_classes,
)

_SIZE, _SHIFT = 7, 4
_MIN_CHANGE = np.int32(20)


def rows(*, quick: bool) -> Iterator[KernelRow]:
    """Rows of this module."""
    on_gpu = jax.devices()[0].platform != "cpu"
    yield _classes(128 if quick else 512 if on_gpu else 256, on_gpu)
    yield _change(64 if quick else 128)


def _classes(side: int, on_gpu: bool) -> KernelRow:
    """Count and classes at once against a count that is kept and then classified."""
    host = (rooms(side) == OCCUPIED).astype(np.uint8)
    grid = jnp.asarray(host)
    ours = functools.partial(window_classes, grid, _MIN_CHANGE, size=_SIZE, shift=_SHIFT)
    passes = classes_in_passes.lower(grid, _MIN_CHANGE, size=_SIZE, shift=_SHIFT).compile()
    pad = jax.jit(lambda occupied: jnp.pad(occupied, _SHIFT))
    classify = jax.jit(functools.partial(classes_of_counts, shift=_SHIFT))

    def two_steps() -> jax.Array:
        # A window beside the border still holds voxels, so the counts need a margin.
        return classify(box_count(pad(grid), size=_SIZE), grid, _MIN_CHANGE)

    calls: dict[str, Callable[[], object]] = {
        "one pass": functools.partial(passes, grid, _MIN_CHANGE),
        "two steps": two_steps,
    }
    name = "pallas" if on_gpu else "tiles"
    calls[name] = functools.partial(ours, implementation=name)
    check_equal(list(calls.values()))
    calls["steady directions alone"] = functools.partial(count_steady_directions, grid, _MIN_CHANGE)
    return KernelRow(
        name=f"window_classes {_SIZE}, {side}^3",
        ours=name,
        candidates=calls,
        count=host.size,
        unit="voxel",
        bytes_moved=2.0 * host.size,
        targets=(Target("two steps", 1.3),),
        temporary_bytes=temporary_bytes(passes) if on_gpu else _bytes_of_tiles(grid.shape),
        max_temporary=0.0 if on_gpu else 1.0,
        note="two steps: box_count of the padded grid, kept, then its classes; tiles: all that one takes, on each core",
    )


def _bytes_of_tiles(shape: tuple[int, ...]) -> int | None:
    """What is held while a grid is classified tile by tile: a tile a core, with its kernel's memory and classes."""
    sides = [min(length, most) + 2 * (_SIZE // 2 + _SHIFT) for length, most in zip(shape, TILE, strict=True)]
    tile = jax.ShapeDtypeStruct(sides, np.uint8)
    kernel = classes_within.lower(tile, _MIN_CHANGE, size=_SIZE, shift=_SHIFT).compile()
    memory = kernel.memory_analysis()
    if memory is None:
        return None
    held = memory.argument_size_in_bytes + memory.temp_size_in_bytes + memory.output_size_in_bytes
    return num_cores() * int(held)


def _change(side: int) -> KernelRow:
    """The change along 13 directions from one count against a count of its own for each move."""
    grid = jnp.asarray(rooms(side) == OCCUPIED)
    ours = count_change.lower(grid, size=_SIZE, shift=_SHIFT).compile()
    calls = {
        "one count": functools.partial(ours, grid),
        "a count per move": functools.partial(_change_by_move, grid),
    }
    check_equal(list(calls.values()))
    return KernelRow(
        name=f"count_change {_SIZE}, {side}^3",
        ours="one count",
        candidates=calls,
        count=grid.size,
        unit="voxel",
        bytes_moved=14.0 * grid.size,
        temporary_bytes=temporary_bytes(ours),
    )


@jax.jit
def _change_by_move(occupied: jax.Array) -> jax.Array:
    """The changes from the definition: the window is counted anew on the moved grid, 26 times."""

    def counted(move: np.ndarray) -> jax.Array:
        start = [_SHIFT + int(m) for m in move]
        counts = jax.lax.optimization_barrier(box_count(jnp.pad(occupied, _SHIFT), size=_SIZE))
        moved = jax.lax.slice(counts, start, [s + n for s, n in zip(start, occupied.shape, strict=True)])
        return moved.astype(jnp.int32)

    here = counted(np.zeros(3, np.int32))
    percent = []
    for move in shift_directions(_SHIFT):
        change = jnp.maximum(jnp.abs(counted(move) - here), jnp.abs(counted(-move) - here))
        percent.append(jnp.minimum(100 * change // jnp.maximum(here, 1), 255))
    return jnp.where(here[..., None] > 0, jnp.stack(percent, axis=-1), 0).astype(jnp.uint8)
