"""Sheets of pairs: both maps from above and from the side, how they lie on each other, and a slice through each."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from bench.worlds import MapPair
from voxjax import VoxelGrid
from voxjax._types import FREE, OCCUPIED


def draw_sheet(pair: MapPair, path: Path) -> None:
    """Write a PNG: map a, map b and both, from above and from the side; b lies as the truth says, if there is one."""
    import matplotlib.pyplot as plt

    a, b, low, high, size = _placed(pair)
    # Rows are as high as what they show, within limits.
    shares = np.clip((high - low)[1:] / (high - low)[0], 0.25, 1.5)
    figure, axes = plt.subplots(
        2,
        4,
        figsize=(22, 1.5 + 5.5 * shares.sum()),
        layout="constrained",
        gridspec_kw={"height_ratios": shares},
    )
    for row, view in zip(axes, ((0, 1), (0, 2)), strict=True):
        images = [_seen(points, view, low, high, size) for points in (a, b)]
        extent = tuple(float(end[k]) for k in view for end in (low, high))
        for axis, image, name in zip(row, images, "ab", strict=False):
            axis.imshow(image, origin="lower", extent=extent, cmap="magma")
            axis.set_title(f"map {name}")
        row[2].imshow(_coloured(*images), origin="lower", extent=extent)
        row[2].set_title(f"both; overlap {pair.overlap:.2f}")
    for axis, flat in zip(axes[:, 3], (2, 1), strict=True):
        axis.imshow(_slice(pair.a, flat), origin="lower", cmap="viridis", vmin=0, vmax=OCCUPIED)
        axis.set_title("map a: unknown, free, occupied")
    figure.savefig(path, dpi=55)
    plt.close(figure)


def draw_overview(pairs: Mapping[str, MapPair], path: Path) -> None:
    """Write one PNG of both maps of each pair, a in magenta and b in green, each seen along its shortest side."""
    import matplotlib.pyplot as plt

    columns = 5
    rows = -(-len(pairs) // columns)
    figure, axes = plt.subplots(rows, columns, figsize=(15, 3.2 * rows), layout="constrained", squeeze=False)
    for axis in axes.flat:
        axis.axis("off")
    for axis, (name, pair) in zip(axes.flat, pairs.items(), strict=False):
        a, b, low, high, size = _placed(pair)
        first, second = np.sort(np.argsort(high - low)[1:])
        images = (_seen(points, (int(first), int(second)), low, high, size) for points in (a, b))
        axis.imshow(_coloured(*images), origin="lower")
        axis.set_title(f"{name}, {(high - low)[first]:.0f} x {(high - low)[second]:.0f} m")
    figure.savefig(path, dpi=52, pil_kwargs={"optimize": True})
    plt.close(figure)


def _placed(pair: MapPair) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, float]:
    """Occupied points of both maps in the frame of the first, the box around them, and the wider voxel [m]."""
    T = np.eye(4) if pair.T_a_b is None else pair.T_a_b
    a = pair.a.occupied_points().astype(np.float64)
    b = pair.b.occupied_points().astype(np.float64) @ T[:3, :3].T + T[:3, 3]
    size = max(pair.a.voxel_size, pair.b.voxel_size)
    low = np.minimum(a.min(axis=0), b.min(axis=0)) - size
    return a, b, low, np.maximum(a.max(axis=0), b.max(axis=0)) + size, size


def _seen(
    points: np.ndarray, view: tuple[int, int], low: np.ndarray, high: np.ndarray, size: float
) -> np.ndarray:
    """How many points lie behind each pixel of a view along one axis, as a logarithm."""
    bins = [np.arange(low[k], high[k] + size, size) for k in view]
    return np.log1p(np.histogram2d(points[:, view[0]], points[:, view[1]], bins)[0].T)


def _coloured(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """One picture in magenta and one in green, which are white together."""
    return np.stack([image / max(image.max(), 1e-9) for image in (a, b, a)], axis=-1)


def _slice(grid: VoxelGrid, axis: int) -> np.ndarray:
    """The states of the layer across an axis that has most known free voxels, or most occupied ones."""
    states = np.asarray(grid.states)
    others = tuple(k for k in range(3) if k != axis)
    counts = (states == FREE).sum(axis=others)
    if not counts.any():
        counts = (states == OCCUPIED).sum(axis=others)
    return np.take(states, int(counts.argmax()), axis=axis).T
