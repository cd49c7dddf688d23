"""All translations with each of some scales of map b, on coarse cells: where alignments of a changed map start.

On cells of several voxels a pose is found from afar, also one whose scale is wrong by a few percent, in a fraction of
the time of the search at the cells of `ExhaustiveConfig`; but its place is no better than a cell, so that it is aligned
before anything ranks it by finer evidence.
"""

from collections.abc import Sequence
from functools import partial

import numpy as np

from ...maps.mirrored import scaled
from ..hypotheses.distinct import distinct_rows
from ..hypotheses.exhaustive import exhaustive_hypotheses, upright_frame
from ..hypotheses.kept import kept_of_pair
from ..hypotheses.map_features import MapFeatures
from ..hypotheses.pair_rotations import rotations_of_pair
from ..hypotheses.settings import EvidenceConfig, ExhaustiveConfig, RotationConfig, SourceConfig
from .settings import CauseConfig
from .similarity import Start


def coarse_starts(
    a: MapFeatures,
    b: MapFeatures,
    scales: Sequence[float],
    *,
    num_starts: int,
    max_lean: float | None = None,
    settings: CauseConfig,
    source: SourceConfig,
    rotation: RotationConfig,
    evidence: EvidenceConfig,
) -> list[Start]:
    """Distinct poses of the best translations of all rotations that the normals allow, best first.

    Args:
        a: First map.
        b: Second map.
        scales: What its lengths are multiplied by.
        num_starts: How many starts are kept, of all scales together.
        max_lean: Largest angle by which a rotation may tilt the vertical [deg]; None where it may tilt it at will.
        settings: How coarse cells are.
        source: How many rotations.
        rotation: How rotations are found.
        evidence: How much conflicts weigh.
    """
    # A scale turns no normal: the rotations are those of the map as it is.
    rotations = rotations_of_pair(
        a, b, max_lean=max_lean, max_rotations=source.max_rotations, settings=rotation
    )

    def search(scale: float) -> tuple[np.ndarray, np.ndarray]:
        return exhaustive_hypotheses(
            a.prepared,
            b.prepared if scale == 1.0 else scaled(b.prepared, scale),
            rotations,
            upright_frame(a.directions, a.shares),
            conflict_weight=evidence.coarse_conflict_weight,
            num_peaks=settings.num_peaks,
            settings=ExhaustiveConfig(max_cells=settings.max_cells),
        )

    poses, scores = [], []
    for scale in scales:
        # The map as it is is searched for its pose, and again for its scale.
        key = ("coarse search", scale, max_lean, settings, source, rotation, evidence)
        found, score = kept_of_pair(a, b, key, partial(search, scale))
        poses += [Start(scale, pose) for pose in found]
        scores.append(score)
    if not poses:
        return []
    # A pose comes once, with the scale at which it scores best: from its neighbours alignment leads to the same one.
    centroid = np.asarray(b.prepared.centroid, np.float64)
    rows = distinct_rows(
        np.stack([start.T_a_b[:3, :3] for start in poses]),
        np.stack([start.matrix[:3, :3] @ centroid + start.matrix[:3, 3] for start in poses]),
        scores=np.concatenate(scores),
        metres=settings.distinct_voxels * a.prepared.grid.voxel_size,
        degrees=settings.distinct_degrees,
        max_count=num_starts,
    )
    return [poses[row] for row in rows]
