"""Register two maps: `register` checks and prepares them, `register_features` is the algorithm, stage by stage."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any, Literal

import numpy as np

from .._checks import InputError, check_choice
from .._results import RESULTS
from .._runtime.forks import refused_after_fork
from .._runtime.mappings import release_kernels_if_crowded
from .._runtime.threads import spread
from ..frames import to_local
from ..grid import VoxelGrid, check_grid
from ..maps.main_part import main_part
from ..refinement.refine import Refinement, refine
from ..registration.causes.units import far_unit
from ..registration.hypotheses.kept import forget_pair
from ..registration.hypotheses.map_features import MapFeatures, worse_free_space
from ..registration.hypotheses.pose_range import PoseRange
from ..registration.hypotheses.proposals import Proposals
from ..registration.judging.chance import chance_level
from ..registration.judging.contradictions import find_contradictions
from ..registration.judging.leaders import Leaders, find_leaders, merge_leaders
from ..registration.judging.rivals import weigh_rivals
from ..registration.judging.verdict import Finding, decide
from ..registration.paper.register import register_paper
from ..registration.types import Registration
from .as_registration import nothing_found, registration_of
from .causes import Decide, Questioned, explain
from .coarse import coarse_proposals
from .config import Config, PoseConfig, config_from
from .features import features_at, working_voxel
from .guesses import checked_guess, range_around
from .hypotheses import first_hypotheses, other_hypotheses
from .memory_need import check_register_memory
from .stage_times import Stages
from .units import in_feet, in_other_unit
from .wide import finer_factors, leaders_by_coarser_copies, leaders_through_copies, needed_coarsening


@refused_after_fork
def register(
    a: VoxelGrid,
    b: VoxelGrid,
    *,
    preset: Literal["default", "paper"] = "default",
    config: Config | Mapping[str, Any] | None = None,
    gravity_aligned: bool = False,
    allow_changes: bool = False,
    init_guess: object = None,
    guess_uncertainty: tuple[float, float] | None = None,
    on_stage: Callable[[str], None] | None = None,
) -> Registration:
    """Find how map b lies in map a, or say that the maps do not show it.

    Args:
        a: The map whose frame the pose maps into.
        b: The map that is moved; the voxel sizes may differ.
        preset: "default", or "paper" for the published method alone.
        config: Settings of the stages: a `Config`, nested tables, or None for the defaults. The preset "paper" reads
            the groups `paper` and `evidence` alone.
        gravity_aligned: The z axes of both maps point up, so that only yaw is unknown; default preset only.
        allow_changes: Accept a pose although things were moved between the maps, which another storey of one plan looks
            like, too; `stats["contradictions"]` lists them. Default preset only.
        init_guess: A (4, 4) `T_a_b` that is tried as one more hypothesis; default preset only.
        guess_uncertainty: Bounds around the guess: poses that put map b's centroid farther from where the guess puts it
            than the first number [m], or turn it by more than the second [rad], are left out.
        on_stage: Called with the name of each stage as it starts.

    Returns:
        The pose with verdict, confidence, covariance and all other hypotheses. Maps without overlap, without
        corners or without voxels are an outcome, not an error.

    Raises:
        InputError: If a setting or the guess cannot be used, or the maps need more memory than there is
            (`pipeline/memory_need.py`).
    """
    check_choice("preset", preset, ("default", "paper"))
    if preset == "paper" and (
        gravity_aligned or allow_changes or init_guess is not None or guess_uncertainty is not None
    ):
        raise InputError(
            "preset 'paper' takes none of gravity_aligned, allow_changes, init_guess and guess_uncertainty, which the "
            "published method does not know; leave them out or take the preset 'default'."
        )
    settings = config_from(config)
    # What cannot be used is refused before minutes of work, and beside an empty map too.
    checked_guess(init_guess, guess_uncertainty)
    stages = Stages(on_stage)
    for name, grid in (("a", a), ("b", b)):
        check_grid(name, grid)
    # Both are looked at as types first: an empty a is an outcome, which must not hide that b is no map.
    for name, grid in (("a", a), ("b", b)):
        if grid.num_occupied == 0:
            return nothing_found(f"Map {name} has no occupied voxel.", RESULTS.empty_map)
    if preset == "paper":
        (a, isolated_a), (b, isolated_b) = main_part(a), main_part(b)
        # The paper's method knows no working voxel size and compares maps at the coarser one of the two.
        check_register_memory([a, b], max(a.voxel_size, b.voxel_size), preset="paper")
        stages.announce("the paper's pipeline")
        found = register_paper(a, b, settings.paper, conflict_weight=settings.evidence.conflict_weight)
        return replace(found, stats=found.stats | _isolated(isolated_a, isolated_b))
    again = partial(register, config=settings, gravity_aligned=gravity_aligned, allow_changes=allow_changes)
    # At a voxel size that suits both, one of the maps would vanish in a voxel.
    unit = far_unit(a, b)
    named = None if unit is None else in_other_unit(a, b, unit, again)
    if named is not None:
        return named
    voxel = working_voxel([a, b], settings)
    check_register_memory([a, b], voxel.size)
    with stages.stage("features"):
        features = partial(features_at, voxel_size=voxel.size, config=settings)
        features_a, features_b = spread(features, (a, b))
    found = register_features(
        features_a,
        features_b,
        config=settings,
        gravity_aligned=gravity_aligned,
        allow_changes=allow_changes,
        init_guess=init_guess,
        guess_uncertainty=guess_uncertainty,
        on_stage=on_stage,
        seconds=stages.seconds,
    )
    return voxel.noted(in_feet(a, b, found, again))


def register_features(
    a: MapFeatures,
    b: MapFeatures,
    *,
    config: Config | Mapping[str, Any] | None = None,
    gravity_aligned: bool = False,
    allow_changes: bool = False,
    init_guess: object = None,
    guess_uncertainty: tuple[float, float] | None = None,
    on_stage: Callable[[str], None] | None = None,
    seconds: dict[str, float] | None = None,
) -> Registration:
    """`register` for maps whose features are known (`features_at`), both at the same voxel size.

    Args:
        a: The map whose frame the pose maps into.
        b: The map that is moved.
        config: Settings of the stages: a `Config`, nested tables, or None for the defaults.
        gravity_aligned: Whether only yaw is unknown, see `register`.
        allow_changes: Whether things that were moved are no reason against a pose, see `register`.
        init_guess: A (4, 4) `T_a_b` that is tried as one more hypothesis.
        guess_uncertainty: Distance [m] and angle [rad] from the guess beyond which poses are left out.
        on_stage: Called with the name of each stage as it starts.
        seconds: {stage: s} of what was done before, for the report.

    Raises:
        InputError: If the voxel sizes differ, or a setting or the guess cannot be used.
    """
    settings, stages = config_from(config), Stages(on_stage, seconds)
    _check_voxel_sizes(a, b)
    guess = checked_guess(init_guess, guess_uncertainty)
    if guess is not None:
        guess = to_local(guess, a.origin, b.origin).astype(np.float32)
    pose_range = range_around(
        b, settings.source.max_lean if gravity_aligned else None, guess, guess_uncertainty
    )
    free_space = worse_free_space(a, b)
    has_free_space = a.prepared.has_free_space and b.prepared.has_free_space
    release_kernels_if_crowded()

    verdict = partial(
        _verdict, settings=settings, is_inferred=free_space == "inferred", allow_changes=allow_changes
    )
    options = {
        "settings": settings,
        "verdict": verdict,
        "stages": stages,
        "pose_range": pose_range,
    }
    search = partial(_search, guess=guess, **options)
    factor = needed_coarsening(a, b, settings)
    if factor == 1:
        leaders, finding, counts = search(a, b)
    else:
        leaders, counts = leaders_by_coarser_copies(
            a, b, factor, search, settings=settings, stages=stages, pose_range=pose_range, guess=guess
        )
        with stages.stage("leaders"):
            leaders = weigh_rivals(a, b, leaders, settings.verdict)
        # The wider the maps, the coarser the copies: what corners and descriptors tell is in the voxels themselves.
        through_copies = partial(
            leaders_through_copies,
            factors=[factor, *finer_factors(factor)],
            settings=settings,
            stages=stages,
            pose_range=pose_range,
        )
        leaders, finding, counts = _with_other_sources(
            a, b, leaders, counts, leaders_of=through_copies, **options
        )
    # The second round may find nothing either; then there is no pose to refine.
    if len(leaders.poses) == 0:
        forget_pair(a, b)
        return nothing_found(finding.reason, RESULTS.too_few_corners, counts | {"seconds": stages.seconds})
    if has_free_space:
        with stages.measure("contradictions"):
            against = find_contradictions(a, b, leaders.poses[0], settings.verdict)
        counts["contradictions"] = [piece._asdict() for piece in against.pieces]
    # Where something speaks against the pose, map b may be mirrored, or have another scale.
    explained = explain(
        Questioned(a, b, leaders, finding, factor), decide=verdict, settings=settings, stages=stages
    )
    forget_pair(a, b)
    standing = explained.finding.standing
    counts["verdict"] = None if standing is None else standing._asdict()

    # The pose: the best leader, refined once more against both maps, with its covariance.
    with stages.stage("verdict"):
        pose = _last_refinement(a, b, leaders.poses[0], settings.pose)
    counts |= {"has_free_space": has_free_space, "free_space": free_space}
    counts |= _isolated(a.num_isolated, b.num_isolated)
    # Shares of the evidence are of both maps together, so counts for the report are too.
    num_voxels = a.prepared.num_points + b.prepared.num_points
    found = registration_of(
        pose,
        leaders,
        explained.finding,
        settings.verdict,
        num_voxels=num_voxels,
        stats=counts | explained.stats | {"seconds": stages.seconds},
    )
    if explained.result is not None:
        found = replace(found, result=explained.result)
    return found.from_local(a.origin, b.origin)


def _search(
    a: MapFeatures,
    b: MapFeatures,
    *,
    settings: Config,
    verdict: Decide,
    stages: Stages,
    pose_range: PoseRange,
    guess: np.ndarray | None,
) -> tuple[Leaders, Finding, dict[str, Any]]:
    """Leaders of a pair, what is found of them, and what was counted on the way.

    Args:
        a: First map.
        b: Second map.
        settings: Settings of the stages.
        verdict: What is found of leaders.
        stages: Keeps the seconds of each stage.
        pose_range: The poses that can be.
        guess: One more pose (4, 4) to try, or None.
    """
    # 1. Hypotheses that need no corners: a guess, and all translations of the rotations that the normals allow.
    proposed = first_hypotheses(a, b, settings, guess=guess, pose_range=pose_range, stages=stages)
    counts = {"num_rounds": 1, "num_hypotheses": proposed.num_found, **proposed.counts}

    # 2. Leaders: distinct poses, refined and judged by all voxels; rivals net of conflicts that hang together.
    with stages.stage("leaders"):
        leaders = find_leaders(a.prepared, b.prepared, proposed, settings.leader, settings.evidence)
        leaders = weigh_rivals(a, b, leaders, settings.verdict)

    def leaders_of(a: MapFeatures, b: MapFeatures, more: Proposals) -> Leaders:
        with stages.stage("leaders"):
            return find_leaders(a.prepared, b.prepared, more, settings.leader, settings.evidence)

    # 3. Unless that is enough: coarser cells, on which rough surfaces and sparse maps agree. This takes a tenth of the
    # time of the other sources, and poses that are probably right may still score less than one that was missed.
    finding = verdict(b, leaders)
    if settings.source.exhaustive and finding.verdict != "accepted":
        with stages.stage("coarse search"):
            more = coarse_proposals(a, b, settings, pose_range=pose_range)
        counts["num_hypotheses"] += more.num_found
        found = leaders_of(a, b, more)
        with stages.stage("leaders"):
            leaders = merge_leaders(a.prepared, b.prepared, leaders, found, settings.leader)
            leaders = weigh_rivals(a, b, leaders, settings.verdict)

    # 4. A second round, unless that settles it.
    return _with_other_sources(
        a,
        b,
        leaders,
        counts,
        leaders_of=leaders_of,
        settings=settings,
        verdict=verdict,
        stages=stages,
        pose_range=pose_range,
    )


def _with_other_sources(
    a: MapFeatures,
    b: MapFeatures,
    leaders: Leaders,
    counts: dict[str, Any],
    *,
    leaders_of: Callable[[MapFeatures, MapFeatures, Proposals], Leaders],
    settings: Config,
    verdict: Decide,
    stages: Stages,
    pose_range: PoseRange,
) -> tuple[Leaders, Finding, dict[str, Any]]:
    """Leaders with those that the other sources bring, unless one is probably right: more poses do not tell which.

    Args:
        a: First map.
        b: Second map.
        leaders: What was found so far.
        counts: What was counted so far.
        leaders_of: Finds the leaders among more hypotheses.
        settings: Settings of the stages.
        verdict: What is found of leaders.
        stages: Keeps the seconds of each stage.
        pose_range: The poses that can be.
    """
    finding = verdict(b, leaders)
    is_settled = finding.verdict == "accepted" or finding.none < settings.verdict.max_none
    if is_settled and not settings.source.thorough:
        return leaders, finding, counts
    more = other_hypotheses(a, b, settings, pose_range=pose_range, stages=stages)
    num_found = counts["num_hypotheses"] + more.num_found
    counts = counts | more.counts | {"num_rounds": counts["num_rounds"] + 1, "num_hypotheses": num_found}
    found = leaders_of(a, b, more)
    with stages.stage("leaders"):
        leaders = merge_leaders(a.prepared, b.prepared, leaders, found, settings.leader)
        leaders = weigh_rivals(a, b, leaders, settings.verdict)
    return leaders, verdict(b, leaders), counts


def _verdict(
    b: MapFeatures, leaders: Leaders, *, settings: Config, is_inferred: bool, allow_changes: bool
) -> Finding:
    """What the evidence of the leaders says against what chance gives in this pair."""
    chance = chance_level(b.prepared, leaders, settings.verdict, settings.leader)
    return decide(
        leaders.judgement,
        chance,
        settings.verdict,
        is_inferred=is_inferred,
        allow_changes=allow_changes,
    )


def _isolated(num_a: int, num_b: int) -> dict[str, int]:
    """How many voxels of each map were left aside, for the report."""
    return {"num_isolated_a": num_a, "num_isolated_b": num_b}


def _last_refinement(a: MapFeatures, b: MapFeatures, T_a_b: np.ndarray, settings: PoseConfig) -> Refinement:
    """A pose refined against the surfaces of both maps."""
    return refine(
        a.prepared,
        b.prepared,
        T_a_b,
        # The leaders were refined before: this start is near, and a wide scale would let far surfaces pull
        # again.
        max_distance=settings.start_distance * a.prepared.grid.voxel_size,
        num_points=settings.num_points,
        # With both ways, registering b to a gives the inverse of a to b.
        both_ways=True,
    )


def _check_voxel_sizes(a: MapFeatures, b: MapFeatures) -> None:
    """Raise if features are of maps at different voxel sizes."""
    size_a, size_b = a.prepared.grid.voxel_size, b.prepared.grid.voxel_size
    if abs(size_a - size_b) > 1e-6 * size_a:
        raise InputError(
            f"a and b must be prepared at the same voxel_size, got {size_a:g} and {size_b:g}; "
            "prepare both at the coarser one."
        )
