"""Maps in different units of length: named before one of them vanishes in a voxel of the other."""

from collections.abc import Callable, Sequence
from dataclasses import replace

from .._results import RESULTS
from ..grid import VoxelGrid
from ..registration.causes.units import far_unit, feet_between
from ..registration.types import Registration
from .as_registration import nothing_found

Register = Callable[[VoxelGrid, VoxelGrid], Registration]


def in_odd_units(grids: Sequence[VoxelGrid]) -> set[int]:
    """Numbers of the maps that seem to be in another unit than most of the others, far from theirs.

    Args:
        grids: Maps.
    """
    filled = [number for number, grid in enumerate(grids) if grid.num_occupied]

    def is_odd(one: int) -> bool:
        others = [number for number in filled if number != one]
        return 2 * sum(far_unit(grids[one], grids[other]) is not None for other in others) > len(others)

    return {number for number in filled if is_odd(number)}


def in_feet(a: VoxelGrid, b: VoxelGrid, found: Registration, register: Register) -> Registration:
    """The outcome of two maps; where it is none, and one of them may be in feet, with what that explains.

    Args:
        a: First map.
        b: Second map.
        found: Outcome of the maps as they are.
        register: Registers two maps.
    """
    # Another cause was named already.
    if found.accepted or found.result in (RESULTS.mirrored, RESULTS.scaled):
        return found
    unit = feet_between(a, b)
    named = None if unit is None else in_other_unit(a, b, unit, register, found)
    return found if named is None else named


def in_other_unit(
    a: VoxelGrid,
    b: VoxelGrid,
    unit: float,
    register: Register,
    found: Registration | None = None,
) -> Registration | None:
    """The outcome where map b lies in map a once its lengths are in another unit; None where it does not.

    Args:
        a: First map.
        b: Second map.
        unit: What the lengths of map b are multiplied by.
        register: Registers two maps.
        found: Outcome of the maps as they are; None where they were not registered.
    """
    other = register(a, b.placed(scale=unit))
    if not other.accepted:
        return None
    size = f"{1.0 / unit:,.4g} times too large" if unit < 1 else f"{unit:,.4g} times too small"
    reason = (
        f"Map b seems to be {size}, as in another unit of length: with its lengths times {unit:.4g} it lies in map a "
        f"with a score of {other.best_score:.2f}; give it with that scale (convert --scale, read_map(scale=))."
    )
    stats = {"scale": {"scale": unit * other.stats["scale"]["scale"], "scaled_score": other.best_score}}
    if found is None:
        found = nothing_found(reason, RESULTS.scaled, {"seconds": other.stats["seconds"]})
    confidence = min(found.confidence, 1.0 - other.confidence)
    return replace(
        found,
        verdict="ambiguous",
        confidence=confidence,
        reason=reason,
        result=RESULTS.scaled,
        stats=found.stats | stats,
    )
