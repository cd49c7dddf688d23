"""The rotations between two maps that several sources of hypotheses search."""

import numpy as np
from jaxtyping import Float32

from .directions import is_free_to_turn
from .kept import kept_of_pair
from .map_features import MapFeatures
from .rotations import rotation_hypotheses
from .settings import RotationConfig


def rotations_of_pair(
    a: MapFeatures, b: MapFeatures, *, max_lean: float | None, max_rotations: int, settings: RotationConfig
) -> Float32[np.ndarray, "k 3 3"]:
    """`rotation_hypotheses` of two maps, float32 (k, 3, 3), best first; found once for each pair.

    Args:
        a: First map.
        b: Second map.
        max_lean: Largest angle by which a rotation may tilt the vertical [deg]; None where it may tilt it at will.
        max_rotations: Largest number of rotations.
        settings: How rotations are found.
    """

    def find() -> Float32[np.ndarray, "k 3 3"]:
        # Signs tell apart rotations under which surfaces face opposite ways; without free space in both maps they mean
        # nothing.
        return rotation_hypotheses(
            a.normals,
            b.normals,
            a.directions,
            b.directions,
            is_signed=a.prepared.has_free_space and b.prepared.has_free_space,
            is_free_to_turn=any(is_free_to_turn(each.directions, each.shares, settings) for each in (a, b)),
            max_lean=max_lean,
            max_rotations=max_rotations,
            settings=settings,
        )[0]

    return kept_of_pair(a, b, ("rotations", max_lean, max_rotations, settings), find)
