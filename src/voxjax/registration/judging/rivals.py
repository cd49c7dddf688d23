"""Rivals for the first place, and what tells the right one: it is the cleanest, not the one that agrees most.

Among equal rooms, floors or racks several poses agree alike, and how much the maps should overlap is not known
beforehand. A pose that is wrong by a whole room sets furniture into free space, the true one does not.
"""

from functools import partial

import numpy as np

from ..._runtime.threads import spread
from ..hypotheses.map_features import MapFeatures
from .contradictions import find_contradictions
from .judgement import Judgement
from .leaders import Leaders
from .settings import VerdictConfig


def weigh_rivals(a: MapFeatures, b: MapFeatures, leaders: Leaders, settings: VerdictConfig) -> Leaders:
    """Leaders with what contradicts the rivals for the first place, best first by the strength net of it.

    Args:
        a: First map.
        b: Second map.
        leaders: Distinct poses, judged.
        settings: Which poses are rivals, and what contradicts them.
    """
    judgement = leaders.judgement
    # Contradictions decide between rivals alone, and looking for them passes over all voxels of both maps. Where free
    # space is not known there are none.
    is_rival = rivals(judgement, settings.min_rival_share)
    if judgement.has_free_space and is_rival.any():
        look = partial(find_contradictions, a, b, settings=settings)
        found = spread(look, leaders.poses[is_rival])
        columns = [np.zeros(len(is_rival)) for _ in range(4)]
        for column, part in zip(columns, ("share", "area", "conflicting", "agreeing"), strict=True):
            column[is_rival] = [getattr(one, part) for one in found]
        judgement = judgement._replace(
            changed=columns[0], moved=columns[1], pieces=columns[2], shared=columns[3]
        )
    order = np.argsort(-net_strengths(judgement, settings), kind="stable")
    # The best pose is the first one everywhere after this: the verdict and the last refinement take it from there.
    return leaders._replace(judgement=judgement).take(order)


def rivals(judgement: Judgement, min_share: float = VerdictConfig.min_rival_share) -> np.ndarray:
    """Whether each pose (k,) competes for the first place: the best one, and those with a share of its strength."""
    strength = judgement.strength()
    # A pose without a positive strength is supported by nothing, and no rival of anything.
    return (strength >= min_share * strength.max(initial=0.0)) & (strength > 0.0)


def net_strengths(judgement: Judgement, settings: VerdictConfig | None = None) -> np.ndarray:
    """Strengths (k,); those of rivals fall with what conflicts in pieces, and the cleanest one keeps its own.

    What all rivals show alike, from drift or moved things, tells nothing between them.

    Args:
        judgement: The poses, judged, with what contradicts the rivals.
        settings: Which poses are rivals, and how much conflicts under any pose.
    """
    settings = VerdictConfig() if settings is None else settings
    is_rival = rivals(judgement, settings.min_rival_share)
    share = judgement.pieces / np.maximum(judgement.shared, 1e-12)
    least = share[is_rival].min(initial=np.inf)
    # The share that conflicts under any pose keeps the quotient finite, and lets small differences weigh little.
    usual = settings.usual_pieces
    return judgement.strength() * np.where(is_rival, (usual + least) / (usual + share), 1.0)
