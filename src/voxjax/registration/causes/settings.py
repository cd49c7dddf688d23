"""Settings of the tests of handedness and scale: when they are made, and how clear their answer must be."""

import dataclasses

from ..._settings import Settings, setting


@dataclasses.dataclass(frozen=True)
class CauseConfig(Settings, table="cause"):
    """When a mirrored map and one of another scale are looked for, and from when on they are believed.

    Attributes:
        max_clean_conflict: An accepted pose with at most this share of conflicts among the voxels that hit or conflict
            is not questioned: a mirrored building that is nearly its own mirror image has 1 %, and less where it is so
            wholly that nobody could tell.
        min_gain: How much stronger than the pose of map b as it is its best pose must be once map b is mirrored, as a
            share of the former.
        min_clear_gain: The same where the mirror image has less than half of the conflicts, or a scale is away from 1
            by `num_clear_errors` of its standard error: nearly symmetric buildings and rough terrain gain little.
        min_open_gain: The same where it is open which pose of the mirrored or scaled map is right.
        max_cells: Cells of the blocks in which translations are searched, at most, where the widest cells allow it.
        num_peaks: Translations kept for each rotation.
        distinct_voxels: Poses of the search that put the centroid of map b nearer to each other than this [voxel] and
            turn it alike are one.
        distinct_degrees: Poses of the search that turn map b alike but for less than this [deg] and put it at one
            place are one.
        num_leaders: Best poses of a changed map that are aligned and judged.
        num_refined: Distinct ones of these that are aligned once more, from which the leaders come.
        min_scale: Scales whose logarithm is nearer to 0 than this are errors of the maps.
        num_errors: How many times its standard error the logarithm of a scale must be away from 0.
        num_clear_errors: The same where the score gains less than `min_gain`.
        num_doubted_errors: The same for a scale that is not named, but at which an accepted pose becomes ambiguous;
            fewer than `num_errors`, for logarithms beyond twice `min_scale`.
        scale_step: Logarithm of the ratio of the scales that are searched, of which there are three: the middle one is
            1. Half of it is what coarse cells bridge.
        num_starts: Best poses of all scales from which map b is aligned with a scale.
        num_rough_points: Points of map b that are aligned with a scale from these.
        num_points: Points of map b that are aligned with a scale at last, from the best poses.
        num_steps: Steps of that alignment.
        num_judged: Best poses that are aligned at last, and judged.
    """

    max_clean_conflict: float = setting(0.005, low=0.0, high=1.0)
    min_gain: float = setting(0.05, low=0.0, high=100.0)
    min_clear_gain: float = setting(0.01, low=0.0, high=100.0)
    min_open_gain: float = setting(1.0, low=0.0, high=100.0)
    max_cells: int = setting(60_000, low=1, high=1_000_000_000)
    num_peaks: int = setting(8, low=1, high=1_000)
    distinct_voxels: float = setting(5.0, low=0.0, high=1_000.0)
    distinct_degrees: float = setting(8.0, low=0.0, high=180.0)
    num_leaders: int = setting(48, low=1, high=10_000)
    num_refined: int = setting(32, low=1, high=10_000)
    min_scale: float = setting(0.01, low=0.0, high=1.0)
    num_errors: float = setting(3.0, low=0.0, high=1_000.0)
    num_clear_errors: float = setting(4.0, low=0.0, high=1_000.0)
    num_doubted_errors: float = setting(2.0, low=0.0, high=1_000.0)
    scale_step: float = setting(0.07, above=0.0, high=0.2)
    num_starts: int = setting(16, low=1, high=10_000)
    num_rough_points: int = setting(512, low=8, high=1_000_000)
    num_points: int = setting(2048, low=8, high=1_000_000)
    num_steps: int = setting(20, low=1, high=1_000)
    num_judged: int = setting(3, low=1, high=1_000)
