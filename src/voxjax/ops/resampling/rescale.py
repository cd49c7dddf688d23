"""Change of the resolution of a dense grid, one axis after the other; `rescale_blocks` has that of a grid in blocks."""

import numpy as np
from jaxtyping import Float, Float32, Float64, UInt8

from ..._runtime.memory import check_memory
from .axis_plans import known_log_odds, plan_axis, take_largest, without_mark
from .lattice import check_num_voxels, check_places, origin_in_voxels, origin_of_cell


def rescale_states(
    states: UInt8[np.ndarray, "x y z"],
    origin: Float[np.ndarray, "3"],
    voxel_size: float,
    new_voxel_size: float,
    log_odds: Float32[np.ndarray, "x y z"] | None = None,
) -> tuple[UInt8[np.ndarray, "u v w"], Float64[np.ndarray, "3"], Float32[np.ndarray, "u v w"] | None]:
    """Bring a grid to another voxel size, on the lattice of multiples of the new one.

    Coarser: each voxel goes where its centre lies; a new voxel is occupied if any of its parts is, else free if any is,
    and has the highest log-odds of its known parts. Finer: a new voxel has the state of the voxel that holds its
    centre. Any ratio is fine.

    Args:
        states: 0 unknown, 1 free, 2 occupied.
        origin: Outer corner [m].
        voxel_size: Width of the grid's voxels [m].
        new_voxel_size: Width of the result's voxels [m].
        log_odds: Or None.

    Returns:
        States, origin and log-odds (None if not given) of the result.

    Raises:
        InputError: If the result would have more than 2**31 - 1 voxels, need more memory than there is,
            or lies so far away that float64 cannot place it.
    """
    if not all(states.shape):
        return states, np.asarray(origin, np.float64), log_odds
    base = origin_in_voxels(origin, voxel_size)
    what, advice = "the map at the new voxel size", "choose a larger voxel size"
    ratio = voxel_size / new_voxel_size
    # The result has so many voxels or, along an axis where it begins within one, one more.
    sides = np.maximum(np.floor(np.asarray(states.shape) * ratio), 1.0)
    check_num_voxels(sides, what, advice)
    check_places(np.stack([base, base + states.shape]) * voxel_size, new_voxel_size)
    num_voxels = float(np.prod(sides))
    # Log-odds are made with a mark for unknown voxels, which is replaced in a copy.
    need = num_voxels * (10.0 if log_odds is not None else 1.0)
    check_memory(need, f"{what}, of {num_voxels:.3g} voxels,", advice, on_device=False)
    plans = [plan_axis(base[a], states.shape[a], ratio) for a in range(3)]
    found = take_largest(states, plans)
    odds = None
    if log_odds is not None:
        odds = without_mark(found, take_largest(known_log_odds(states, log_odds), plans))
    return found, origin_of_cell(np.array([plan.low for plan in plans]), new_voxel_size), odds
