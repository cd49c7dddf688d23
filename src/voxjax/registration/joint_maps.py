"""From N maps to the residuals between them: common tables, and which pairs see the same surfaces."""

import itertools
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from .._tables import as_table, table_lengths
from .._types import Array
from ..ops.lookup import Block, lookup
from ..ops.nearest import INDEX_BITS, NOTHING_NEAR
from ..refinement.atlas import AtlasSurface
from ..refinement.joint_equations import relative_pose
from ..refinement.joint_problem import JointProblem, edges_of
from ..refinement.losses import Loss
from ..refinement.planes import SLIDE_WEIGHT, Planes, Sample
from ..refinement.pose import PoseProblem
from .prepared import PreparedMap, sample_rows
from .problem import radius_of, sample_of

OVERLAP_POINTS = 1024
"""Voxels of each map that are looked up in another to see whether they overlap."""

MIN_SHARE = 0.1
"""Two maps overlap if so many of the voxels of one, by leverage, are within reach of the other's surfaces."""


class _NoRoom(Exception):
    """Too many voxels for one table."""


def joint_problem(
    maps: Sequence[PreparedMap | None],
    pairs: Sequence[tuple[int, int]],
    is_fixed: np.ndarray,
    *,
    num_points: int,
    loss: Loss,
) -> JointProblem:
    """Points of both maps of each pair against the planes of the other, each way with half of the weight.

    Args:
        maps: None for maps without an occupied voxel, which are in no pair.
        pairs: Numbers of the maps that are held against each other, at least one pair.
        is_fixed: bool (maps,): which maps keep their pose.
        num_points: Voxels of each sample.
        loss: What a large offset costs.
    """
    used = sorted(set(itertools.chain(*pairs)))
    filled = {number: prepared for number in used if (prepared := maps[number]) is not None}
    surfaces = dict(zip(filled, _surfaces(list(filled.values())), strict=True))
    samples = {number: _half(sample_of(prepared, num_points)) for number, prepared in filled.items()}
    radii = {number: radius_of(sample) for number, sample in samples.items()}
    slide = np.asarray(SLIDE_WEIGHT, np.float32)

    def problem(a: int, b: int) -> PoseProblem:
        is_signed = jnp.asarray(filled[a].has_free_space and filled[b].has_free_space)
        on_a, on_b = (surfaces[number]._replace(is_signed=is_signed) for number in (a, b))
        forth = Planes(on_a, samples[b], slide, loss)
        return PoseProblem(
            (forth, Planes(on_b, samples[a], slide, loss, is_inverse=True)), samples[b].centroid, radii[b]
        )

    nowhere, one = np.zeros(3, np.float32), np.float32(1.0)
    return JointProblem(
        edges_of([(a, b, problem(a, b)) for a, b in pairs]),
        jnp.asarray(
            [samples[n].centroid if n in filled else nowhere for n in range(len(maps))], jnp.float32
        ),
        jnp.asarray([radii.get(n, one) for n in range(len(maps))], jnp.float32),
        jnp.asarray(is_fixed),
    )


def overlapping_pairs(
    maps: Sequence[PreparedMap | None], poses: Float[np.ndarray, "maps 4 4"]
) -> list[tuple[int, int]]:
    """Pairs (a, b), a < b, of maps that overlap under the poses, by the greater share of the two ways."""
    filled = [number for number, prepared in enumerate(maps) if prepared is not None]
    points = {number: _points(maps[number]) for number in filled}

    def share(a: int, b: int) -> float:
        return float(_share_in_reach(maps[a].keys, maps[a].block, poses[a], poses[b], points[b]))

    return [
        (a, b) for a, b in itertools.combinations(filled, 2) if max(share(a, b), share(b, a)) >= MIN_SHARE
    ]
