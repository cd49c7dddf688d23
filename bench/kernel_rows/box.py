"""Rows of the window counts: all implementations against copies, SciPy, NumPy and OpenCV."""

import functools
import importlib
from collections.abc import Callable, Iterator

import jax
import jax.numpy as jnp
import numpy as np
from scipy import ndimage

from bench.kernel_row import KernelRow, Target
from bench.kernel_rows.checks import check_equal, temporary_bytes
from bench.kernel_rows.scene import rooms
from bench.kernel_setting import allocator
from voxjax._types import OCCUPIED
from voxjax.ops.window.box import box_count

_SIZE = 7
_COPY = "numpy widening copy, memory reused"
_CPU_TARGETS = {
    "default": (Target("scipy uniform_filter", 8.0),),
    "tuned": (
        Target(_COPY, 0.2),
        Target("scipy uniform_filter", 40.0),
        Target("opencv boxFilter and running sum", 2.5),
        Target("numpy shifted adds", 4.0),
    ),
}
"""Targets by allocator: with the default one the page faults of fresh arrays hide what a kernel takes."""

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
    # Whole numbers: what is added once is taken off once, and nothing drifts.
    running = planes[:half].sum(axis=0, dtype=np.uint16)
    for x in range(num_planes):
        if x + half < num_planes:
            running += planes[x + half]
        if x - half - 1 >= 0:
            running -= planes[x - half - 1]
        counts[x] = running
    return counts


def _count(side: int, on_gpu: bool, *, has_targets: bool) -> KernelRow:
    """The row of the count: all implementations, and the references that it is held against."""
    host = (rooms(side) == OCCUPIED).astype(np.uint8)
    grid = jnp.asarray(host)
    ours = box_count.lower(grid, size=_SIZE).compile()
    calls: dict[str, Callable[[], object]] = {"box_count": functools.partial(ours, grid)}
    names = ["packed"] + ["pallas"] * on_gpu + ["summed_area"] * (side <= 256)
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
    check_equal(exact)
    targets = _GPU_TARGETS if on_gpu else _CPU_TARGETS[allocator()]
    return KernelRow(
        name=f"box_count {_SIZE}, {side}^3",
        ours="box_count pallas" if on_gpu else "box_count",
        candidates=calls,
        count=host.size,
        unit="voxel",
        bytes_moved=3.0 * host.size,
        targets=tuple(t for t in targets if t.reference in calls) if has_targets else (),
        temporary_bytes=temporary_bytes(ours),
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
    check_equal(list(calls.values()))
    return KernelRow(
        name=f"box_count {size}, {side}^3",
        ours="box_count",
        candidates=calls,
        count=host.size,
        unit="voxel",
        bytes_moved=3.0 * host.size,
        temporary_bytes=temporary_bytes(ours),
        max_temporary=2.0,
    )


def _optional(name: str):
    """A module, or None where it is not installed."""
    try:
        return importlib.import_module(name)
    except ImportError:
        return None
