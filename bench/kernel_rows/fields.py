"""Dense fields: distance to the nearest occupied voxel, and grids resampled under a rigid motion."""

from collections.abc import Callable, Iterator

import jax.numpy as jnp
import numpy as np
from scipy import ndimage
from scipy.spatial.transform import Rotation

from bench.kernel_row import KernelRow, Target
from bench.kernel_rows.scene import rooms
from voxjax._types import OCCUPIED
from voxjax.ops.distance import _distance_field, distance_field
from voxjax.ops.resampling.interpolate import resample_nearest, resample_trilinear

try:
    import edt  # a reference only: its licence is the LGPL
except ImportError:
    edt = None


def rows(*, quick: bool) -> Iterator[KernelRow]:
    """Rows on one grid of rooms, 128 or 256 voxels a side."""
    side = 128 if quick else 256
    states = rooms(side)
    yield _distance_row(states == OCCUPIED, 8)
    yield _nearest_row(states)
    yield _trilinear_row(states)


def _distance_row(occupied: np.ndarray, radius: int) -> KernelRow:
    device = jnp.asarray(occupied)
    field = distance_field(device, radius=radius, voxel_size=1.0)
    candidates: dict[str, Callable[[], object]] = {
        "voxjax": lambda: distance_field(device, radius=radius, voxel_size=1.0)
    }
    note = "with the nearest voxel; "
    if edt is None:
        note += "the package edt is not installed"
        exact = np.asarray(ndimage.distance_transform_edt(~occupied))
        candidates["scipy"] = lambda: ndimage.distance_transform_edt(~occupied)
    else:
        transform = edt.edt
        exact = transform(~occupied, parallel=2)
        candidates |= {f"edt, {n} thread": lambda n=n: transform(~occupied, parallel=n) for n in (1, 2)}
        note += "edt gives no index"
    np.testing.assert_allclose(field.distance, np.minimum(exact, radius), rtol=1e-6)
    compiled = _distance_field.lower(device, jnp.float32(1.0), radius=radius).compile().memory_analysis()
    return KernelRow(
        f"distance field {radius}, {occupied.shape[0]}^3",
        "voxjax",
        candidates,
        occupied.size,
        "voxel",
        bytes_moved=9.0 * occupied.size,
        targets=() if edt is None else tuple(Target(f"edt, {n} thread", 3.0) for n in (1, 2)),
        temporary_bytes=None if compiled is None else compiled.temp_size_in_bytes,
        max_temporary=6.0,
        note=note,
    )


def _motion(side: int) -> np.ndarray:
    """Affine map (3, 4) from target to source coordinates that turns about the grid's middle."""
    turn = Rotation.from_euler("xyz", (0.1, -0.2, 0.5)).as_matrix()
    middle = np.full(3, side / 2)
    return np.concatenate([turn, (middle - turn @ middle + 0.3)[:, None]], axis=1).astype(np.float32)


def _reference(values: np.ndarray, affine: np.ndarray, order: int) -> np.ndarray:
    """SciPy's resampling; it counts from the first centre, voxjax from the outer corner."""
    offset = affine[:, :3] @ np.full(3, 0.5) + affine[:, 3] - 0.5
    matrix = np.concatenate([affine[:, :3], offset[:, None]], axis=1)
    return ndimage.affine_transform(values, matrix, order=order, mode="grid-constant", prefilter=False)


def _nearest_row(states: np.ndarray) -> KernelRow:
    affine = _motion(states.shape[0])
    device, matrix = jnp.asarray(states), jnp.asarray(affine)
    ours = np.asarray(resample_nearest(device, matrix, target_shape=states.shape))
    share = np.mean(ours != _reference(states, affine, 0))
    assert share < 2e-3, "states differ from SciPy's"
    return KernelRow(
        f"resample states, {states.shape[0]}^3",
        "voxjax",
        {
            "voxjax": lambda: resample_nearest(device, matrix, target_shape=states.shape),
            "scipy affine_transform 0": lambda: _reference(states, affine, 0),
        },
        states.size,
        "voxel",
        bytes_moved=2.0 * states.size,
        targets=(Target("scipy affine_transform 0", 5.0),),
        note=f"{share:.1e} of the voxels differ, their centres lie on borders",
    )


def _trilinear_row(states: np.ndarray) -> KernelRow:
    affine = _motion(states.shape[0])
    log_odds = np.random.default_rng(0).normal(size=states.shape).astype(np.float32)
    device, matrix = jnp.asarray(log_odds), jnp.asarray(affine)
    ours = resample_trilinear(device, matrix, target_shape=states.shape)
    np.testing.assert_allclose(ours, _reference(log_odds, affine, 1), atol=1e-3)
    return KernelRow(
        f"resample log-odds, {states.shape[0]}^3",
        "voxjax",
        {
            "voxjax": lambda: resample_trilinear(device, matrix, target_shape=states.shape),
            "scipy affine_transform 1": lambda: _reference(log_odds, affine, 1),
        },
        states.size,
        "voxel",
        bytes_moved=8.0 * states.size,
        targets=(Target("scipy affine_transform 1", 5.0),),
        note="white noise, equal within 1e-3",
    )
