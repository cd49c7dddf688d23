"""`--init-guess`: a pose as numbers on the command line or in a text file."""

import math

import numpy as np
from jaxtyping import Float64

from .._checks import InputError, check_pose, shown
from ..io.files import read_bytes


def parse_guess(text: str) -> Float64[np.ndarray, "4 4"]:
    """Return the pose (4, 4) that `text` gives.

    Args:
        text: 16 numbers row by row, 12 without the last row, 7 as translation and quaternion xyzw, or 8 with
            a time before them (a line of a TUM trajectory); separated by spaces or commas; or the name of a
            file with them.

    Raises:
        InputError: If it is none of these, or not a rigid transform.
    """
    forms = "16 numbers (4x4, row by row), 12 (3x4), or 7 (x y z qx qy qz qw), or a text file that holds them"
    numbers = _numbers(text)
    # What is no list of numbers can only be the name of a file; one named by mistake may be of any length.
    if numbers is None:
        try:
            content = read_bytes(text, most=1 << 20).decode("utf-8", errors="replace")
        except InputError as error:
            raise InputError(f"--init-guess {shown(text)} is no file ({error}); give {forms}.") from error
        # Files of trajectories may hold lines of comment.
        lines = (line.partition("#")[0] for line in content.splitlines())
        numbers = _numbers(" ".join(lines))
        if numbers is None:
            raise InputError(
                f"--init-guess {shown(text)}: the file holds other things than numbers; give {forms}."
            )
    if not all(map(math.isfinite, numbers)):
        raise InputError(f"--init-guess {shown(text)} holds numbers that are not finite; give {forms}.")
    if len(numbers) in (12, 16):
        rows = np.asarray(numbers + ([0.0, 0.0, 0.0, 1.0] if len(numbers) == 12 else [])).reshape(4, 4)
        return check_pose("--init-guess", rows)
    # Of eight numbers the first is the time, so both forms are counted from the end.
    if len(numbers) in (7, 8):
        return check_pose("--init-guess", _pose_of_quaternion(numbers[-7:-4], numbers[-4:]))
    raise InputError(f"--init-guess has {len(numbers)} numbers; give {forms}.")


def _numbers(text: str) -> list[float] | None:
    """The numbers in `text`, or None if it holds anything else or nothing."""
    try:
        return [float(word) for word in text.replace(",", " ").split()] or None
    except ValueError:
        return None


def _pose_of_quaternion(translation: list[float], quaternion: list[float]) -> np.ndarray:
    """Pose (4, 4) of a translation [m] and a quaternion in the order x, y, z, w of any length above 1e-6."""
    length = math.hypot(*quaternion)
    # Quaternions need not have length 1 to the last digit, but one of about 0 has no direction.
    if not 1e-6 <= length < math.inf:
        raise InputError(
            f"--init-guess has a quaternion of length {length:.3g}; give qx qy qz qw of length 1."
        )
    x, y, z, w = (part / length for part in quaternion)
    T = np.eye(4)
    T[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    T[:3, 3] = translation
    return T
