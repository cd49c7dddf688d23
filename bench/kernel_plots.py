"""Plots of the benchmark of kernels: throughput against the size of a grid, cost against volume at equal surface."""

import re
from collections.abc import Callable, Sequence
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from scipy import ndimage

from bench.kernel_rows.scene import rooms
from bench.plots import prepare_plots as prepare_plots
from bench.timing import time_interleaved
from voxjax._types import OCCUPIED
from voxjax.ops.blocks.compact import occupied_indices
from voxjax.ops.window.box import box_count
from voxjax.ops.window.classes import window_classes


def draw(folder: Path, results: Sequence[dict], *, largest: int) -> list[Path]:
    """Write throughput.png, measured here from 16 cubed up to `largest` cubed, and surface.png where its rows ran."""
    folder.mkdir(parents=True, exist_ok=True)
    sides = [side for side in (16, 32, 64, 128, 256, 512, 1024) if side <= largest]
    paths = [folder / "throughput.png"]
    _draw(paths[0], throughput(sides), "edge of the grid [voxel]", "throughput [voxel/s]")
    surface = constant_surface(results)
    if surface:
        paths.append(folder / "surface.png")
        _draw(paths[1], surface, "volume [voxel]", "time, surface unchanged [s]")
    return paths


def throughput(sides: Sequence[int]) -> dict[str, list[tuple[float, float]]]:
    """Points (edge, voxels per second) of each kernel."""
    curves: dict[str, list[tuple[float, float]]] = {}
    for side in sides:
        for timing in time_interleaved(_kernels(side), rounds=5):
            curves.setdefault(timing.name, []).append((side, side**3 / timing.median_s))
    return curves


def constant_surface(results: Sequence[dict]) -> dict[str, list[tuple[float, float]]]:
    """Points (volume, seconds) of each candidate of the rows of constant surface."""
    curves: dict[str, list[tuple[float, float]]] = {}
    surface_row = re.compile(r"^box_count 7 at constant surface, (\d+)x(\d+)x(\d+)$")
    for result in results:
        shape = surface_row.match(result["name"])
        if shape is None:
            continue
        volume = float(np.prod([int(n) for n in shape.groups()]))
        for name, time in result["times"].items():
            curves.setdefault(name, []).append((volume, time["median_s"]))
    return {name: sorted(points) for name, points in curves.items()}


def _kernels(side: int) -> dict[str, Callable[[], object]]:
    """Calls at one size; SciPy only where it does not take seconds."""
    host = rooms(side) == OCCUPIED
    grid, num_rows = jnp.asarray(host, jnp.uint8), int(np.count_nonzero(host)) + 1
    widen = jax.jit(lambda x: x.astype(jnp.uint16))
    calls: dict[str, Callable[[], object]] = {
        "widening copy": lambda: widen(grid),
        "box_count": lambda: box_count(grid),
        "window_classes": lambda: window_classes(grid, np.int32(20)),
        "occupied_indices": lambda: occupied_indices(grid, size=num_rows),
    }
    if side <= 256:
        wide = host.astype(np.float32)
        calls["scipy uniform_filter"] = lambda: ndimage.uniform_filter(wide, 7, mode="constant")
    return calls


def _draw(path: Path, curves: dict[str, list[tuple[float, float]]], x: str, y: str) -> None:
    """One line a name, both axes logarithmic."""
    import matplotlib.pyplot as plt
    from matplotlib.ticker import NullLocator

    figure, axes = plt.subplots(figsize=(7, 4.5), layout="constrained")
    for name, points in curves.items():
        axes.plot(*np.transpose(points), marker="o", label=name)
    axes.set(xscale="log", yscale="log", xlabel=x, ylabel=y)
    measured = sorted({size for points in curves.values() for size, _ in points})
    axes.set_xticks(measured, [f"{size:,.0f}" for size in measured])
    axes.xaxis.set_minor_locator(NullLocator())
    axes.grid(alpha=0.3, which="both")
    axes.legend()
    figure.savefig(path, dpi=120)
    plt.close(figure)
