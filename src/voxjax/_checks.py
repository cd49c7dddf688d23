"""Argument checks that raise one sentence: the argument, the rule, the value and what to do."""

import math

import numpy as np

LARGEST_LENGTH = 1e12
"""Longest distance [m], and the inverse of the shortest voxel: their cubes are still numbers of float32."""


class InputError(ValueError):
    """An input that voxjax cannot use; the message is one sentence for the person who gave it."""


def shown(value: object) -> str:
    """The value as a message quotes it: on one line, and cut where it is long."""
    try:
        text = " ".join(repr(value).split())
    except (ValueError, RecursionError):  # more digits than Python prints, or lists within lists without end
        return f"a {type(value).__name__} that is too long to show"
    return text if len(text) <= 120 else f"{text[:80]} ... {text[-30:]}"


def check_positive(name: str, value: object, unit: str = "") -> float:
    """Return `value` as a float if it is finite and above zero.

    Raises:
        InputError: If it is not, or a length whose cube float32 cannot hold.
    """
    number = _number(value)
    if not (math.isfinite(number) and number > 0.0):
        raise InputError(
            f"{name} must be a finite number above 0{unit and f' [{unit}]'}, got {shown(value)}."
        )
    if unit == "m" and not 1 / LARGEST_LENGTH <= number <= LARGEST_LENGTH:
        raise InputError(
            f"{name} must lie between {1 / LARGEST_LENGTH:g} and {LARGEST_LENGTH:g} m, got {shown(value)}."
        )
    return number


def check_voxel_size(value: object, name: str = "voxel_size") -> float:
    """Return the edge length of a voxel [m] as a float.

    Raises:
        InputError: As in `check_positive`.
    """
    return check_positive(name, value, "m")


def check_count(name: str, value: object, least: int = 0) -> int:
    """Return `value` if it is a whole number, `least` or more.

    Raises:
        InputError: If it is not.
    """
    number = _number(value)
    if not (math.isfinite(number) and number >= least and number % 1 == 0):
        raise InputError(f"{name} must be a whole number, {least} or more, got {shown(value)}.")
    return int(number)


def check_whole(name: str, value: object, least: int, most: int) -> int:
    """Return `value` if it is a whole number within limits.

    Raises:
        InputError: If it is not.
    """
    number = _number(value)
    if not (least <= number <= most and number % 1 == 0):
        raise InputError(f"{name} must be a whole number from {least} to {most}, got {shown(value)}.")
    return int(number)


def check_three_axes(name: str, shape: tuple[int, ...]) -> None:
    """Raise if an array is no grid.

    Raises:
        InputError: If its shape has not three axes.
    """
    if len(shape) != 3:
        raise InputError(f"{name} must have three axes (x, y, z), got shape {tuple(shape)}.")


def check_odd_window(name: str, size: object) -> int:
    """Return `size` if it is an odd number of voxels, at least 1.

    Raises:
        InputError: If it is not.
    """
    number = _number(size)
    if not (math.isfinite(number) and number >= 1 and number % 2 == 1):
        raise InputError(f"{name} must be an odd whole number of voxels, 1 or more, got {shown(size)}.")
    return int(number)


def check_choice(name: str, value: object, choices: tuple[str, ...]) -> None:
    """Raise if `value` is none of `choices`.

    Raises:
        InputError: If it is not one of them.
    """
    if not isinstance(value, str) or value not in choices:
        raise InputError(f"{name} must be one of {', '.join(map(repr, choices))}, got {shown(value)}.")


def check_type(name: str, value: object, kind: type, advice: str) -> None:
    """Raise if `value` is not of a class of voxjax.

    Args:
        name: Name of the argument.
        value: What was given.
        kind: The class.
        advice: Where such an object comes from.

    Raises:
        InputError: If it is something else.
    """
    if not isinstance(value, kind):
        raise InputError(f"{name} must be a {kind.__name__}, got {shown(value)}; {advice}.")


def check_list(name: str, values: object, holds: str) -> list:
    """Return `values` as a list; a single thing, a text or a name of a file is none.

    Args:
        name: Name of the argument.
        values: What was given.
        holds: What the list holds, in the plural.

    Raises:
        InputError: If it is no list, tuple, array or other thing to go through.
    """
    try:
        if not isinstance(values, (str, bytes)):
            return list(values)  # pyright: ignore[reportArgumentType, reportCallIssue]
    except TypeError as error:
        raise _no_list(name, values, holds) from error
    raise _no_list(name, values, holds)


def _no_list(name: str, values: object, holds: str) -> InputError:
    return InputError(f"{name} must be a list of {holds}, got {shown(values)}; put one alone into a list.")


def check_pose(name: str, T: object) -> np.ndarray:
    """Return `T`, on host or device, as a float64 (4, 4) rigid transform.

    Raises:
        InputError: If the shape, the last row or the rotation is wrong, or it moves farther than float32 can square.
    """
    try:
        matrix = as_float64(T)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} must be a (4, 4) matrix of numbers, got {shown(T)}.") from error
    if matrix.shape != (4, 4):
        raise InputError(f"{name} must be a (4, 4) matrix, got shape {matrix.shape}.")
    rotation = matrix[:3, :3]
    rigid = (
        np.isfinite(matrix).all()
        and np.abs(rotation).max() < 2.0  # larger entries are no rotation's, and their products may overflow
        and np.allclose(matrix[3], (0.0, 0.0, 0.0, 1.0), atol=1e-6)
        and np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-3)
        and np.linalg.det(rotation) > 0.0
    )
    if not rigid:
        raise InputError(
            f"{name} must be a rigid transform (rotation, translation, last row 0 0 0 1), got {matrix.tolist()}."
        )
    if np.abs(matrix[:3, 3]).max() > LARGEST_LENGTH:
        raise InputError(
            f"{name} must move by less than {LARGEST_LENGTH:g} m along each axis, got {matrix[:3, 3].tolist()}."
        )
    return matrix


def as_float64(value: object) -> np.ndarray:
    """Real numbers, on host or device, as a float64 array.

    Raises:
        TypeError: If they are complex, of which NumPy would drop a part, or no numbers.
        ValueError: If they are no numbers, or rows of several lengths.
    """
    array = np.asarray(value)
    if array.dtype.kind == "c":
        raise TypeError("complex numbers are no places")
    return array.astype(np.float64)


def _number(value: object) -> float:
    """The value as a float; NaN where it is no single number. A truth value counts as none: it is a mistake."""
    if isinstance(value, (str, bytes, bool, np.bool_, complex, np.complexfloating)):
        return math.nan
    try:
        return float(value)  # pyright: ignore[reportArgumentType]
    except (TypeError, ValueError, OverflowError):
        return math.nan
