"""Settings of the sources of hypotheses, and of the evidence by which all poses are compared."""

import dataclasses

from ..._settings import Settings, setting


@dataclasses.dataclass(frozen=True)
class EvidenceConfig(Settings, table="evidence"):
    """How much what speaks against a pose weighs beside what speaks for it.

    Attributes:
        conflict_weight: How many hits a conflict outweighs; anything from 3 to 10 served in trials.
        coarse_conflict_weight: How many hits a conflict outweighs before refinement, where it is less certain.
    """

    conflict_weight: float = setting(6.0, low=0.0, high=1_000.0)
    coarse_conflict_weight: float = setting(3.0, low=0.0, high=1_000.0)


@dataclasses.dataclass(frozen=True)
class SourceConfig(Settings, table="source"):
    """The hypotheses that are proposed, and their number.

    Attributes:
        corners: Poses from single corner frames, observed and virtual.
        subgraph: Poses from the maximum common subgraph of the corners (sections IV.B-C).
        descriptors: Poses from cliques of matched local descriptors.
        exhaustive: Every translation of the rotations that the normals allow.
        distance_tolerance: D of equation (4) [voxel]; the paper gives no value.
        max_corners: Corners of each map that take part in the subgraph.
        max_rotations: Rotations that are searched exhaustively: twice those of a building of right angles.
        num_peaks: Translations kept for each rotation.
        max_descriptor_poses: Distinct cliques of descriptors.
        max_virtual_corners: Virtual corners of each map.
        max_lean: Maps that are gravity aligned may still lean by so much against each other [deg].
        thorough: Ask all sources, also where the exhaustive search alone decides.
    """

    corners: bool = setting(True)
    subgraph: bool = setting(True)
    descriptors: bool = setting(True)
    exhaustive: bool = setting(True)
    distance_tolerance: float = setting(2.0, above=0.0, high=1_000.0)
    max_corners: int = setting(64, low=3, high=10_000)
    max_rotations: int = setting(48, low=1, high=10_000)
    num_peaks: int = setting(24, low=1, high=1_000)
    max_descriptor_poses: int = setting(16, low=1, high=10_000)
    max_virtual_corners: int = setting(256, low=0, high=100_000)
    max_lean: float = setting(8.0, low=0.0, high=90.0)
    thorough: bool = setting(False)


@dataclasses.dataclass(frozen=True)
class RotationConfig(Settings, table="rotation"):
    """How rotations are found from the normals of two maps.

    Attributes:
        num_normals: Normals of each map that a rotation is judged by, drawn by leverage.
        min_planarity: Voxels at least so planar vote for the directions of a map.
        max_voters: Normals that vote for directions at most.
        min_candidates: At least so many of the voters are tried as directions, where there are so many.
        vote_degrees: Voters within this of a candidate count for it [deg].
        refining_degrees: Standard deviation of the weights by which voters move the best candidate to the middle of its
            peak [deg].
        taken_degrees: Voters within this of a direction vote for no other one [deg]: wider than the votes, so that the
            slopes of a peak do not become a direction of their own.
        max_directions: Directions of each map, the strongest.
        min_share: Directions with less than this share of the surface are left out.
        angle_tolerance: Largest difference of the angle between two directions in each map [deg].
        min_angle: Two directions nearer to each other than this fix the rotation about themselves badly, and propose
            none [deg].
        min_second: Where no direction that is `min_angle` or more away from a map's strongest one has this share of the
            latter's surface, all turns about it are tried: ground alone, with trees or stones on it, fixes none.
        num_turns: Turns that are tried then, for each of both signs of the direction.
        concentration: k of the kernel exp(k (cos - 1)) between normals: 60 is about 7.4 degrees.
        rough_stride: One in so many of the normals sharpens the seeds, of which most lead to the same few rotations;
            all normals then sharpen those few and rank them.
        max_seeds: Distinct seeds that are sharpened.
        num_rough_steps: Steps that sharpen a seed on some of the normals.
        num_fine_steps: Steps that sharpen a rotation on all of them.
        distinct_degrees: Rotations nearer to each other than this are one [deg].
    """

    num_normals: int = setting(512, low=1, high=100_000)
    min_planarity: float = setting(0.5, low=0.0, high=1.0)
    max_voters: int = setting(5_000, low=1, high=10_000_000)
    min_candidates: int = setting(400, low=1, high=100_000)
    vote_degrees: float = setting(8.0, above=0.0, high=90.0)
    refining_degrees: float = setting(4.0, above=0.0, high=90.0)
    taken_degrees: float = setting(10.0, above=0.0, high=90.0)
    max_directions: int = setting(8, low=1, high=100)
    min_share: float = setting(0.01, low=0.0, high=1.0)
    angle_tolerance: float = setting(6.0, low=0.0, high=90.0)
    min_angle: float = setting(30.0, above=0.0, high=90.0)
    min_second: float = setting(0.1, low=0.0, high=1.0)
    num_turns: int = setting(48, low=1, high=1_000)
    concentration: float = setting(60.0, above=0.0, high=10_000.0)
    rough_stride: int = setting(4, low=1, high=1_000)
    max_seeds: int = setting(1_000, low=1, high=1_000_000)
    num_rough_steps: int = setting(6, low=1, high=1_000)
    num_fine_steps: int = setting(4, low=1, high=1_000)
    distinct_degrees: float = setting(4.0, low=0.0, high=180.0)


@dataclasses.dataclass(frozen=True)
class ExhaustiveConfig(Settings, table="exhaustive"):
    """How fine the cells are in which all translations are searched.

    Attributes:
        max_factor: Coarse cells are at most so many voxels wide.
        max_cells: Cells are as fine as blocks of at most so many of them allow: three transforms of a block of a
            million cells take about 50 ms on one core.
        most_cells: Maps so wide that blocks of the widest cells have more cells than this are registered in coarser
            copies of themselves first (`pipeline/wide.py`).
    """

    max_factor: int = setting(6, low=2, high=100)
    max_cells: int = setting(1_000_000, low=1, high=1_000_000_000)
    most_cells: int = setting(1_000_000, low=1, high=1_000_000_000)


@dataclasses.dataclass(frozen=True)
class FrameConfig(Settings, table="frame"):
    """How single pairs of corners propose poses.

    Attributes:
        angle_tolerance: Largest difference between the angles of two faces [deg].
        max_pairs: Corner pairs are taken by weight up to so many poses.
        num_points: Points of each map that rank the poses of frames among themselves.
        max_poses: Distinct frames that go on to the common ranking, after their own.
        distinct_voxels: Frames that put the centroid of map b nearer to each other than this [voxel] and turn it alike
            are one.
        distinct_degrees: Frames that turn map b alike but for less than this [deg] and put it at one place are one.
    """

    angle_tolerance: float = setting(5.0, low=0.0, high=90.0)
    max_pairs: int = setting(120_000, low=1, high=10_000_000)
    num_points: int = setting(128, low=1, high=1_000_000)
    max_poses: int = setting(256, low=1, high=100_000)
    distinct_voxels: float = setting(2.0, low=0.0, high=1_000.0)
    distinct_degrees: float = setting(1.5, low=0.0, high=180.0)


@dataclasses.dataclass(frozen=True)
class SubgraphConfig(Settings, table="subgraph"):
    """How the maximum common subgraph of the corners is searched; its tolerance and corners are in `source`.

    Attributes:
        angle_tolerance: Largest disagreement of the rotations that two associations imply [deg].
        min_distance: Two corners of a map nearer to each other than this, in tolerances of the distance, say nothing
            together: they would agree with any such two of the other map.
        max_ties: Largest sets considered.
        max_nodes: Budget of the search.
    """

    angle_tolerance: float = setting(8.0, low=0.0, high=180.0)
    min_distance: float = setting(3.0, low=0.0, high=1_000.0)
    max_ties: int = setting(16, low=1, high=10_000)
    max_nodes: int = setting(20_000, low=1, high=1_000_000_000)


@dataclasses.dataclass(frozen=True)
class DescriptorConfig(Settings, table="descriptor"):
    """How matched local descriptors propose poses.

    Attributes:
        distance_tolerance: Largest error of a matched point, in working spacings: half a cell in each map, and the next
            cell.
        cosine_tolerance: Largest difference of corresponding cosines of two matches.
        min_cosine: Least cosine between the normals of a match under a pose.
        max_matches: Matches that are kept; also the length of the lists on the device.
        max_compared: Matches that are compared with each other.
        max_nodes: Matches of the densest part, which seed cliques.
        num_parts: Densest parts that are taken one after the other: repeated rooms fill the first with false matches.
        max_seeds: Cliques kept of each part.
        num_refits: How often a pose that is kept is fitted anew to all matches that it explains.
        distinct_spacings: Poses that put the middle of the matches nearer to each other than this, in working spacings,
            and turn it alike are one hypothesis; refinement brings them together anyway.
        distinct_degrees: Poses that turn map b alike but for less than this [deg] and put it at one place are one.
    """

    distance_tolerance: float = setting(1.5, above=0.0, high=100.0)
    cosine_tolerance: float = setting(0.3, low=0.0, high=2.0)
    min_cosine: float = setting(0.8, low=-1.0, high=1.0)
    max_matches: int = setting(4096, low=3, high=100_000)
    max_compared: int = setting(2048, low=3, high=20_000)
    max_nodes: int = setting(1024, low=3, high=20_000)
    num_parts: int = setting(2, low=1, high=100)
    max_seeds: int = setting(512, low=1, high=20_000)
    num_refits: int = setting(3, low=1, high=1_000)
    distinct_spacings: float = setting(3.0, low=0.0, high=1_000.0)
    distinct_degrees: float = setting(10.0, low=0.0, high=180.0)
