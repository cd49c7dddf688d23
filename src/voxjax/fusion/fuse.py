"""Fusion of maps whose poses are known: resample all into one lattice, then apply a rule voxel by voxel."""

import zlib
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .._checks import InputError, check_choice, check_list, check_pose, check_voxel_size
from .._runtime.forks import refused_after_fork
from .._runtime.memory import check_memory
from .._runtime.placement import is_traced
from ..frames import check_near, snapped, to_local
from ..grid import VoxelGrid, check_grid, check_grids
from ..ops.resampling.lattice import (
    cell_of_image,
    check_num_voxels,
    check_places,
    moved_bounds,
    origin_of_cell,
)
from ..ops.resampling.rigid import chunk_size, flat_source, lookup_chunk, source_from_target, take_flat
from .rules import RULES, fuse_keep, fuse_log_odds, fuse_paper, log_odds_of_states
from .soft import Lattice, check_soft_pose, fuse_soft, soft_fuse_memory

_ADVICE = "check the poses, leave out far maps, or give a larger voxel_size"


@refused_after_fork
def fuse(
    grids: Sequence[VoxelGrid],
    poses: Sequence[object],
    *,
    rule: str | None = None,
    voxel_size: float | None = None,
    interpolation: str = "nearest",
    onto: VoxelGrid | None = None,
) -> VoxelGrid:
    """Fuse maps into one, in the frame that the poses map into.

    The result lies on the lattice of whole multiples of the voxel size, so it can be written as an OctoMap
    file; a map that lies on that lattice and has the identity as its pose is copied voxel for voxel. Other
    maps are looked up backward, nearest voxel, so that surfaces get no holes.

    Args:
        grids: One or more maps.
        poses: For each map the (4, 4) rigid transform of its points into the common frame, `T_world_map`.
        rule: "paper" (IV.D), "keep" (what any map knows), "log_odds" (sum of evidence), see `fusion.rules`;
            None is "log_odds" if every map has log-odds, else "keep".
        voxel_size: Edge length of the result's voxels [m]. None is the finest of the maps': no detail is lost, and
            the result does not depend on their order. Maps finer than it are coarsened first, occupied parts winning.
        interpolation: "nearest", or "trilinear" between log-odds, for the rule "log_odds" only (None is that
            rule here): the fused log-odds, which are not limited then, are differentiable in the poses and in
            the maps' log-odds under JAX's transformations, see `soft.fuse_soft`.
        onto: For "trilinear": a map whose origin, shape and voxel size the result takes; its values are not
            looked at. Poses that are traced by JAX need it, because they cannot decide a shape.

    Returns:
        The fused map; with log-odds under the rule "log_odds" only, the others are about states.

    Raises:
        InputError: If `grids` is no list of maps or an empty one, a pose is missing or not rigid, the fused map would
            have more than 2**31 - 1 voxels or need more memory than there is (`fuse_memory`), or the options do not go
            together.
    """
    check_choice("interpolation", interpolation, ("nearest", "trilinear"))
    if interpolation == "trilinear":
        return _fuse_trilinear(grids, poses, rule, voxel_size, onto)
    if onto is not None:
        raise InputError(
            'onto is for interpolation="trilinear", got interpolation="nearest"; leave it out or give that.'
        )
    grids, matrices = _checked(grids, poses)
    if rule is None:
        # States alone do not say how sure a map is, so evidence is added only where all maps have it.
        rule = "log_odds" if all(grid.log_odds is not None for grid in grids) else "keep"
    check_choice("rule", rule, RULES)
    if voxel_size is None:
        voxel_size = min(grid.voxel_size for grid in grids)
    return _fuse_nearest(grids, matrices, rule, check_voxel_size(voxel_size))


def _fuse_nearest(
    grids: list[VoxelGrid], matrices: list[np.ndarray], rule: str, voxel_size: float
) -> VoxelGrid:
    """`fuse` with interpolation="nearest", its options decided."""
    grids, matrices, zero = _in_local_frames(
        [_coarsened(grid, voxel_size) for grid in grids], matrices, voxel_size
    )
    bounds = _bounds(grids, matrices, voxel_size)
    found = _common_box(bounds)
    if found is None:  # nothing is known in any map, so there is no box to fuse
        return VoxelGrid(np.zeros((1, 1, 1), np.uint8), np.zeros(3), voxel_size)
    low, shape = found
    # Refused before anything is put on the device; otherwise the system would kill the process.
    need = fuse_memory(
        int(np.prod(shape)), [grid.states.size for grid in grids], has_log_odds=rule == "log_odds"
    )
    check_memory(need, f"a fused map of {' x '.join(map(str, shape))} voxels of {voxel_size:g} m", _ADVICE)
    # A map that knows nothing has an empty box and adds nothing.
    sources = [
        _source(grid, T, voxel_size, low, bound)
        for grid, T, bound in zip(grids, matrices, bounds, strict=True)
        if (bound[1] > bound[0]).all()
    ]
    if rule == "log_odds":  # the only one whose values are rounded
        sources = _in_one_order(sources)
    states, log_odds = _fuse_chunks(sources, shape, rule)
    return VoxelGrid(states, origin_of_cell(low + zero, voxel_size), voxel_size, log_odds)


def _in_local_frames(
    grids: list[VoxelGrid], matrices: list[np.ndarray], voxel_size: float
) -> tuple[list[VoxelGrid], list[np.ndarray], np.ndarray]:
    """Maps and poses in local frames, and the cell of the fused lattice, int64 (3,), at which the common one begins."""
    local, places = zip(*(grid.localized() for grid in grids), strict=True)
    # The lowest of all, so that the result does not depend on the order of the maps.
    cells = [cell_of_image(T, place, voxel_size) for T, place in zip(matrices, places, strict=True)]
    zero = np.min(cells, axis=0)
    origin = origin_of_cell(zero, voxel_size)
    poses = [
        snapped(to_local(T, origin, place), voxel_size) for T, place in zip(matrices, places, strict=True)
    ]
    return list(local), poses, zero


def _fuse_trilinear(
    grids: Sequence[VoxelGrid],
    poses: Sequence[object],
    rule: str | None,
    voxel_size: float | None,
    onto: VoxelGrid | None,
) -> VoxelGrid:
    """`fuse` with interpolation="trilinear"."""
    if rule not in (None, "log_odds"):
        raise InputError(
            f'interpolation="trilinear" is for rule="log_odds", got rule={rule!r}; leave it out.'
        )
    grids, matrices = _checked(grids, poses, check_soft_pose)
    # Where voxels lie and which are known decides shapes and lookups, which have no derivative.
    if any(is_traced(part) for grid in grids for part in (grid.states, grid.origin)):
        raise InputError(
            "states and origins of grids must not be traced by JAX; pass poses and log-odds alone through jit and grad."
        )
    if onto is not None:
        check_grid("onto", onto)
        if voxel_size is not None:
            raise InputError(
                "voxel_size must be None where onto is given, whose voxel size the result takes."
            )
        target = Lattice(np.asarray(onto.origin, np.float64), onto.shape, onto.voxel_size)
    else:
        target = _chosen_lattice(grids, matrices, voxel_size)
    check_num_voxels(np.asarray(target.shape), "the fused map", _ADVICE)
    check_places(np.stack(_extent(target)), target.voxel_size)
    need = soft_fuse_memory(int(np.prod(target.shape)), [grid.states.size for grid in grids])
    check_memory(need, f"a soft fused map of {' x '.join(map(str, target.shape))} voxels", _ADVICE)
    local = _soft_in_local_frames([_coarsened(grid, target.voxel_size) for grid in grids], matrices, target)
    states, log_odds = fuse_soft(*local)
    return VoxelGrid(states, target.origin, target.voxel_size, log_odds)


def _extent(lattice: Lattice) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest outer corner of a lattice [m]."""
    return lattice.origin, lattice.origin + lattice.voxel_size * np.asarray(lattice.shape)


def _soft_in_local_frames(
    grids: list[VoxelGrid], matrices: list, target: Lattice
) -> tuple[list[VoxelGrid], list, Lattice]:
    """Maps, poses and result in local frames; as they are where a pose is traced, which has the digits that JAX gives.

    Raises:
        InputError: If a pose is traced and a map, or the result, lies too far from the origin of its frame.
    """
    if any(is_traced(matrix) for matrix in matrices):
        extents = {f"grids[{number}]": grid.extent for number, grid in enumerate(grids)}
        for what, (low, high) in (extents | {"the fused map": _extent(target)}).items():
            check_near(what, low, high, target.voxel_size, "with poses that JAX traces give grid.localized()")
        return grids, matrices, target
    local, places = zip(*(grid.localized() for grid in grids), strict=True)
    poses = [
        snapped(to_local(T, target.origin, place), target.voxel_size)
        for T, place in zip(matrices, places, strict=True)
    ]
    return list(local), poses, target._replace(origin=np.zeros(3))


def _chosen_lattice(grids: list[VoxelGrid], matrices: list, voxel_size: float | None) -> Lattice:
    """The lattice that nearest fusion takes."""
    if any(is_traced(matrix) for matrix in matrices):
        raise InputError(
            "onto must be given where poses are traced by JAX (jit, grad, vmap): the shape of the result must be known."
        )
    size = min(grid.voxel_size for grid in grids) if voxel_size is None else voxel_size
    size = check_voxel_size(size)
    found = _common_box(_bounds([_coarsened(grid, size) for grid in grids], matrices, size))
    low, shape = (np.zeros(3, np.int64), np.ones(3, np.int64)) if found is None else found
    x, y, z = shape.tolist()
    return Lattice(origin_of_cell(low, size), (x, y, z), size)


def _coarsened(grid: VoxelGrid, voxel_size: float) -> VoxelGrid:
    """The map, coarsened if it is finer: a lookup of nearest voxels would miss thin walls."""
    if grid.voxel_size >= voxel_size:
        return grid
    if is_traced(grid.log_odds):
        raise InputError(
            f"a map whose log-odds are traced by JAX must not be finer than the result, got {grid.voxel_size:g} m "
            f"and {voxel_size:g} m; coarsen it first."
        )
    return grid.with_voxel_size(voxel_size)


def _bounds(grids: list[VoxelGrid], matrices: list, voxel_size: float) -> list[tuple[np.ndarray, np.ndarray]]:
    """Cells of the lattice that each map can fill: lowest, and one past the highest."""
    return [
        moved_bounds(np.asarray(g.states), np.asarray(g.origin), g.voxel_size, T, voxel_size)
        for g, T in zip(grids, matrices, strict=True)
    ]


def _common_box(bounds: list[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray] | None:
    """Lowest cell and shape of the box around all maps; None if nothing is known in any."""
    filled = [(low, high) for low, high in bounds if (high > low).all()]
    if not filled:
        return None
    low = np.min([low for low, _ in filled], axis=0)
    shape = np.max([high for _, high in filled], axis=0) - low
    check_num_voxels(shape, "the fused map", _ADVICE)
    return low, shape


def fuse_memory(
    num_fused: int, num_voxels: Sequence[int], *, has_log_odds: bool, fixed: float = 0.2e9
) -> float:
    """Estimated peak beside the maps themselves and the running process [byte]; `python -m bench memory` measures it.

    Args:
        num_fused: Voxels of the fused map: its states, the mask that counts them, its log-odds.
        num_voxels: Voxels of each map, padded by up to a half and copied to the device.
        has_log_odds: Whether log-odds are fused.
        fixed: What any fusion takes: compiled kernels, and the chunks that are worked on [byte].
    """
    per_voxel = 5 if has_log_odds else 1
    return fixed + num_fused * (per_voxel + 1.0) + 1.5 * per_voxel * (sum(num_voxels) + max(num_voxels))


class _Source(NamedTuple):
    """A map on the device, and where it lies in the fused grid.

    Attributes:
        states: Flat and padded, see `flat_source`.
        log_odds: Flat and padded likewise, or None.
        shape: Number of voxels along x, y, z before padding, int32.
        affine: From voxels of the fused grid to those of the map, see `source_from_target`.
        x_range: First and one past the last plane of the fused grid that the map can fill.
    """

    states: jax.Array
    log_odds: jax.Array | None
    shape: np.ndarray
    affine: np.ndarray
    x_range: tuple[int, int]


def _source(
    grid: VoxelGrid, T: np.ndarray, voxel_size: float, low: np.ndarray, bound: tuple[np.ndarray, np.ndarray]
) -> _Source:
    """Put a map on the device; `low` is the first cell of the fused grid, `bound` the cells that the map can fill."""
    log_odds = None if grid.log_odds is None else flat_source(np.asarray(grid.log_odds))
    # Backward, from the fused grid to the map: each fused voxel asks what lies at its place, so that none is missed.
    affine = source_from_target(T, np.asarray(grid.origin), grid.voxel_size, low, voxel_size)
    x_range = int(bound[0][0] - low[0]), int(bound[1][0] - low[0])
    shape = np.asarray(grid.shape, np.int32)
    return _Source(flat_source(np.asarray(grid.states)), log_odds, shape, affine, x_range)


def _in_one_order(sources: list[_Source]) -> list[_Source]:
    """Maps in an order that follows from what they hold and where, whatever order they were given in.

    A sum of three log-odds or more is rounded as it is ordered, and where it is about zero, the state follows.
    """
    if len(sources) < 3:
        return sources

    def key(source: _Source) -> tuple:
        values = (source.states, source.log_odds)
        sums = (0 if each is None else zlib.crc32(np.asarray(each).view(np.uint8).data) for each in values)
        return source.affine.tobytes(), source.shape.tobytes(), *sums

    return sorted(sources, key=key)


def _fuse_chunks(
    sources: list[_Source], shape: np.ndarray, rule: str
) -> tuple[np.ndarray, np.ndarray | None]:
    """Fill the fused grid in runs of flat indices, so that memory hardly grows with the number of maps."""
    num_voxels = int(np.prod(shape))
    fused = np.zeros(num_voxels, np.uint8)
    fused_odds = np.zeros(num_voxels, np.float32) if rule == "log_odds" else None
    # Chunks of one size, whose kernel all maps share; a plane of the grid is a run of flat indices.
    size, slab = chunk_size(num_voxels), int(shape[1] * shape[2])
    target_shape = shape.astype(np.int32)
    for start in range(0, num_voxels, size):
        stop = min(start + size, num_voxels)
        # The paper's rule asks which maps' boxes reach a voxel, and boxes reach farther than what is known in them.
        near = [
            source
            for source in sources
            if rule == "paper" or (source.x_range[0] * slab < stop and source.x_range[1] * slab > start)
        ]
        if not near:
            continue
        states, odds = _fuse_chunk(near, target_shape, start, size, rule)
        fused[start:stop] = np.asarray(states)[: stop - start]
        if fused_odds is not None:
            fused_odds[start:stop] = np.asarray(odds)[: stop - start]
    sides = tuple(shape.tolist())
    return fused.reshape(sides), None if fused_odds is None else fused_odds.reshape(sides)


def _fuse_chunk(
    sources: list[_Source], target_shape: np.ndarray, start: int, size: int, rule: str
) -> tuple[jax.Array, jax.Array | None]:
    """States and, under the rule "log_odds", log-odds of `size` voxels of the fused grid from `start` on."""
    states, covered, odds = [], [], []
    for source in sources:
        index, is_inside = lookup_chunk(source.shape, source.affine, target_shape, np.int32(start), size=size)
        states.append(take_flat(source.states, index, is_inside))
        covered.append(is_inside)
        if rule == "log_odds":
            has_odds = source.log_odds is not None
            odds.append(
                take_flat(source.log_odds, index, is_inside) if has_odds else log_odds_of_states(states[-1])
            )
    if rule == "paper":
        return fuse_paper(jnp.stack(states), jnp.stack(covered)), None
    if rule == "log_odds":
        return fuse_log_odds(jnp.stack(states), jnp.stack(odds))
    return fuse_keep(jnp.stack(states)), None


def _checked(
    grids: Sequence[VoxelGrid], poses: Sequence[object], check: Callable[[str, object], Any] = check_pose
) -> tuple[list[VoxelGrid], list]:
    """Maps and poses as lists of one length, each pose as `check` returns it."""
    grids, poses = check_grids("grids", grids), check_list("poses", poses, "(4, 4) poses")
    if not grids:
        raise InputError("grids must hold at least one map, got none.")
    if len(poses) != len(grids):
        raise InputError(f"poses must hold one pose a map, got {len(poses)} poses for {len(grids)} maps.")
    for number, pose in enumerate(poses):
        if pose is None:
            raise InputError(
                f"poses[{number}] is None: that map has no place; leave it out of grids and poses."
            )
    return grids, [check(f"poses[{number}]", pose) for number, pose in enumerate(poses)]
