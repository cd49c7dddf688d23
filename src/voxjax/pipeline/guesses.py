"""What the caller of a registration knows of the pose beforehand."""

import numpy as np

from .._checks import InputError, check_pose, check_positive, shown
from ..registration.hypotheses.map_features import MapFeatures
from ..registration.hypotheses.pose_range import PoseRange


def checked_guess(init_guess: object, uncertainty: tuple[float, float] | None) -> np.ndarray | None:
    """The guess as a rigid transform, None without one.

    Args:
        init_guess: A (4, 4) `T_a_b`, or None.
        uncertainty: Distance [m] and angle [rad] from the guess beyond which poses are left out, or None.

    Raises:
        InputError: If the guess is none, there is an uncertainty without a guess, or it is not two positive numbers.
    """
    guess = None if init_guess is None else check_pose("init_guess", init_guess)
    if uncertainty is None:
        return guess
    if guess is None:
        raise InputError("guess_uncertainty needs an init_guess that it is about; give both or neither.")
    if np.shape(uncertainty) != (2,):
        raise InputError(
            f"guess_uncertainty must be two numbers, metres and radians, got {shown(uncertainty)}."
        )
    for number, unit in enumerate(("metres", "radians")):
        check_positive(f"guess_uncertainty[{number}]", uncertainty[number], unit)
    return guess


def range_around(
    b: MapFeatures,
    max_lean: float | None,
    guess: np.ndarray | None,
    uncertainty: tuple[float, float] | None,
) -> PoseRange:
    """Which poses can be, by what the caller knows beforehand.

    Args:
        b: Second map.
        max_lean: Largest angle by which a pose may tilt the vertical [deg], or None.
        guess: `checked_guess` between the local frames of the features, or None.
        uncertainty: Distance [m] and angle [rad] from the guess, or None.
    """
    # A turn about an origin far from the map would look like a long shift: bounds are about where the map is.
    centroid = np.asarray(b.prepared.centroid)
    if uncertainty is None:
        return PoseRange(centroid, max_lean)
    return PoseRange(centroid, max_lean, guess, *uncertainty)
