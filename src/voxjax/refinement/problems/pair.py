"""From two maps to the residuals between them: what host code decides before anything is differentiated."""

from collections.abc import Mapping, Sequence
from typing import get_args

import jax
import jax.numpy as jnp
import numpy as np

from ..._checks import InputError, check_choice
from ..._runtime.placement import to_device
from ...maps.prepared import PreparedMap
from ..residuals.distance import Distances
from ..residuals.losses import Loss
from ..residuals.occupancy import Occupancies
from ..residuals.planes import SLIDE_WEIGHT, PointToPlane, Sample
from ..residuals.terms import Term
from ..solve.problem import PoseProblem
from .parts import Points, Target, centre_of, check_num_points, points_of, target_of
from .views import MapView, as_view


def check_options(loss: str, num_points: int) -> None:
    """Refuse what no refinement can work with.

    Raises:
        InputError: If the loss is not known, or `num_points` is no number of points that a sample can have.
    """
    check_choice("loss", loss, get_args(Loss))
    check_num_points(num_points)


def checked_residuals(residuals: Mapping[str, float] | None) -> dict[str, float]:
    """Kinds of residuals and their weights; None takes planes alone.

    Raises:
        InputError: If there is none, a kind is not known or a weight not positive.
    """
    # A further name needs its term in `_term` below, what the term reads of the two maps in `parts.Target` and
    # `parts.Points`, a field, if it reads one, in `field_tables`, and that field in `joint_tables` for many maps.
    # A term that the caller builds needs none of this: `voxjax.refine(terms=...)` takes it as it is.
    known = ("planes", "distances", "occupancies")
    residuals = {"planes": 1.0} if residuals is None else dict(residuals)
    for kind, weight in residuals.items():
        if kind not in known:
            raise InputError(f"residuals must be among {', '.join(known)}, got {kind!r}.")
        # The rule says what must hold, because NaN compares false with everything.
        if not weight > 0:
            raise InputError(f"residuals must have positive weights, got {weight} for {kind!r}.")
    if not residuals:
        raise InputError(f"residuals must name at least one of {', '.join(known)}, got none.")
    return residuals


def terms_between(
    ways: Sequence[tuple[Target, Points]], residuals: Mapping[str, float], loss: Loss
) -> tuple[Term, ...]:
    """Residuals between two maps: points of b against a, and of a against b if there is a second way.

    Args:
        ways: One or two; each has an equal part of the weights.
        residuals: Kinds and their weights.
        loss: What a large offset costs; of occupancies it is squared.
    """
    return tuple(
        # The first way brings points of b onto a, the second is the inverse.
        _term(kind, target, points, bool(number), share=weight / len(ways), loss=loss)
        for kind, weight in residuals.items()
        for number, (target, points) in enumerate(ways)
    )


def pose_problem(
    a: MapView | PreparedMap,
    b: MapView | PreparedMap,
    *,
    residuals: Mapping[str, float] | None = None,
    num_points: int = 8192,
    loss: Loss = "geman_mcclure",
    both_ways: bool = False,
) -> PoseProblem:
    """Residuals of points of b against map a, and with `both_ways` of points of a against map b as well.

    Args:
        a: The map whose frame the pose maps into.
        b: The map that is moved.
        residuals: Kinds and their weights: "planes" (point to plane), "distances" (truncated distance field),
            "occupancies" (soft agreement of occupied, free and unknown). None: planes alone.
        num_points: Voxels of each sample, chosen by what they rule out.
        loss: What a large offset costs; of occupancies it is squared.
        both_ways: Each way then has half of the weight: the errors of both maps average out, and the maps the other
            way round give the inverse pose.

    Raises:
        InputError: If a kind is not known, a weight not positive, or `num_points` out of its range.
    """
    check_num_points(num_points)
    kinds = checked_residuals(residuals)
    a, b = as_view(a), as_view(b)
    ways = [(target_of(a, kinds), points_of(b, kinds, num_points))]
    if both_ways:
        ways.append((target_of(b, kinds), points_of(a, kinds, num_points)))
    # Map b alone is moved, whatever points meet: its centroid decouples shifts and turns in both ways.
    centroid, radius = centre_of(b, num_points)
    return PoseProblem(terms_between(ways, kinds, loss), centroid, radius)


def _term(kind: str, target: Target, points: Points, is_inverse: bool, *, share: float, loss: Loss) -> Term:
    """Residuals of one kind, one way, of `share` of the weight."""
    if kind == "occupancies":
        assert target.opinions is not None  # the kind was asked for
        assert points.opinions is not None
        # Opinions are of voxel centres, free ones included, and not of the sample on the planes.
        centres, said = points.opinions
        return Occupancies(
            field=target.opinions, sample=_times(centres, share), said=said, is_inverse=is_inverse
        )
    sample = _times(points.sample, share)
    if kind == "distances":
        assert target.distances is not None
        return Distances(target.distances, sample, loss, is_inverse)
    # Sides of a wall are told apart only if both maps know which side is free.
    is_signed = to_device(np.bool_(target.has_free_space and points.has_free_space))
    surface = target.surface._replace(is_signed=is_signed)
    return PointToPlane(surface, sample, np.asarray(SLIDE_WEIGHT, surface.points.dtype), loss, is_inverse)


def _times(sample: Sample, share: float) -> Sample:
    return sample._replace(weights=sample.weights * np.asarray(share, sample.weights.dtype))


def as_dtype(problem: PoseProblem, dtype: type[np.floating]) -> PoseProblem:
    """The problem with its floating arrays in another dtype; float64 needs `jax_enable_x64`."""
    return jax.tree.map(
        lambda x: jnp.asarray(x, dtype) if jnp.issubdtype(x.dtype, jnp.floating) else x, problem
    )
