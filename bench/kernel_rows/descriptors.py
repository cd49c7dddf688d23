"""Local descriptors of surface points: histograms of angles, and the mutual nearest of two sets."""

from collections.abc import Callable, Iterator

import numpy as np

from bench.kernel_row import KernelRow, Target
from bench.kernel_rows.scene import rooms
from voxjax._types import OCCUPIED
from voxjax.ops.descriptors.fpfh import point_feature_histograms, surface_normals
from voxjax.ops.descriptors.match import mutual_nearest
from voxjax.ops.descriptors.tiles import near_tiles, point_tree

try:
    import open3d
except ImportError:
    open3d = None


def rows(*, quick: bool) -> Iterator[KernelRow]:
    """Rows on points averaged as `describe_map` does, on the voxels of a part of the grid, and on random rows."""
    states, side = rooms(128 if quick else 256), 64 if quick else 96
    voxels = np.argwhere(states == OCCUPIED).astype(np.float32)
    yield _histograms_row("averaged points", _averaged(voxels, 2.5))
    yield _histograms_row("voxels", voxels[(voxels < side).all(axis=1)])
    yield _matching_row(4000 if quick else 16000)


def _averaged(points: np.ndarray, spacing: float) -> np.ndarray:
    """Mean point of each cell of a lattice, in units of its spacing."""
    index = np.floor(points / spacing).astype(np.int64)
    flat = np.ravel_multi_index(tuple(index.T), tuple(index.max(axis=0) + 1))
    counts = np.bincount(flat)
    means = [np.bincount(flat, column)[counts > 0] / counts[counts > 0] / spacing for column in points.T]
    return np.stack(means, axis=1).astype(np.float32)


def _histograms_row(name: str, points: np.ndarray, radius: float = 5.0, capacity: int = 128) -> KernelRow:
    normals = np.asarray(surface_normals(points, near_tiles(point_tree(points), 3.0), radius=3.0)[0])

    def ours() -> object:
        near = near_tiles(point_tree(points), radius)
        return point_feature_histograms(points, normals, near, radius=radius, spacing=1.0)

    candidates: dict[str, Callable[[], object]] = {"voxjax": ours}
    note = f"radius {radius:g}, all neighbours, search included"
    if open3d is None:
        note += "; Open3D is not installed"
    else:
        registration, geometry = open3d.pipelines.registration, open3d.geometry
        cloud = geometry.PointCloud(open3d.utility.Vector3dVector(points.astype(np.float64)))
        cloud.normals = open3d.utility.Vector3dVector(normals.astype(np.float64))
        ball = geometry.KDTreeSearchParamRadius(radius=radius)
        nearest = geometry.KDTreeSearchParamHybrid(radius=radius, max_nn=capacity)
        candidates["Open3D FPFH"] = lambda: registration.compute_fpfh_feature(cloud, ball)
        candidates[f"Open3D FPFH, nearest {capacity}"] = lambda: registration.compute_fpfh_feature(
            cloud, nearest
        )
        note += "; Open3D's weights and choice of frames differ, so its values do"
    return KernelRow(
        f"descriptors, {len(points)} {name}",
        "voxjax",
        candidates,
        len(points),
        "point",
        targets=(Target("Open3D FPFH", 5.0),) if open3d is not None else (),
        note=note,
    )


def _matching_row(count: int, dimensions: int = 33) -> KernelRow:
    rng = np.random.default_rng(0)
    a, b = (rng.random((count, dimensions)).astype(np.float32) for _ in range(2))
    mask = np.ones(count, bool)
    nearest, is_mutual, _ = mutual_nearest(a, b, mask, mask)
    expected, is_expected = _by_numpy(a, b)
    # Rounding decides between rows that are equally near.
    assert np.mean(nearest == expected) > 0.999, "nearest rows differ from NumPy's"
    assert np.mean(is_mutual == is_expected) > 0.999, "mutual rows differ from NumPy's"
    return KernelRow(
        f"mutual nearest, {count} x {count}",
        "voxjax",
        {"voxjax": lambda: mutual_nearest(a, b, mask, mask), "NumPy": lambda: _by_numpy(a, b)},
        count,
        "row",
        note=f"{dimensions} numbers a row",
    )


def _by_numpy(a: np.ndarray, b: np.ndarray, chunk: int = 512) -> tuple[np.ndarray, np.ndarray]:
    """Nearest row of b, and whether it is mutual, some rows of a at a time."""
    squares_a, squares_b = (np.sum(x * x, axis=1) for x in (a, b))
    nearest, least, row_of_b = np.zeros(len(a), int), np.full(len(b), np.inf), np.zeros(len(b), int)
    for first in range(0, len(a), chunk):
        part = slice(first, first + chunk)
        # One product of matrices for each part, which NumPy does on all cores.
        square = squares_a[part, None] + squares_b - 2 * (a[part] @ b.T)
        nearest[part] = square.argmin(axis=1)
        row = square.argmin(axis=0)
        value = square[row, np.arange(len(b))]
        row_of_b, least = np.where(value < least, row + first, row_of_b), np.minimum(least, value)
    return nearest, row_of_b[nearest] == np.arange(len(a))
