"""Settings of the paper's own method."""

import dataclasses

from ..._settings import Settings, setting


@dataclasses.dataclass(frozen=True)
class PaperConfig(Settings, table="paper"):
    """The preset "paper"; the verdict, which the paper does not know, is a plain rule.

    Attributes:
        distance_tolerance: D of equation (4) [voxel]; the paper gives no value.
        max_corners: Corners of a map that are matched; the strongest. The paper matched 82 with 88.
        max_nodes: Budget of the backtracking: about 10 seconds.
        neighbour_radius: How far the neighbouring points of a corner reach [voxel]: once the window of section III.
        max_neighbours: Occupied voxels taken around one corner; nearest first.
        early_radius: How far the neighbouring points of a corner reach in the early transform [voxel], which is taken
            thousands of times: a quarter of `max_neighbours` take part.
        early_match_distance: Neighbouring points of the early transform match within this [voxel].
        first_match_distance: Neighbouring points match within this in the first round [voxel].
        last_match_distance: Neighbouring points match within this in the last round [voxel].
        min_corner_weight: Each matched corner weighs at least this share of what all neighbouring points weigh,
            divided by the number of corners: few corners stand beside many points.
        num_rounds: How often neighbouring points are matched anew; they settle after three or four.
        max_hypotheses: Tied schemes that are reported.
        min_matches: Corners that an accepted scheme matches: one more than any five matches, whose transform the search
            starts from.
        min_evidence: Least evidence of an accepted pose. Wrong poses between different buildings reached 0.05 in trials
            where hits and conflicts were counted.
        distinct_voxels: A tied scheme is elsewhere if it puts the centroid of map b farther away than this [voxel].
        distinct_degrees: A tied scheme is elsewhere if it turns map b by more than this [deg].
        max_rival: A tied scheme elsewhere that fuses this share of the voxels makes the answer ambiguous.
    """

    distance_tolerance: float = setting(2.0, above=0.0, high=1_000.0)
    max_corners: int = setting(128, low=3, high=10_000)
    max_nodes: int = setting(2_000_000, low=1, high=1_000_000_000)
    neighbour_radius: float = setting(7.0, above=0.0, high=1_000.0)
    max_neighbours: int = setting(64, low=4, high=10_000)
    early_radius: float = setting(5.0, above=0.0, high=1_000.0)
    early_match_distance: float = setting(2.0, above=0.0, high=1_000.0)
    first_match_distance: float = setting(4.0, above=0.0, high=1_000.0)
    last_match_distance: float = setting(1.5, above=0.0, high=1_000.0)
    min_corner_weight: float = setting(0.1, low=0.0, high=1_000.0)
    num_rounds: int = setting(6, low=1, high=1_000)
    max_hypotheses: int = setting(16, low=1, high=10_000)
    min_matches: int = setting(6, low=3, high=10_000)
    min_evidence: float = setting(0.1, low=0.0, high=1.0)
    distinct_voxels: float = setting(5.0, low=0.0, high=1_000.0)
    distinct_degrees: float = setting(5.0, low=0.0, high=180.0)
    max_rival: float = setting(0.8, low=0.0, high=1.0)
