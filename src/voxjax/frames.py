"""Poses between frames that are shifted: how maps far from the origin of their frame meet kernels of float32.

Origins of maps and poses are float64 on the host. Kernels compute in float32, which places the voxels of a map well
that lies around zero, and loses them in the coordinates of a national grid. So each map goes to the kernels in a local
frame, whose origin lies at the map's middle, and the pose that they find comes back to the maps' own frames in float64.
A map far out then gives the very numbers that it gives near zero.
"""

import numpy as np
from jaxtyping import Float

from ._checks import InputError, shown
from .rigid import nearest_rotation

STEPS_PER_VOXEL = 1 << 16
"""Parts of a voxel to which places are told apart in local frames: rounding of float64 far out is below them."""


def to_local(
    T_a_b: Float[np.ndarray, "*batch 4 4"],
    origin_a: Float[np.ndarray, "3"],
    origin_b: Float[np.ndarray, "3"],
) -> Float[np.ndarray, "*batch 4 4"]:
    """A pose between two maps' frames as the pose between their local frames, float64.

    Args:
        T_a_b: Maps points of frame b into frame a.
        origin_a: Origin of a's local frame, in frame a [m].
        origin_b: Origin of b's local frame, in frame b [m].

    Raises:
        InputError: If one of them holds NaN or infinite numbers.
    """
    _check_finite(T_a_b=T_a_b, origin_a=origin_a, origin_b=origin_b)
    local = np.array(T_a_b, np.float64)
    # The origin of b's local frame goes where the pose puts it, whatever digits its rotation has.
    local[..., :3, 3] += local[..., :3, :3] @ np.asarray(origin_b, np.float64)
    local[..., :3, 3] -= np.asarray(origin_a, np.float64)
    return local


def from_local(
    T_a_b: Float[np.ndarray, "*batch 4 4"],
    origin_a: Float[np.ndarray, "3"],
    origin_b: Float[np.ndarray, "3"],
) -> Float[np.ndarray, "*batch 4 4"]:
    """A pose between local frames as the pose between the maps' own frames, float64; undoes `to_local`.

    The rotation becomes orthonormal to the digits of float64: what float32 leaves of it, 1e-7, is a decimetre at a
    coordinate of a million metres, and a pose that is inverted by transposing it must not keep that.

    Raises:
        InputError: As in `to_local`.
    """
    _check_finite(T_a_b=T_a_b, origin_a=origin_a, origin_b=origin_b)
    own = np.array(T_a_b, np.float64)
    own[..., :3, :3] = nearest_rotation(own[..., :3, :3])
    own[..., :3, 3] -= own[..., :3, :3] @ np.asarray(origin_b, np.float64)
    own[..., :3, 3] += np.asarray(origin_a, np.float64)
    return own


def _check_finite(**values: np.ndarray) -> None:
    """Refuse poses and places that are none: what is nearest to them has no answer.

    Raises:
        InputError: If one is not finite.
    """
    for name, value in values.items():
        if not np.isfinite(value).all():
            raise InputError(f"{name} must be finite numbers, got {shown(np.asarray(value).tolist())}.")


def image(T: Float[np.ndarray, "4 4"], point: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    """Where a pose puts a point [m], float64."""
    matrix = np.asarray(T, np.float64)
    return matrix[:3, :3] @ point + matrix[:3, 3]


def snapped(T: Float[np.ndarray, "4 4"], voxel_size: float) -> Float[np.ndarray, "4 4"]:
    """A pose between local frames with its translation in whole parts of a voxel, see `STEPS_PER_VOXEL`.

    A lookup of nearest voxels goes one way or the other at a border. Rounded so, the same maps in another frame get the
    same voxels, to the bit.
    """
    result, step = np.array(T, np.float64), voxel_size / STEPS_PER_VOXEL
    result[:3, 3] = np.rint(result[:3, 3] / step) * step
    return result


def float32_step(farthest: float) -> float:
    """Distance of neighbouring numbers of float32 so far from zero [m]; infinite for NaN."""
    # Beyond what float32 holds there is no step either; 1e30 m is larger than any that matters.
    return float(np.spacing(np.float32(min(farthest, 1e30)))) if farthest == farthest else np.inf


def float32_tells(farthest: float, voxel_size: float) -> bool:
    """Whether float32 moves no place up to so far from zero [m] by more than a hundredth of a voxel."""
    # A place is rounded by half of a step at most.
    return float32_step(farthest) <= voxel_size / 50.0


def check_near(
    what: str, low: Float[np.ndarray, "3"], high: Float[np.ndarray, "3"], voxel_size: float, advice: str
) -> None:
    """Refuse a box [m] in which float32 does not tell hundredths of a voxel apart.

    Args:
        what: The subject of the sentence, such as "the map".
        low: Lowest corner of the box.
        high: Highest corner.
        voxel_size: Width of the voxels in the box [m].
        advice: What to do instead; the sentence goes on with the local origin to take.

    Raises:
        InputError: If the box lies too far from the origin of its frame.
    """
    farthest = float(np.abs([low, high]).max())
    if not float32_tells(farthest, voxel_size):
        middle = (np.asarray(low, np.float64) + high) / 2.0
        raise InputError(
            f"{what} with voxels of {voxel_size:g} m reaches {farthest:.4g} m from the origin of its frame, where "
            f"float32 has steps of {float32_step(farthest):.2g} m; {advice}, with the local origin "
            f"{np.round(middle).tolist()}, and poses between such frames (vx.frames.to_local)."
        )
