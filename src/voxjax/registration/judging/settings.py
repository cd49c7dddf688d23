"""Settings of the judging: how many poses survive each stage, how they are compared, and when one is accepted."""

import dataclasses

from ..._settings import Settings, setting


@dataclasses.dataclass(frozen=True)
class LeaderConfig(Settings, table="leader"):
    """How many hypotheses survive each stage, and by how many points they are compared.

    Points of a map are drawn by leverage. The numbers of poses, points and steps were settled in trials on generated
    pairs; unrefined poses are judged by fewer points, because there are more of them.

    Attributes:
        num_ranked: Distinct poses judged at the coarse tolerance.
        num_refined: Distinct poses refined.
        num_leaders: Distinct refined poses judged by all voxels.
        num_quick_points: Points of each map that rank all hypotheses.
        num_coarse_points: Points of each map that judge the ranked poses at the coarse tolerance.
        num_rough_points: Points of map b that the first refinement aligns.
        num_rough_steps: Steps of the first refinement.
        rough_start_distance: Robust scale at which the first refinement starts [voxel]: as far as the field of the
            nearest voxels reaches, because unrefined poses are off by about a coarse cell.
        rough_final_distance: Robust scale at which the first refinement ends [voxel]: how far from a surface a voxel
            may land and still hit it.
        num_rough_judges: Points of each map that judge poses after the first refinement.
        num_fine_points: Points of map b that the second refinement aligns.
        num_fine_steps: Steps of the second refinement.
        fine_start_distance: Robust scale at which the second refinement starts [voxel].
        fine_final_distance: Robust scale at which the second refinement ends [voxel].
        unrefined_voxels: Unrefined poses that put the centroid of map b nearer to each other than this [voxel] and turn
            it alike are one hypothesis.
        unrefined_degrees: Unrefined poses that turn map b alike but for less than this [deg] and put it at one place
            are one hypothesis.
        distinct_voxels: Refined poses that put the centroid of map b nearer to each other than this [voxel] and turn it
            alike are one.
        distinct_degrees: Refined poses that turn map b alike but for less than this [deg] and put it at one place are
            one: with 4 degrees, poses on their way to the best one of a coarse map stood beside it as rivals.
    """

    num_ranked: int = setting(512, low=1, high=100_000)
    num_refined: int = setting(64, low=1, high=100_000)
    num_leaders: int = setting(12, low=1, high=10_000)
    num_quick_points: int = setting(512, low=1, high=1_000_000)
    num_coarse_points: int = setting(1024, low=1, high=1_000_000)
    num_rough_points: int = setting(1024, low=1, high=1_000_000)
    num_rough_steps: int = setting(15, low=1, high=1_000)
    rough_start_distance: float = setting(5.0, above=0.0, high=1_000.0)
    rough_final_distance: float = setting(1.5, above=0.0, high=1_000.0)
    num_rough_judges: int = setting(4096, low=1, high=1_000_000)
    num_fine_points: int = setting(8192, low=1, high=1_000_000)
    num_fine_steps: int = setting(12, low=1, high=1_000)
    fine_start_distance: float = setting(2.5, above=0.0, high=1_000.0)
    fine_final_distance: float = setting(1.0, above=0.0, high=1_000.0)
    unrefined_voxels: float = setting(2.0, low=0.0, high=1_000.0)
    unrefined_degrees: float = setting(1.5, low=0.0, high=180.0)
    distinct_voxels: float = setting(5.0, low=0.0, high=1_000.0)
    distinct_degrees: float = setting(8.0, low=0.0, high=180.0)


@dataclasses.dataclass(frozen=True)
class VerdictConfig(Settings, table="verdict"):
    """When a pose is accepted; the model is in `registration/judging/verdict.py`.

    Attributes:
        min_confidence: Least probability of an accepted pose.
        min_confidence_beside_rivals: Least probability of an accepted pose where free space must decide between poses
            that score alike.
        min_chance: Strength that chance is taken to reach at least, in pairs of which few poses were tried.
        min_exact_chance: Likewise where free space is not known, and strengths are smaller (`Judgement.strength`).
        max_conflict: Largest share of conflicts among the voxels that hit or conflict.
        min_support: Least agreement along the worst direction, as a share of all that both maps could show.
        max_changes: Largest share of the surface apart from walls, floors and ceilings that may stand in free space of
            the other map in pieces that hang together, beyond what drift explains (`contradictions`).
        max_changes_beside_rivals: Likewise where other poses agree almost as well, of which the right one is clean, in
            this sense or in that of `max_pieces`.
        max_pieces: Largest surface that may conflict in pieces there, walls and drift included, as a share of what
            agrees.
        usual_changes: Share that contradicts under any pose, from noise and people.
        usual_pieces: Surface that conflicts in pieces under any pose, as a share of what agrees: rivals are told apart
            by what is beyond it.
        min_piece_voxels: Such a piece has at least so many voxels: noise and grazing rays leave less.
        min_structure_share: Walls, floors and ceilings are planes with at least this share of a map's voxels.
        min_rival_share: Poses with less than this share of the best strength are no rivals, and nobody looks for what
            contradicts them.
        rival_weight: Rivals are as probable as their strength, net of what contradicts them, to this power. How much
            the maps should overlap is not known beforehand, and the true pose among equal rooms is often not the one
            that agrees most: between rivals the strength weighs less than it does against chance.
        max_none: Other sources are asked only if no leader is right with at least this probability.
    """

    min_confidence: float = setting(0.85, low=0.0, high=1.0)
    min_confidence_beside_rivals: float = setting(0.9, low=0.0, high=1.0)
    min_chance: float = setting(0.02, above=0.0, high=1.0)
    min_exact_chance: float = setting(0.0001, above=0.0, high=1.0)
    max_conflict: float = setting(0.08, low=0.0, high=1.0)
    min_support: float = setting(0.005, low=0.0, high=1.0)
    max_changes: float = setting(0.035, low=0.0, high=1.0)
    max_changes_beside_rivals: float = setting(0.004, low=0.0, high=1.0)
    max_pieces: float = setting(0.003, low=0.0, high=1.0)
    usual_changes: float = setting(0.01, above=0.0, high=1.0)
    usual_pieces: float = setting(0.001, above=0.0, high=1.0)
    min_piece_voxels: int = setting(30, low=1, high=1_000_000)
    min_structure_share: float = setting(0.01, low=0.0, high=1.0)
    min_rival_share: float = setting(0.5, low=0.0, high=1.0)
    rival_weight: float = setting(3.0, low=0.0, high=100.0)
    max_none: float = setting(0.1, low=0.0, high=1.0)
