"""Rows of the window kernels: counts, their change when the window moves, classes in one pass."""

import functools
import importlib
from collections.abc import Callable, Iterator

import jax
import jax.numpy as jnp
import numpy as np
from scipy import ndimage

from bench.kernel_row import KernelRow, Target
from bench.kernel_rows.scene import rooms
from bench.kernel_setting import allocator
from voxjax._types import OCCUPIED
from voxjax.ops.box import box_count
from voxjax.ops.window import (
    classes_of_counts,
    count_change,
    count_steady_directions,
    shift_directions,
    window_classes,
)

_SIZE, _SHIFT = 7, 4
_COPY = "numpy widening copy, memory reused"
_MIN_CHANGE = np.int32(20)
_LARGEST_SUMMED_AREA = 256
_CPU_TARGETS = {
    "default": (Target("scipy uniform_filter", 8.0),),
    "tuned": (
        Target(_COPY, 0.2),
        Target("scipy uniform_filter", 40.0),
        Target("opencv boxFilter and running sum", 2.5),
        Target("numpy shifted adds", 4.0),
    ),
}
_GPU_TARGETS = (Target("copy on the device", 0.6 * 1.5),)
"""60 % of the copy's bytes per second: a count moves 3 bytes per voxel where the copy moves 2."""


def rows(*, quick: bool) -> Iterator[KernelRow]:
    """Rows of this module; the targets are about the largest grid."""
    on_gpu = jax.devices()[0].platform != "cpu"
    sides = (64, 128) if quick else (1024,) if on_gpu else (256, 512)
    for side in sides:
        yield _count(side, on_gpu, has_targets=side == sides[-1])
    for size in (3, 15):
        yield _other_size(128 if quick else 256, size)
    yield _classes(128 if quick else 512 if on_gpu else 256, on_gpu)
    yield _change(64 if quick else 128)


def numpy_adds(occupied: np.ndarray, size: int) -> np.ndarray:
    """Counts by NumPy: one shifted copy of a padded grid after the other, uint8 while they fit."""
    half = size // 2
    counts = np.pad(occupied, half)
    for axis, dtype in ((2, np.uint8), (1, np.uint8), (0, np.uint16)):
        length = counts.shape[axis] - 2 * half
        place = [slice(None)] * 3
        place[axis] = slice(0, length)
        total = counts[tuple(place)].astype(dtype)
        for shift in range(1, size):
            place[axis] = slice(shift, shift + length)
            total += counts[tuple(place)]
        counts = total
    return counts


def opencv_adds(cv2, occupied: np.ndarray, size: int) -> np.ndarray:
    """Counts by OpenCV: its box filter on each slice, then a running sum along x."""
    half, num_planes = size // 2, len(occupied)
    planes = np.empty(occupied.shape, np.uint16)
    for plane, out in zip(occupied, planes, strict=True):
        cv2.boxFilter(plane, cv2.CV_16U, (size, size), out, normalize=False, borderType=cv2.BORDER_CONSTANT)
    counts = np.empty_like(planes)
    running = planes[:half].sum(axis=0, dtype=np.uint16)
    for x in range(num_planes):
        if x + half < num_planes:
            running += planes[x + half]
        if x - half - 1 >= 0:
            running -= planes[x - half - 1]
        counts[x] = running
    return counts


def _count(side: int, on_gpu: bool, *, has_targets: bool) -> KernelRow:
    """All implementations of the count and what it is held against."""
    host = (rooms(side) == OCCUPIED).astype(np.uint8)
    grid = jnp.asarray(host)
    ours = box_count.lower(grid, size=_SIZE).compile()
    calls: dict[str, Callable[[], object]] = {"box_count": functools.partial(ours, grid)}
    names = (
        ["packed"]
        + (["pallas"] if on_gpu else [])
        + (["summed_area"] if side <= _LARGEST_SUMMED_AREA else [])
    )
    for name in names:
        calls[f"box_count {name}"] = functools.partial(box_count, grid, size=_SIZE, implementation=name)
    exact = list(calls.values())
    widen = jax.jit(lambda x: x.astype(jnp.uint16))
    calls["jax widening copy"] = functools.partial(widen, grid)
    notes = []
    if on_gpu:
        copy = jax.jit(lambda x: x ^ jnp.uint8(1))
        calls["copy on the device"] = functools.partial(copy, grid)
    else:
        notes.append("pallas needs a GPU: not measured")
        wide = host.astype(np.float32)
        target = np.empty(host.shape, np.uint16)
        calls[_COPY] = lambda: np.copyto(target, host)
        calls["scipy uniform_filter"] = lambda: ndimage.uniform_filter(wide, _SIZE, mode="constant")
        calls["numpy shifted adds"] = functools.partial(numpy_adds, host, _SIZE)
        exact.append(calls["numpy shifted adds"])
        cv2 = _optional("cv2")
        if cv2 is None:
            notes.append("OpenCV is not installed")
        else:
            calls["opencv boxFilter and running sum"] = functools.partial(opencv_adds, cv2, host, _SIZE)
            exact.append(calls["opencv boxFilter and running sum"])
    _check_equal(exact)
    targets = _GPU_TARGETS if on_gpu else _CPU_TARGETS[allocator()]
    return KernelRow(
        name=f"box_count {_SIZE}, {side}^3",
        ours="box_count pallas" if on_gpu else "box_count",
        candidates=calls,
        count=host.size,
        unit="voxel",
        bytes_moved=3.0 * host.size,
        targets=tuple(t for t in targets if t.reference in calls) if has_targets else (),
        temporary_bytes=_temporary(ours),
        max_temporary=2.0,
        note="; ".join([f"{100 * host.mean():.1f} % occupied", *notes]),
    )


def _other_size(side: int, size: int) -> KernelRow:
    """The count at the smallest and the largest window."""
    host = (rooms(side) == OCCUPIED).astype(np.uint8)
    grid = jnp.asarray(host)
    ours = box_count.lower(grid, size=size).compile()
    calls: dict[str, Callable[[], object]] = {
        "box_count": functools.partial(ours, grid),
        "box_count packed": functools.partial(box_count, grid, size=size, implementation="packed"),
        "numpy shifted adds": functools.partial(numpy_adds, host, size),
    }
    _check_equal(list(calls.values()))
    return KernelRow(
        name=f"box_count {size}, {side}^3",
        ours="box_count",
        candidates=calls,
        count=host.size,
        unit="voxel",
        bytes_moved=3.0 * host.size,
        temporary_bytes=_temporary(ours),
        max_temporary=2.0,
    )


def _classes(side: int, on_gpu: bool) -> KernelRow:
    """Count and classes in one pass against a count that is kept and then classified."""
    host = (rooms(side) == OCCUPIED).astype(np.uint8)
    grid = jnp.asarray(host)
    ours = window_classes.lower(grid, _MIN_CHANGE, size=_SIZE, shift=_SHIFT).compile()
    pad = jax.jit(lambda occupied: jnp.pad(occupied, _SHIFT))
    classify = jax.jit(functools.partial(classes_of_counts, shift=_SHIFT))

    def two_steps() -> jax.Array:
        # A window beside the border still holds voxels, so the counts need a margin.
        return classify(box_count(pad(grid), size=_SIZE), grid, _MIN_CHANGE)

    calls: dict[str, Callable[[], object]] = {
        "one pass": functools.partial(ours, grid, _MIN_CHANGE),
        "two steps": two_steps,
    }
    if on_gpu:
        kernels = functools.partial(window_classes, grid, _MIN_CHANGE, size=_SIZE, shift=_SHIFT)
        calls["pallas"] = functools.partial(kernels, implementation="pallas")
    _check_equal(list(calls.values()))
    calls["steady directions alone"] = functools.partial(count_steady_directions, grid, _MIN_CHANGE)
    return KernelRow(
        name=f"window_classes {_SIZE}, {side}^3",
        ours="pallas" if on_gpu else "one pass",
        candidates=calls,
        count=host.size,
        unit="voxel",
        bytes_moved=2.0 * host.size,
        targets=(Target("two steps", 1.3),),
        temporary_bytes=_temporary(ours),
        note="two steps: box_count of the padded grid, kept, then its classes",
    )


def _change(side: int) -> KernelRow:
    """The change along 13 directions from one count against a count of its own for each move."""
    grid = jnp.asarray(rooms(side) == OCCUPIED)
    ours = count_change.lower(grid, size=_SIZE, shift=_SHIFT).compile()
    calls = {
        "one count": functools.partial(ours, grid),
        "a count per move": functools.partial(_change_by_move, grid),
    }
    _check_equal(list(calls.values()))
    return KernelRow(
        name=f"count_change {_SIZE}, {side}^3",
        ours="one count",
        candidates=calls,
        count=grid.size,
        unit="voxel",
        bytes_moved=14.0 * grid.size,
        temporary_bytes=_temporary(ours),
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


def _check_equal(calls: list[Callable[[], object]]) -> None:
    """Raise if the results of two calls differ."""
    first = np.asarray(calls[0]())
    for call in calls[1:]:
        np.testing.assert_array_equal(np.asarray(call()), first)


def _temporary(compiled) -> int | None:
    """Bytes of temporary memory of a compiled call, where XLA says."""
    memory = compiled.memory_analysis()
    return None if memory is None else int(memory.temp_size_in_bytes)


def _optional(name: str):
    """A module, or None where it is not installed."""
    try:
        return importlib.import_module(name)
    except ImportError:
        return None
