"""Many pairs of maps: features once a map, however many pairs it is in."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

from .._checks import InputError, check_list
from .._runtime.forks import refused_after_fork
from ..grid import VoxelGrid, check_grids
from ..registration.causes.units import far_unit
from ..registration.hypotheses.map_features import MapFeatures
from ..registration.types import Registration
from .config import Config, config_from
from .features import features_at, working_voxel
from .pair import register, register_features
from .units import in_feet


@refused_after_fork
def register_batch(
    pairs: Sequence[tuple[VoxelGrid, VoxelGrid]],
    *,
    config: Config | Mapping[str, Any] | None = None,
    gravity_aligned: bool = False,
    allow_changes: bool = False,
    on_pair: Callable[[int, Registration], None] | None = None,
) -> list[Registration]:
    """Register many pairs of maps; bit for bit what `register` gives for each of them alone.

    The features of a map are computed once for all pairs that compare it at the same voxel size; a map is known by
    its object, so give the same `VoxelGrid` for the same map.

    Args:
        pairs: Maps (a, b) of each pair.
        config: Settings of the stages: a `Config`, nested tables, or None for the defaults.
        gravity_aligned: Whether the z axes of all maps point up, so that only yaw is unknown.
        allow_changes: Whether poses are accepted although things were moved between the maps, see `register`.
        on_pair: Called with the number and the outcome of each pair as it is done.

    Returns:
        A `Registration` for each pair, in the order of the pairs.

    Raises:
        InputError: If an entry is no pair of maps, or a setting cannot be used.
    """
    settings = config_from(config)
    options = {"config": settings, "gravity_aligned": gravity_aligned, "allow_changes": allow_changes}
    pairs = check_list("pairs", pairs, "pairs (a, b) of maps")
    # All pairs are checked before the first is registered: a mistake in the last would cost all the work
    # before.
    for number, pair in enumerate(pairs):
        count = len(check_grids(f"pairs[{number}]", pair))
        if count != 2:
            raise InputError(f"pairs[{number}] must be two VoxelGrid maps (a, b), got {count}.")
    # The key has the voxel size too: a map is compared at the coarser size of each pair, so it may need
    # several.
    known: dict[tuple[int, float], MapFeatures] = {}

    def features_of(grid: VoxelGrid, voxel_size: float) -> MapFeatures:
        # The caller holds the maps as long as this call lasts, so that no other map gets their ids.
        key = id(grid), voxel_size
        if key not in known:
            known[key] = features_at(grid, voxel_size=voxel_size, config=settings)
        return known[key]

    results = []
    for number, (a, b) in enumerate(pairs):
        # `register` has the sentence for empty maps, and for maps in different units; features need voxels.
        if a.num_occupied == 0 or b.num_occupied == 0 or far_unit(a, b) is not None:
            found = register(a, b, **options)
        else:
            voxel = working_voxel([a, b], settings)
            features_a, features_b = (features_of(grid, voxel.size) for grid in (a, b))
            found = register_features(features_a, features_b, **options)
            found = voxel.noted(in_feet(a, b, found, partial(register, **options)))
        results.append(found)
        if on_pair is not None:
            on_pair(number, found)
    return results
