"""Whether a map as leaves has room as a dense grid; where it has none, one sentence says what would help."""

import math

from .._checks import InputError
from .._types import OCCUPIED
from .budget import Budget
from .leaf_strays import split_leaves, stray_bytes
from .leaves import LeafMap
from .paint import canvas_for


def check_fit(leaves: LeafMap, budget: Budget, voxel_size: float) -> None:
    """Raise if a grid is larger than it may be.

    Args:
        leaves: The map, not empty.
        budget: What reading its file may take.
        voxel_size: Width of the grid's voxels [m].

    Raises:
        InputError: If the grid has more voxels or takes more memory than the budget has.
    """
    shape = _shape_at(leaves, voxel_size)
    excess = _excess(leaves, budget, shape)
    if excess is None:
        return
    size = " x ".join(map(str, shape))
    num_occupied = leaves.count(OCCUPIED)
    box = f"the map of {size} voxels of {voxel_size:g} m ({num_occupied:,} occupied in the file)"
    raise InputError(f"{box} {excess}; {', or '.join(_ways_out(leaves, budget, voxel_size, shape))}")


def dense_bytes(leaves: LeafMap, shape: tuple[int, ...]) -> float:
    """Memory of a map as leaves and as a grid [byte]."""
    return leaves.num_bytes + math.prod(shape) * (5.0 if leaves.has_log_odds else 1.0)


def _excess(leaves: LeafMap, budget: Budget, shape: tuple[int, ...]) -> str | None:
    """What is too much about a grid, as the end of a main clause; None if it has room."""
    if math.prod(shape) > budget.most_voxels:
        return f"has more than the limit of {budget.most_voxels:,} voxels"
    return budget.excess(dense_bytes(leaves, shape))


def _ways_out(leaves: LeafMap, budget: Budget, voxel_size: float, shape: tuple[int, ...]) -> list[str]:
    """What a user can do to have a map that is too large, the best first."""
    ways = []
    # Whoever has no memory to look for isolated pieces has none to drop them either.
    if budget.excess(stray_bytes(leaves)) is None:
        rest, found = split_leaves(leaves)
        rest_shape = _shape_at(rest, voxel_size)
        # A piece beside a box that is large anyway is not what makes it so.
        if len(found.distance) and 2 * math.prod(rest_shape) < math.prod(shape):
            count, size = int(found.num_voxels.sum()), " x ".join(map(str, rest_shape))
            voxels = "1 voxel" if count == 1 else f"{count:,} voxels"
            ways.append(
                f"leave out its isolated pieces ({voxels} up to {found.distance[0]:.4g} m from the rest) "
                f"with drop_isolated=True (--drop-isolated), so that the box is {size}"
            )
    larger = _voxel_size_that_fits(leaves, budget, voxel_size, shape)
    if larger is not None:
        ways.append(f"take voxel_size={larger:g} (--voxel-size {larger:g}), at which it fits")
    ways.append("cut it with crop= (--crop)")
    if math.prod(shape) <= budget.most_voxels:
        ways.append(budget.memory_advice)
    elif budget.max_voxels is not None:
        ways.append("raise max_voxels if there is memory for it")
    return ways


def _voxel_size_that_fits(
    leaves: LeafMap, budget: Budget, voxel_size: float, shape: tuple[int, ...]
) -> float | None:
    """The smallest whole multiple of a voxel size [m] at which a grid has room; None if there is none."""
    if voxel_size < leaves.resolution:
        # Nobody needs voxels finer than those of the file, if these fit.
        voxel_size = leaves.resolution
        shape = leaves.shape
    per_voxel = dense_bytes(leaves, (1,)) - leaves.num_bytes
    room = min((budget.memory()[0] - leaves.num_bytes) / per_voxel, budget.most_voxels)
    if room < 1:
        return None
    # A thin map shrinks by less than the cube of the factor, which is thus found from below.
    factor = max(math.ceil((math.prod(shape) / room) ** (1 / 3)), 1)
    while _excess(leaves, budget, _shape_at(leaves, factor * voxel_size)) is not None:
        factor += 1
    return factor * voxel_size


def _shape_at(leaves: LeafMap, voxel_size: float) -> tuple[int, ...]:
    """Number of voxels along x, y, z of the grid of a map."""
    if voxel_size < leaves.resolution:
        # A canvas has an entry for each voxel along an axis, of which there may be any number.
        return tuple(math.ceil(count * (leaves.resolution / voxel_size)) for count in leaves.shape)
    return canvas_for(leaves, voxel_size).shape
