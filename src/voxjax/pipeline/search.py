"""Rounds of hypotheses: the exhaustive search first, all other sources where it does not decide."""

import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ..registration.hypotheses.map_features import MapFeatures
from ..registration.hypotheses.proposals import ProposalCollector
from ..registration.judging.conflict_pieces import weigh_pieces
from ..registration.judging.leaders import Leaders, find_leaders, merge_leaders
from .config import Config


class Found(NamedTuple):
    """Leaders of a pair and how they were found.

    Attributes:
        leaders: Distinct, judged, best first; None where no source proposed anything.
        sources: The source of each leader.
        stats: Counts for the report.
        seconds: {stage: s}.
    """

    leaders: Leaders | None
    sources: tuple[str, ...]
    stats: dict
    seconds: dict[str, float]


def search(
    a: MapFeatures,
    b: MapFeatures,
    settings: Config,
    *,
    gravity_aligned: bool,
    guess: np.ndarray | None,
    uncertainty: tuple[float, float] | None,
    is_decided: Callable[[Leaders], bool],
    announce: Callable[[str], None],
) -> Found:
    """Propose, refine and judge poses of b in a.

    The exhaustive search needs no corners and no descriptors, which take longer than everything else together, and
    where it is enough the others add nothing: they would be judged by the same evidence.

    Args:
        a: First map.
        b: Second map.
        settings: Which sources, and how many poses.
        gravity_aligned: Only yaw is unknown.
        guess: One more pose to try.
        uncertainty: Distance [m] at the centroid of b and angle [rad] from the guess beyond which poses are left out.
        is_decided: Whether leaders of the first round are enough; never asked with `settings.source.thorough`.
        announce: Called with the name of each stage.
    """
    sources, options = settings.source, settings.leader
    near = None if guess is None or uncertainty is None else (guess, *uncertainty)
    collector = ProposalCollector(a, b, gravity_aligned=gravity_aligned, near=near)

    def propose_first() -> None:
        if guess is not None:
            collector.add_guess(guess)
        if sources.exhaustive:
            collector.add_exhaustive(max_rotations=sources.max_rotations, num_peaks=sources.num_peaks)

    def propose_others() -> None:
        if sources.corners:
            collector.add_corner_frames()
        if sources.subgraph:
            collector.add_subgraph(
                distance_tolerance=sources.distance_tolerance, max_corners=sources.max_corners
            )
        if sources.descriptors:
            collector.add_descriptors(max_poses=sources.max_descriptor_poses)

    leaders: Leaders | None = None
    names: tuple[str, ...] = ()
    spent = 0.0
    num_rounds = 0
    for propose in (propose_first, propose_others):
        announce("hypotheses")
        propose()
        proposals = collector.take()
        num_rounds += 1
        if len(proposals.poses) == 0:
            continue
        announce("leaders")
        start = time.perf_counter()
        more = find_leaders(
            a.prepared, b.prepared, proposals.poses, num_ranked=options.num_ranked,
            num_refined=options.num_refined, num_leaders=options.num_leaders,
        )  # fmt: skip
        more_names = tuple(proposals.sources[row] for row in more.rows)
        if leaders is None:
            leaders, names = more, more_names
        else:
            leaders, chosen = merge_leaders(
                a.prepared, b.prepared, leaders, more, num_leaders=options.num_leaders
            )
            both: list[str] = [*names, *more_names]
            names = tuple(both[row] for row in chosen)
        leaders, order = weigh_pieces(a.prepared, b.prepared, leaders)
        names = tuple(names[row] for row in order)
        spent += time.perf_counter() - start
        if not sources.thorough and is_decided(leaders):
            break
    stats = collector.stats | {"num_rounds": num_rounds}
    return Found(leaders, names, stats, collector.seconds | {"leaders": spent})
