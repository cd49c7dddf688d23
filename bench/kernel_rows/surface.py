"""Kernels on lists of surface voxels: moments and normals, eigenvectors, components."""

from collections.abc import Callable, Iterator

import jax
import jax.numpy as jnp
import numpy as np
from scipy import ndimage
from scipy.sparse import coo_array, csgraph

from bench.kernel_row import KernelRow, Target
from bench.kernel_rows.scene import rooms
from voxjax._runtime.buckets import bucket_size, pad_rows
from voxjax._types import OCCUPIED
from voxjax.ops.components import Regions, connected_components, grow_regions, label_voxels, padded_size
from voxjax.ops.eigen import eigen_by_columns, symmetric_eigen
from voxjax.ops.surface.moments import surface_moments

try:
    import open3d
except ImportError:
    open3d = None


def rows(*, quick: bool) -> Iterator[KernelRow]:
    """Rows on one grid of rooms, 128 or 256 voxels a side."""
    side = 128 if quick else 256
    states = rooms(side)
    for size in (5, 7):
        yield _moments_row(states, size)
    yield _eigen_row(20_000 if quick else 200_000)
    for connectivity in (6, 18, 26):
        yield _components_row(states == OCCUPIED, connectivity)
    yield _regions_row(states)


def _moments_row(states: np.ndarray, size: int) -> KernelRow:
    index = np.argwhere(states == OCCUPIED).astype(np.int32)
    candidates: dict[str, Callable[[], object]] = {
        "voxjax": lambda: surface_moments(states, index, size=size)
    }
    normal = np.asarray(surface_moments(states, index, size=size).normal)
    note = "normals, curvature, free sides; "
    if open3d is None:
        note += "Open3D is not installed"
    else:
        cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(index.astype(np.float64)))
        nearest = open3d.geometry.KDTreeSearchParamKNN(30)
        candidates["Open3D KNN 30"] = lambda: cloud.estimate_normals(nearest)
        cloud.estimate_normals(nearest)
        agreement = np.abs(np.sum(np.asarray(cloud.normals) * normal, axis=1))
        note += f"median angle to Open3D's other window {np.degrees(np.arccos(np.median(agreement))):.1f} deg"
        assert np.median(agreement) > np.cos(np.radians(10)), "normals differ from Open3D's"
    return KernelRow(
        f"surface moments {size}, {states.shape[0]}^3",
        "voxjax",
        candidates,
        len(index),
        "voxel",
        targets=(Target("Open3D KNN 30", 10.0),) if open3d is not None else (),
        max_ns=250.0,
        note=note,
    )


def _eigen_row(count: int) -> KernelRow:
    rng = np.random.default_rng(0)
    turns = np.linalg.qr(rng.normal(size=(count, 3, 3)))[0]
    values = np.stack([rng.uniform(0, 0.05, count), rng.uniform(1, 2, count), rng.uniform(2, 4, count)], 1)
    matrices = jnp.asarray(np.einsum("nij,nj,nkj->nik", turns, values, turns), jnp.float32)
    eigh = jax.jit(jnp.linalg.eigh)
    columns = jnp.stack([matrices[:, i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))])
    by_columns = jax.jit(eigen_by_columns)
    ours, theirs = np.asarray(by_columns(columns).vectors)[0].T, np.asarray(eigh(matrices)[1])[:, :, 0]
    sine = np.linalg.norm(np.cross(ours, theirs), axis=1)
    assert np.degrees(np.arcsin(sine.max())) < 0.1, "normals differ by 0.1 degrees or more"
    return KernelRow(
        f"eigenvectors 3x3, {count}",
        "voxjax",
        {
            "voxjax": lambda: by_columns(columns),
            "voxjax, matrices": lambda: symmetric_eigen(matrices),
            "jnp.linalg.eigh": lambda: eigh(matrices),
            "np.linalg.eigh": lambda: np.linalg.eigh(np.asarray(matrices)),
        },
        count,
        "matrix",
        targets=(Target("jnp.linalg.eigh", 5.0),),
        note=f"covariances of planes; normals within {np.degrees(sine.max()):.3f} deg",
    )


def _components_row(occupied: np.ndarray, connectivity: int) -> KernelRow:
    structure = ndimage.generate_binary_structure(3, {6: 1, 18: 2, 26: 3}[connectivity])
    flat = np.flatnonzero(occupied)
    index = np.stack(np.unravel_index(flat, occupied.shape), axis=1).astype(np.int32)
    size = bucket_size(len(index), 1 << 12)
    mask, dims = np.arange(size) < len(index), np.asarray(occupied.shape, np.int32)
    listed = [jnp.asarray(a) for a in (pad_rows(index, size), mask, dims)]
    flat_size = padded_size(occupied.shape)

    def run(implementation: str | None) -> object:
        return connected_components(occupied, connectivity=connectivity, implementation=implementation)

    kernel = label_voxels(*listed, flat_size=flat_size, connectivity=connectivity)
    expected, count = ndimage.label(occupied, structure)  # pyright: ignore[reportGeneralTypeIssues]
    for implementation in ("scipy", "compact"):
        labels, found = connected_components(
            occupied, connectivity=connectivity, implementation=implementation
        )
        assert found == count, "number of components differs from SciPy's"
        assert (labels == expected).all(), "labels differ from SciPy's"
    assert int(kernel.num_regions) == count, "number of components differs from SciPy's"
    return KernelRow(
        f"components {connectivity}, {occupied.shape[0]}^3",
        "voxjax compact",
        {
            "voxjax compact": lambda: run("compact"),
            "voxjax chosen": lambda: run(None),
            "voxjax list": lambda: label_voxels(*listed, flat_size=flat_size, connectivity=connectivity),
            "scipy label": lambda: ndimage.label(occupied, structure),
        },
        len(index),
        "voxel",
        targets=(Target("scipy label", 1 / 3),),
        note=f"{count} components in {int(kernel.num_rounds)} rounds; labels equal SciPy's; per occupied voxel",
    )


def _regions_row(states: np.ndarray, degrees: float = 10.0) -> KernelRow:
    index = np.argwhere(states == OCCUPIED).astype(np.int32)
    size = bucket_size(len(index), 1 << 12)
    padded, mask = jnp.asarray(pad_rows(index, size)), jnp.asarray(np.arange(size) < len(index))
    normal = jnp.asarray(surface_moments(states, np.asarray(padded)).normal)
    dims, flat_size = jnp.asarray(states.shape, jnp.int32), padded_size(states.shape)
    least = np.float32(np.cos(np.radians(degrees)))

    def ours() -> Regions:
        return grow_regions(padded, mask, normal, dims, least, flat_size=flat_size)

    host_normal = np.asarray(normal)[: len(index)]
    regions = ours()
    count, labels = _regions_by_scipy(states == OCCUPIED, index, host_normal, least)
    assert int(regions.num_regions) == count, "number of regions differs from SciPy's"
    # Both number regions by their first voxel, once SciPy's labels are renamed so.
    _, first, of_row = np.unique(labels, return_index=True, return_inverse=True)
    renamed = np.argsort(np.argsort(first))[of_row] + 1
    assert (np.asarray(regions.label)[: len(index)] == renamed).all(), "regions differ from SciPy's"
    return KernelRow(
        f"regions by normals, {states.shape[0]}^3",
        "voxjax",
        {
            "voxjax": ours,
            "scipy connected_components": lambda: _regions_by_scipy(
                states == OCCUPIED, index, host_normal, least
            ),
        },
        len(index),
        "voxel",
        note=f"{count} regions in {int(regions.num_rounds)} rounds at {degrees:g} degrees; the same as SciPy's "
        "components of the graph of touching voxels",
    )


def _regions_by_scipy(
    occupied: np.ndarray, index: np.ndarray, normal: np.ndarray, least: np.float32
) -> tuple[int, np.ndarray]:
    """Regions as components of the graph of touching voxels (26) whose normals' cosine is at least `least`."""
    row_of = np.full(np.add(occupied.shape, 2), -1, np.int32)
    row_of[1:-1, 1:-1, 1:-1][occupied] = np.arange(len(index), dtype=np.int32)
    flat, strides = row_of.reshape(-1), np.asarray(row_of.strides) // row_of.itemsize
    place = (index + 1) @ strides
    x, y, z = normal.T
    ends = []
    for step in np.ndindex(3, 3, 3):
        if step <= (1, 1, 1):  # each pair of neighbours once
            continue
        other = flat[place + (np.asarray(step) - 1) @ strides]
        one = np.flatnonzero(other >= 0)
        other = other[one]
        is_alike = x[one] * x[other] + y[one] * y[other] + z[one] * z[other] >= least
        ends.append(np.stack([one[is_alike], other[is_alike]]))
    i, j = np.concatenate(ends, axis=1)
    graph = coo_array((np.ones(len(i), bool), (i, j)), shape=(len(index), len(index)))
    return csgraph.connected_components(graph, directed=False)
