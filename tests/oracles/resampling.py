"""Rigid resampling and change of resolution, one voxel after the other in float64."""

import math

import numpy as np


def nearest(
    states: np.ndarray, origin: np.ndarray, size: float, T: np.ndarray, low: np.ndarray, shape: tuple
) -> np.ndarray:
    """Values of the source voxels that hold the centres of the target voxels, moved back."""
    target = np.zeros(shape, states.dtype)
    back = np.linalg.inv(T.astype(np.float64))
    for index in np.ndindex(*shape):
        point = np.append((np.array(index) + low + 0.5) * size, 1.0)
        source = np.floor(((back @ point)[:3] - origin) / size + 1e-3).astype(int)
        if all(0 <= s < n for s, n in zip(source, states.shape, strict=True)):
            target[index] = states[tuple(source)]
    return target


def trilinear(values: np.ndarray, affine: np.ndarray, shape: tuple) -> np.ndarray:
    """Linear between centres, zero outside; `affine` (3, 4) maps target to source coordinates."""
    target = np.zeros(shape)
    for index in np.ndindex(*shape):
        at = affine.astype(np.float64) @ np.append(np.array(index) + 0.5, 1.0) - 0.5
        for corner in np.ndindex(*values.shape):
            weights = [max(0.0, 1.0 - abs(at[a] - corner[a])) for a in range(3)]
            target[index] += values[corner] * math.prod(weights)
    return target


def coarser(states: np.ndarray, low: np.ndarray, ratio: float) -> dict:
    """{new cell: state}: voxel `low + index` goes where its centre lies; `ratio` is old size / new size."""
    cells: dict = {}
    for index, state in np.ndenumerate(states):
        cell = tuple(math.floor((low[a] + index[a] + 0.5) * ratio + 1e-6) for a in range(3))
        cells.setdefault(cell, []).append(int(state))
    return {cell: 2 if 2 in parts else 1 if 1 in parts else 0 for cell, parts in cells.items()}
