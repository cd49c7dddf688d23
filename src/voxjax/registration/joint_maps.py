"""From N maps to the residuals between them: common tables, and which pairs see the same surfaces."""

import itertools
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from .. import rigid
from .._checks import InputError
from .._tables import as_table, table_lengths
from .._types import Array
from ..ops.lookup import Block, lookup
from ..ops.nearest import INDEX_BITS, NOTHING_NEAR
from ..refinement.atlas import AtlasSurface
from ..refinement.joint_equations import relative_pose
from ..refinement.joint_problem import JointProblem, edges_of
from ..refinement.losses import Loss
from ..refinement.planes import SLIDE_WEIGHT, Planes, Sample
from ..refinement.problem import PoseProblem
from .map_views import hard_view
from .prepared import PreparedMap, sample_rows
from .problem import radius_of, sample_of

OVERLAP_POINTS = 1024
"""Voxels of each map that are looked up in another to see whether they overlap."""

MIN_SHARE = 0.1
"""Two maps overlap if so many of the voxels of one, by leverage, are within reach of the other's surfaces."""


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
    samples = {
        number: _half(sample_of(hard_view(prepared), num_points)) for number, prepared in filled.items()
    }
    radii = {number: radius_of(sample) for number, sample in samples.items()}
    slide = np.asarray(SLIDE_WEIGHT, np.float32)

    def problem(a: int, b: int) -> PoseProblem:
        is_signed = np.asarray(filled[a].has_free_space and filled[b].has_free_space)
        on_a, on_b = (surfaces[number]._replace(is_signed=is_signed) for number in (a, b))
        forth = Planes(on_a, samples[b], slide, loss)
        return PoseProblem(
            (forth, Planes(on_b, samples[a], slide, loss, is_inverse=True)), samples[b].centroid, radii[b]
        )

    nowhere, one = np.zeros(3, np.float32), np.float32(1.0)
    return JointProblem(
        edges_of([(a, b, problem(a, b)) for a, b in pairs]),
        jnp.asarray([samples[n].centroid if n in filled else nowhere for n in range(len(maps))], jnp.float32),
        jnp.asarray([radii.get(n, one) for n in range(len(maps))], jnp.float32),
        jnp.asarray(is_fixed),
    )


def overlapping_pairs(
    maps: Sequence[PreparedMap | None], poses: Float[np.ndarray, "maps 4 4"]
) -> list[tuple[int, int]]:
    """Pairs (a, b), a < b, of maps that overlap under the poses, by the greater share of the two ways."""
    filled = {number: prepared for number, prepared in enumerate(maps) if prepared is not None}
    points = {number: _points(prepared) for number, prepared in filled.items()}

    def share(a: int, b: int) -> float:
        T_a_b = relative_pose(jnp.asarray(poses[a]), jnp.asarray(poses[b]))
        return float(_share_in_reach(filled[a].keys, filled[a].block, T_a_b, points[b]))

    return [
        (a, b) for a, b in itertools.combinations(filled, 2) if max(share(a, b), share(b, a)) >= MIN_SHARE
    ]


def connected_parts(num_maps: int, pairs: Sequence[tuple[int, int]]) -> np.ndarray:
    """Of each map, the lowest number of the maps that pairs connect it with: int (maps,)."""
    part = np.arange(num_maps)
    for a, b in pairs:
        part[part == max(part[a], part[b])] = min(part[a], part[b])
    return part


@jax.jit
def _share_in_reach(keys: Array, block: tuple[Array, Array, Array], T_a_b: Array, points: Array) -> Array:
    """Share of points of b with a voxel of a in reach of the field."""
    near = lookup(keys, Block(*block), rigid.apply(T_a_b, points), NOTHING_NEAR) != NOTHING_NEAR
    return jnp.mean(near, dtype=jnp.float32)


def _points(prepared: PreparedMap) -> np.ndarray:
    return np.asarray(prepared.points)[sample_rows(prepared, OVERLAP_POINTS)]


def _half(sample: Sample) -> Sample:
    """The sample with half of its weight."""
    return sample._replace(weights=np.float32(0.5) * sample.weights)


def _surfaces(maps: Sequence[PreparedMap]) -> list[AtlasSurface]:
    """Surfaces of the maps in common tables, of lengths that are few."""
    sizes = [int(np.prod(np.asarray(prepared.dims), dtype=np.int64)) for prepared in maps]
    counts = [prepared.num_points for prepared in maps]
    if sum(sizes) > np.iinfo(np.int32).max or sum(counts) >= 1 << INDEX_BITS:
        raise InputError(
            f"grids must have fewer than {np.iinfo(np.int32).max} voxels and {1 << INDEX_BITS} occupied ones "
            f"together, got {sum(sizes)} and {sum(counts)}; refine them at a larger voxel size."
        )
    first_cells, first_rows = (np.cumsum([0, *numbers])[:-1].tolist() for numbers in (sizes, counts))
    num_cells, num_rows = table_lengths(sum(sizes), sum(counts))

    def keys(prepared: PreparedMap, size: int, row: int) -> np.ndarray:
        own = np.asarray(prepared.keys)[:size]
        return np.where(own == NOTHING_NEAR, own, own + np.uint32(row))

    def table(parts: Sequence[np.ndarray], length: int) -> Array:
        return jax.device_put(as_table(np.concatenate(parts), length))

    all_keys = table([keys(*each) for each in zip(maps, sizes, first_rows, strict=True)], num_cells)
    rows = [
        table([np.asarray(getattr(prepared, name))[: prepared.num_points] for prepared in maps], num_rows)
        for name in ("anchors", "normals", "planarity")
    ]
    anchors, normals, planarity = rows
    return [
        AtlasSurface(
            keys=all_keys,
            dims=np.append(np.asarray(prepared.dims), cell).astype(np.int32),
            origin=prepared.block[1],
            voxel_size=prepared.block[2],
            points=anchors,
            normals=normals,
            planarity=planarity,
            is_signed=np.asarray(False),
        )
        for prepared, cell in zip(maps, first_cells, strict=True)
    ]
