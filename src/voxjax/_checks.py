"""Argument checks that raise one sentence: the argument, the rule, the value and what to do."""

import math

import numpy as np


class InputError(ValueError):
    """An input that voxjax cannot use; the message is one sentence for the person who gave it."""


def check_positive(name: str, value: float, unit: str = "") -> float:
    """Return `value` as a float if it is finite and above zero.

    Raises:
        InputError: If it is not.
    """
    number = float(value)
    if not (math.isfinite(number) and number > 0.0):
        raise InputError(f"{name} must be a finite number above 0{unit and f' [{unit}]'}, got {value!r}.")
    return number


def check_odd_window(name: str, size: int) -> int:
    """Return `size` if it is an odd number of voxels, at least 1.

    Raises:
        InputError: If it is not.
    """
    if isinstance(size, bool) or int(size) != size or size < 1 or size % 2 == 0:
        raise InputError(f"{name} must be an odd whole number of voxels, 1 or more, got {size!r}.")
    return int(size)


def check_choice(name: str, value: object, choices: tuple[str, ...]) -> None:
    """Raise if `value` is none of `choices`.

    Raises:
        InputError: If it is not one of them.
    """
    if value not in choices:
        raise InputError(f"{name} must be one of {', '.join(map(repr, choices))}, got {value!r}.")


def check_pose(name: str, T: object) -> np.ndarray:
    """Return `T` as a float32 (4, 4) rigid transform.

    Raises:
        InputError: If the shape, the last row or the rotation is wrong.
    """
    matrix = np.asarray(T, dtype=np.float64)
    if matrix.shape != (4, 4):
        raise InputError(f"{name} must be a (4, 4) matrix, got shape {matrix.shape}.")
    rotation = matrix[:3, :3]
    rigid = (
        np.isfinite(matrix).all()
        and np.allclose(matrix[3], (0.0, 0.0, 0.0, 1.0), atol=1e-6)
        and np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-3)
        and np.linalg.det(rotation) > 0.0
    )
    if not rigid:
        raise InputError(
            f"{name} must be a rigid transform (rotation, translation, last row 0 0 0 1), got {matrix.tolist()}."
        )
    return matrix.astype(np.float32)
