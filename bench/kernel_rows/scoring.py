"""Poses scored against a map: hits, conflicts and undecided voxels of many hypotheses at once."""

from collections.abc import Iterator

import jax.numpy as jnp
import numpy as np
from scipy.spatial.transform import Rotation

from bench.kernel_row import KernelRow, Target
from bench.kernel_rows.scene import rooms
from voxjax._types import OCCUPIED
from voxjax.ops.evidence.lookup import Block
from voxjax.ops.evidence.nearest import nearest_field, split_keys
from voxjax.ops.evidence.scoring import (
    CONFLICT,
    HIT,
    NEUTRAL,
    NOTHING,
    evidence_codes,
    score_poses,
    surface_evidence,
)

_HIT_SQ, _CLEAR_SQ, _VOXEL = 2, 4, 0.1


def rows(*, quick: bool) -> Iterator[KernelRow]:
    """Rows on one grid of rooms of 128 voxels a side."""
    states = rooms(128)
    index = np.argwhere(states == OCCUPIED).astype(np.int32)
    dims = np.asarray(states.shape, np.int32)
    keys = nearest_field(index, np.ones(len(index), bool), dims, flat_size=states.size, radius=5)
    codes = evidence_codes(states.reshape(-1), keys, _HIT_SQ, _CLEAR_SQ)
    rng = np.random.default_rng(0)
    normals = rng.normal(size=(len(index), 3)).astype(np.float32)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    listed = rng.permutation(len(index))[: 4096 if quick else 16384]
    points = ((index[listed] + 0.5) * _VOXEL).astype(np.float32)
    for count in (64,) if quick else (64, 1024):
        yield _score_row(codes, dims, points, poses_around(count))
    yield _surface_row(codes, keys, dims, normals, points, normals[listed], poses_around(16 if quick else 64))


def poses_around(count: int) -> np.ndarray:
    """Poses float32 (count, 4, 4) around the identity."""
    rng = np.random.default_rng(1)
    poses = np.tile(np.eye(4, dtype=np.float32), (count, 1, 1))
    poses[:, :3, :3] = Rotation.from_rotvec(rng.normal(0, 0.3, (count, 3))).as_matrix()
    poses[:, :3, 3] = rng.normal(0, 2.0, (count, 3))
    return poses


def _look_up(field: np.ndarray, dims: np.ndarray, moved: np.ndarray, outside: int) -> np.ndarray:
    cell = np.floor(moved / np.float32(_VOXEL)).astype(np.int32)
    is_inside = ((cell >= 0) & (cell < dims)).all(axis=1)
    flat = (cell[:, 0] * dims[1] + cell[:, 1]) * dims[2] + cell[:, 2]
    return np.where(is_inside, field[np.where(is_inside, flat, 0)], outside)


def _score_by_numpy(
    codes: np.ndarray, dims: np.ndarray, points: np.ndarray, weights: np.ndarray, poses: np.ndarray
) -> np.ndarray:
    """`score_poses`, one pose after the other."""
    sums = np.zeros((len(poses), 3), np.float32)
    for row, T in enumerate(poses):
        code = _look_up(codes, dims, points @ T[:3, :3].T + T[:3, 3], int(NOTHING))
        sums[row] = [weights[code == kind].sum() for kind in (HIT, CONFLICT, NEUTRAL)]
    return sums


def _score_row(codes: jnp.ndarray, dims: np.ndarray, points: np.ndarray, poses: np.ndarray) -> KernelRow:
    weights = np.full(len(points), 1.0, np.float32)
    block = Block.of(dims, np.zeros(3, np.float32), _VOXEL)
    arrays = [jnp.asarray(a) for a in (points, weights, poses)]
    host = np.asarray(codes)
    ours = np.asarray(score_poses(codes, block, *arrays))
    difference = np.abs(ours - _score_by_numpy(host, dims, points, weights, poses)).sum() / ours.sum()
    assert difference < 1e-3, "scores differ from NumPy's"
    return KernelRow(
        f"score poses, {len(poses)} x {len(points)}",
        "voxjax",
        {
            "voxjax": lambda: score_poses(codes, block, *arrays),
            "NumPy": lambda: _score_by_numpy(host, dims, points, weights, poses),
        },
        len(poses) * len(points),
        "lookup",
        targets=(Target("NumPy", 20.0),),
        note=f"relative difference {difference:.1e}, points on borders of voxels",
    )


def _surface_by_numpy(
    codes: np.ndarray,
    keys: tuple[np.ndarray, np.ndarray],
    dims: np.ndarray,
    surface_normals: np.ndarray,
    points: np.ndarray,
    normals: np.ndarray,
    poses: np.ndarray,
) -> np.ndarray:
    """Sums of `surface_evidence` with weights of 1, one pose after the other."""
    sums = np.zeros((len(poses), 4), np.float32)
    for place, T in enumerate(poses):
        moved = points @ T[:3, :3].T + T[:3, 3]
        code = _look_up(codes, dims, moved, int(NOTHING))
        met = surface_normals[_look_up(keys[0], dims, moved, 0) % len(surface_normals)]
        is_opposed = (code == HIT) & (np.sum(normals @ T[:3, :3].T * met, axis=1) < -0.3)
        kinds = ((code == HIT) & ~is_opposed, code == CONFLICT, code == NEUTRAL, is_opposed)
        # The kernel sums the information of the poses too; here it is computed for the time that it takes alone.
        gain = np.where(kinds[0], np.abs(np.sum(normals @ T[:3, :3].T * met, axis=1)), 0.0)
        _ = (met * gain[:, None]).T @ met
        sums[place] = [np.count_nonzero(kind) for kind in kinds]
    return sums


def _surface_row(
    codes: jnp.ndarray,
    keys: jnp.ndarray,
    dims: np.ndarray,
    surface_normals: np.ndarray,
    points: np.ndarray,
    normals: np.ndarray,
    poses: np.ndarray,
) -> KernelRow:
    block = Block.of(dims, np.zeros(3, np.float32), _VOXEL)
    weights = np.ones(len(points), np.float32)
    arrays = [jnp.asarray(a) for a in (surface_normals, points, normals, weights, poses)]
    host = (np.asarray(codes), tuple(np.asarray(k) for k in split_keys(keys)))
    ours = np.asarray(surface_evidence(codes, keys, block, *arrays, is_signed=True)[0])
    theirs = _surface_by_numpy(*host, dims, surface_normals, points, normals, poses)  # pyright: ignore[reportArgumentType]
    difference = np.abs(ours - theirs).sum() / ours.sum()
    assert difference < 1e-3, "evidence differs from NumPy's"
    return KernelRow(
        f"surface evidence, {len(poses)} x {len(points)}",
        "voxjax",
        {
            "voxjax": lambda: surface_evidence(codes, keys, block, *arrays, is_signed=True),
            "NumPy": lambda: _surface_by_numpy(*host, dims, surface_normals, points, normals, poses),  # pyright: ignore[reportArgumentType]
        },
        len(poses) * len(points),
        "lookup",
        targets=(Target("NumPy", 20.0),),
        note=f"relative difference {difference:.1e}",
    )
