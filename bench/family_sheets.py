"""Sheets of pairs: both maps from above and from the side, how they lie on each other, and a slice through each."""

from pathlib import Path

import numpy as np

from bench.worlds import MapPair
from voxjax import VoxelGrid
from voxjax._types import FREE, OCCUPIED


def draw_sheet(pair: MapPair, path: Path) -> None:
    """Write a PNG: map a, map b and both, from above and from the side; b lies as the truth says, if there is one."""
    import matplotlib.pyplot as plt

    T = np.eye(4) if pair.T_a_b is None else pair.T_a_b
    a = pair.a.occupied_points().astype(np.float64)
    b = pair.b.occupied_points().astype(np.float64) @ T[:3, :3].T + T[:3, 3]
    size = max(pair.a.voxel_size, pair.b.voxel_size)
    low = np.minimum(a.min(axis=0), b.min(axis=0)) - size
    high = np.maximum(a.max(axis=0), b.max(axis=0)) + size
    # Rows are as high as what they show, within limits.
    shares = np.clip((high - low)[1:] / (high - low)[0], 0.25, 1.5)
    figure, axes = plt.subplots(
        2,
        4,
        figsize=(22, 1.5 + 5.5 * shares.sum()),
        layout="constrained",
        gridspec_kw={"height_ratios": shares},
    )
    for row, (u, v) in zip(axes, ((0, 1), (0, 2)), strict=True):
        bins = [np.arange(low[k], high[k] + size, size) for k in (u, v)]
        images = [np.log1p(np.histogram2d(p[:, u], p[:, v], bins)[0].T) for p in (a, b)]
        extent = (low[u], bins[0][-1], low[v], bins[1][-1])
        for axis, image, name in zip(row, images, "ab", strict=False):
            axis.imshow(image, origin="lower", extent=extent, cmap="magma")
            axis.set_title(f"map {name}")
        both = np.stack(
            [image / max(image.max(), 1e-9) for image in (images[0], images[1], images[0])], axis=-1
        )
        row[2].imshow(both, origin="lower", extent=extent)
        row[2].set_title(f"both; overlap {pair.overlap:.2f}")
    for axis, flat in zip(axes[:, 3], (2, 1), strict=True):
        axis.imshow(_slice(pair.a, flat), origin="lower", cmap="viridis", vmin=0, vmax=OCCUPIED)
        axis.set_title("map a: unknown, free, occupied")
    figure.savefig(path, dpi=55)
    plt.close(figure)


def _slice(grid: VoxelGrid, axis: int) -> np.ndarray:
    """The states of the layer across an axis that has most known free voxels, or most occupied ones."""
    states = np.asarray(grid.states)
    others = tuple(k for k in range(3) if k != axis)
    counts = (states == FREE).sum(axis=others)
    if not counts.any():
        counts = (states == OCCUPIED).sum(axis=others)
    return np.take(states, int(counts.argmax()), axis=axis).T
