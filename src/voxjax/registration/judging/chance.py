"""How strong a wrong pose of these two maps can be: chance is measured in the pair itself.

Hundreds of hypotheses are refined and judged for each pair. All but a few of them are wrong, so what they reach is what
chance and repetition give in these two maps, at this voxel size, among so many hypotheses: in a tunnel more than in a
room, without free space more than with it. A pose is believed for how far it stands out of them.
"""

import numpy as np
from jaxtyping import Bool, Float

from ...maps.prepared import PreparedMap
from ..hypotheses.distinct import least_trace
from .leaders import Leaders
from .rivals import rivals
from .settings import LeaderConfig, VerdictConfig


def chance_level(
    b: PreparedMap,
    leaders: Leaders,
    settings: VerdictConfig,
    bounds: LeaderConfig | None = None,
) -> float:
    """Strength of the best pose that is neither a rival for the first place nor near one; at least a floor.

    Args:
        b: Second map.
        leaders: Distinct poses, judged, and those that they were chosen from.
        settings: Which poses are rivals, and the floor.
        bounds: Which poses are one, None for the defaults.
    """
    bounds = LeaderConfig() if bounds is None else bounds
    judgement, tried = leaders.judgement, leaders.tried
    is_rival = rivals(judgement, settings.min_rival_share)
    found = judgement.strength()
    near = _near_any(b, tried.poses, leaders.poses[is_rival], bounds)
    # A pose that is as good as a rival after its first refinement is one that the leaders had no place for.
    is_below = tried.strengths < settings.min_rival_share * found.max(initial=0.0)
    floor = settings.min_chance if judgement.has_free_space else settings.min_exact_chance
    return float(
        max(tried.strengths[~near & is_below].max(initial=floor), found[~is_rival].max(initial=floor))
    )


def _near_any(
    b: PreparedMap,
    poses: Float[np.ndarray, "m 4 4"],
    others: Float[np.ndarray, "r 4 4"],
    bounds: LeaderConfig,
) -> Bool[np.ndarray, "m"]:
    """Whether each pose lies near one of some others; poses on their way to one are twice as far off as two leaders."""
    centroid = np.append(np.asarray(b.centroid, np.float64), 1.0)
    trace = least_trace(min(2.0 * bounds.distinct_degrees, 180.0))
    metres = 2.0 * bounds.distinct_voxels * b.grid.voxel_size
    is_near = np.zeros(len(poses), bool)
    places = poses[:, :3] @ centroid
    for other in others.astype(np.float64):
        same_turn = np.einsum("kij,ij->k", poses[:, :3, :3], other[:3, :3]) > trace
        is_near |= same_turn & (np.linalg.norm(places - other[:3] @ centroid, axis=1) < metres)
    return is_near
