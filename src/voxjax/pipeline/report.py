"""The report of a merge as plain data for JSON: fixed keys, finite numbers only."""

import math
from collections.abc import Sequence
from typing import Any

import jax
import numpy as np

from .._runtime.threads import spread
from .._version import __version__
from ..grid import VoxelGrid
from ..maps.findings import Remark
from ..registration.types import Registration
from .merged import Merge
from .readable_poses import readable_pose
from .stage_times import OnStage, Stages


def merge_report(
    merged: Merge,
    grids: Sequence[VoxelGrid],
    paths: Sequence[str],
    *,
    remarks: Sequence[Sequence[Remark]] | None = None,
    seconds: dict[str, float] | None = None,
    on_stage: OnStage | None = None,
) -> dict[str, Any]:
    """Describe a merge.

    Args:
        merged: Outcome of `voxjax.merge`.
        grids: Maps that were merged.
        paths: File that each map came from.
        remarks: What was said of each map when it was read; None for nothing.
        seconds: More stages to list beside those of the merge, such as reading {stage: s}.
        on_stage: Called with the name of a stage where corners have yet to be found for the report, which takes as
            long as a stage of the registration; None where nobody listens.

    Returns:
        Keys "status", "voxjax", "device", "voxel_size", "maps", "pairs", "seconds", and besides them "reason"
        and "loops". Among the seconds, beside the "total" of the merge, are those of "corners" where some had yet to
        be found. Numbers that are not finite become None.
    """
    stages = Stages(on_stage)
    corners = _corner_counts(merged, grids, stages)
    remarks = [()] * len(grids) if remarks is None else remarks
    report = {
        "status": merged.status,
        "voxjax": __version__,
        "device": device_name(),
        # Without a fused map, the size is the one that it would have had.
        "voxel_size": min(grid.voxel_size for grid in grids)
        if merged.grid is None
        else merged.grid.voxel_size,
        "reason": merged.reason,
        "maps": [
            {
                "path": path,
                "T_world_map": None if pose is None else np.asarray(pose).tolist(),
                "num_occupied": grid.num_occupied,
                "num_free": grid.num_free,
                "num_corners": count,
                "remarks": [remark.as_dict() for remark in said],
            }
            for path, pose, grid, count, said in zip(
                paths, merged.poses, grids, corners, remarks, strict=True
            )
        ],
        "pairs": [_pair_report(a, b, registration, merged.middles[b]) for a, b, registration in merged.pairs],
        "loops": [
            {"a": loop.a, "b": loop.b, "metres": loop.metres, "degrees": math.degrees(loop.radians)}
            for loop in merged.loops
        ],
        "seconds": {**(seconds or {}), **merged.seconds, **stages.seconds},
    }
    return finite(report)


def device_name() -> str:
    """The device that the kernels run on, with its count when there are several."""
    devices = jax.devices()
    count = f" x {len(devices)}" if len(devices) > 1 else ""
    return f"{devices[0].platform}: {devices[0].device_kind}{count}"


def finite(value: Any) -> Any:
    """Data with plain Python numbers in place of arrays and scalars, and None for numbers that are not finite."""
    if isinstance(value, dict):
        return {str(key): finite(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [finite(item) for item in value]
    if hasattr(value, "tolist"):  # arrays and scalars of NumPy and JAX
        return finite(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def _pair_report(a: int, b: int, registration: Registration, middle_b: np.ndarray) -> dict[str, Any]:
    """One entry of "pairs"; `middle_b` is the middle of map b in its own frame [m]."""
    stats = registration.stats
    best = registration.hypotheses[0].evidence if registration.hypotheses else None
    return {
        "a": a,
        "b": b,
        "accepted": registration.accepted,
        "verdict": registration.verdict,
        "reason": registration.reason,
        # Rejected pairs have their best pose, too: whoever knows the place can see what was nearly taken.
        "T_a_b": np.asarray(registration.T_a_b).tolist(),
        # A person reads that where frames are far: the translation is that of a point far from the map.
        **readable_pose(np.asarray(registration.T_a_b), middle_b).as_dict(),
        "confidence": registration.confidence,
        "covariance": np.asarray(registration.covariance).tolist(),
        "num_associations": stats.get("num_associations", 0),
        "clique_size": stats.get("clique_size", 0),
        "occupied_agreement": best.occupied_agreement if best else 0.0,
        "free_conflict": best.free_conflict if best else 0.0,
        "hypotheses": [
            {"T_a_b": np.asarray(h.T_a_b).tolist(), "score": h.score, "source": h.source}
            for h in registration.hypotheses
        ],
        # At what voxel size the maps were compared, and why; None where nothing was.
        "working_voxel_size": stats.get("voxel_size"),
        "working_voxel_reason": stats.get("voxel_size_reason"),
        # What was found of them where the best pose was looked at again; None where it was not.
        "handedness": stats.get("handedness"),
        "scale": stats.get("scale"),
        "num_isolated": [stats.get(f"num_isolated_{name}", 0) for name in "ab"],
        # What the confidence rests on: strength, chance, contradictions and rivals; None where nothing was found.
        "standing": stats.get("verdict"),
        # Things of one map in free space of the other: which map shows them, how large they are [m^2], and where.
        "contradictions": stats.get("contradictions", []),
        "seconds": stats.get("seconds", {}),
    }


def _corner_counts(merged: Merge, grids: Sequence[VoxelGrid], stages: Stages) -> list[int]:
    """Corners of each map, from the pairs it took part in; counted now where no pair needed them."""
    counts: list[int | None] = [None if grid.num_occupied else 0 for grid in grids]
    for a, b, registration in merged.pairs:
        # The last pair that knows the number wins: features are made once a map, so that in the default preset
        # all agree.
        counts[a] = registration.stats.get("num_corners_a", counts[a])
        counts[b] = registration.stats.get("num_corners_b", counts[b])
    # What no pair needed is found side by side: it takes as long as a stage of the registration, and is one.
    unknown = [n for n, count in enumerate(counts) if count is None]
    if not any(merged.late[number] is not None for number in unknown):
        return [count or 0 for count in counts]

    def found(number: int) -> int:
        late = merged.late[number]
        return 0 if late is None else late.corners.num_listed

    stages.announce("corners of the maps for the report")
    with stages.measure("corners"):
        known = dict(zip(unknown, spread(found, unknown), strict=True))
    return [known.get(number, count or 0) for number, count in enumerate(counts)]
