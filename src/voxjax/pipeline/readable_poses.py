"""Poses in numbers that a person can read, wherever the frames of the maps lie.

The translation of a pose says where the origin of map b's frame goes. Of a map in the coordinates of a national grid
that is a place millions of metres from the map, and a turn by a degree moves it by a hundred kilometres. What the pose
does to the map is seen at the map's middle.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..frames import image


class ReadablePose(NamedTuple):
    """A pose as a turn about the middle of the map that it moves, and the way that the middle goes.

    Attributes:
        degrees: float64 (3,): roll, pitch and yaw [deg], rotations about the fixed axes x, then y, then z.
        middle: float64 (3,): the map's middle in its own frame [m].
        shift: float64 (3,): from there, read as a place of the other frame, to where the pose puts it [m].
    """

    degrees: Float[np.ndarray, "3"]
    middle: Float[np.ndarray, "3"]
    shift: Float[np.ndarray, "3"]

    def as_dict(self) -> dict[str, list[float]]:
        """Plain data for the report."""
        return {
            "roll_pitch_yaw_degrees": self.degrees.tolist(),
            "middle_b": self.middle.tolist(),
            "middle_shift": self.shift.tolist(),
        }


def readable_pose(T_a_b: Float[np.ndarray, "4 4"], middle: Float[np.ndarray, "3"]) -> ReadablePose:
    """Say what a pose does to a map.

    Args:
        T_a_b: Maps points of frame b into frame a.
        middle: Middle of map b in frame b [m].
    """
    # Near 90 degrees an arcsine of R[2, 0] would lose digits, which the arc tangent keeps.
    R = np.asarray(T_a_b, np.float64)[:3, :3]
    # The angles are those of R = Rz(yaw) Ry(pitch) Rx(roll), read from its first column and its last row.
    roll, yaw = np.arctan2(R[2, 1], R[2, 2]), np.arctan2(R[1, 0], R[0, 0])
    pitch = np.arctan2(-R[2, 0], np.hypot(R[2, 1], R[2, 2]))
    place = np.asarray(middle, np.float64)
    return ReadablePose(np.degrees([roll, pitch, yaw]), place, image(T_a_b, place) - place)


def describe_pose(T_a_b: Float[np.ndarray, "4 4"], middle: Float[np.ndarray, "3"], voxel_size: float) -> str:
    """A pose on one line: translation [m] or, far from the origin of frame b, the way of the middle, then the angles.

    Args:
        T_a_b: Maps points of frame b into frame a.
        middle: Middle of map b in frame b [m].
        voxel_size: Width of the map's voxels [m].
    """
    pose = readable_pose(T_a_b, middle)
    angles = ", ".join(
        f"{name} {angle:z.2f}" for name, angle in zip(("roll", "pitch", "yaw"), pose.degrees, strict=True)
    )
    # Angles are written with two digits. Where those do not place the map to a voxel any more, nobody can make
    # anything of the translation beside them.
    is_far = np.linalg.norm(pose.middle) * np.radians(0.005) > voxel_size
    way = pose.shift if is_far else np.asarray(T_a_b, np.float64)[:3, 3]
    x, y, z = way
    moved = f"x {x:z.3f}, y {y:z.3f}, z {z:z.3f} m"
    if is_far:
        moved = f"its middle ({', '.join(f'{value:z.1f}' for value in pose.middle)}) moves by {moved}"
    return f"{moved}; {angles} deg"
