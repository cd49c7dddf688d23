"""Fusion of maps whose poses are known: look all up in one lattice, then apply a rule voxel by voxel.

What is fused is `nearest`'s, block by block, or `soft`'s, which is differentiable and dense; this file has what both
share, and puts the blocks together in memory.
"""

import os
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from .._checks import InputError, check_choice, check_list, check_pose, check_voxel_size
from .._runtime.forks import refused_after_fork
from .._runtime.memory import check_memory
from .._runtime.placement import is_traced
from .._types import Array
from ..frames import check_near, snapped, to_local
from ..grid import VoxelGrid, check_grid, check_grids
from ..ops.blocks.block_builder import BlockBuilder
from ..ops.resampling.lattice import check_num_voxels, check_places, moved_bounds, origin_of_cell
from .nearest import ADVICE, BlockFusion, common_box, plan_fusion, with_content
from .rules import chosen_rule
from .soft import Lattice, check_soft_pose, fuse_soft, soft_fuse_memory
from .stored import check_out, check_processes, fuse_into_store


@refused_after_fork
def fuse(
    grids: Sequence[VoxelGrid],
    poses: Sequence[object],
    *,
    rule: str | None = None,
    voxel_size: float | None = None,
    interpolation: str = "nearest",
    onto: VoxelGrid | None = None,
    out: str | os.PathLike | None = None,
    num_processes: int = 1,
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
        out: Name of a Zarr store, ending in .zarr: the fused map is written there window by window, the same to the
            bit, and maps that are themselves in stores are read as needed, so that none has to fit the memory. An
            older store is replaced.
        num_processes: How many processes share the work with `out`; each writes a part of the store, which appears
            whole or not at all. To begin, each takes seconds, and a copy of maps that are in memory; maps in stores are
            read by each for itself.

    Returns:
        The fused map; with log-odds under the rule "log_odds" only, the others are about states. It is kept in blocks
        (but for "trilinear"), and so are maps that are given so: time and memory follow what they hold, not the box.
        With `out`: the map in the store, opened.

    Raises:
        InputError: If `grids` is no list of maps or an empty one, a pose is missing or not rigid, the fused map would
            reach farther than its voxels can be placed or need more memory than there is (`fuse_memory`), or the
            options do not go together.
    """
    check_choice("interpolation", interpolation, ("nearest", "trilinear"))
    store, num_processes = None if out is None else check_out(out), check_processes(num_processes, out)
    if interpolation == "trilinear":
        if out is not None:
            raise InputError(
                'out is for interpolation="nearest", got interpolation="trilinear"; leave it out.'
            )
        return _fuse_trilinear(grids, poses, rule, voxel_size, onto)
    if onto is not None:
        raise InputError(
            'onto is for interpolation="trilinear", got interpolation="nearest"; leave it out or give that.'
        )
    grids, matrices = _checked(grids, poses)
    rule = chosen_rule(rule, grids)
    if voxel_size is None:
        voxel_size = min(grid.voxel_size for grid in grids)
    voxel_size = check_voxel_size(voxel_size)
    plan = plan_fusion(grids, matrices, rule=rule, voxel_size=voxel_size, from_stores=store is not None)
    # Where nothing is known in any map, there is no box to fuse.
    nothing = VoxelGrid(np.zeros((1, 1, 1), np.uint8), np.zeros(3), voxel_size)
    if store is not None:
        return fuse_into_store(plan, nothing, store, num_processes=num_processes)
    return nothing if plan is None else _fused(plan)


def _fused(plan: BlockFusion) -> VoxelGrid:
    """The fused map in memory."""
    windows, rule = _with_content(plan), plan.rule
    # Refused before voxels are looked up; otherwise the system would kill the process.
    need = fuse_memory(sum(mixed for *_, mixed in windows), has_log_odds=rule == "log_odds")
    size = " x ".join(map(str, plan.shape))
    check_memory(need, f"a fused map of {size} voxels of {plan.voxel_size:g} m", ADVICE)
    states = BlockBuilder(plan.shape, np.uint8)
    log_odds = BlockBuilder(plan.shape, np.float32) if rule == "log_odds" else None
    for low, high, *_ in windows:
        for blocks in plan.blocks_in(low, high):
            _add(states, blocks.places, blocks.states)
            if log_odds is not None:
                _add(log_odds, blocks.places, blocks.log_odds)
    values = states.finish(), None if log_odds is None else log_odds.finish()
    return VoxelGrid(values[0], plan.origin, plan.voxel_size, values[1])


def _add(builder: BlockBuilder, places: np.ndarray, values: np.ndarray | None) -> None:
    """Put blocks into a map; one number for each block fills it."""
    assert values is not None
    (builder.put if values.ndim == 1 else builder.add)(places, values)


def _with_content(plan: BlockFusion) -> list[tuple[np.ndarray, np.ndarray, int]]:
    """Windows of a fused map in which something is known, and how many blocks of each are looked up."""
    found = []
    for low, high in plan.windows():
        level, mixed = plan.count(low, high)
        if level or mixed:
            found.append((low, high, mixed))
    return found


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
    if any(is_traced(part) for grid in grids for part in (_states(grid), grid.origin)):
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
    check_num_voxels(np.asarray(target.shape), "the fused map", ADVICE)
    check_places(np.stack(_extent(target)), target.voxel_size)
    need = soft_fuse_memory(int(np.prod(target.shape)), [grid.num_voxels for grid in grids])
    check_memory(need, f"a soft fused map of {' x '.join(map(str, target.shape))} voxels", ADVICE)
    whole = [_dense(_coarsened(grid, target.voxel_size)) for grid in grids]
    local = _soft_in_local_frames(whole, matrices, target)
    states, log_odds = fuse_soft(*local)
    return VoxelGrid(states, target.origin, target.voxel_size, log_odds)


def _states(grid: VoxelGrid) -> Array:
    """All states that a map has, each once at least."""
    return grid.state_blocks().pool if grid.is_sparse else grid.states


def _dense(grid: VoxelGrid) -> VoxelGrid:
    """The map as dense arrays, made once; they are looked at several times."""
    return VoxelGrid(grid.states, grid.origin, grid.voxel_size, grid.log_odds) if grid.is_sparse else grid


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
    grids, matrices = with_content(grids, matrices)
    found = common_box(_bounds([_coarsened(grid, size) for grid in grids], matrices, size))
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
        moved_bounds(
            g.state_blocks() if g.is_sparse else np.asarray(g.states),
            np.asarray(g.origin),
            g.voxel_size,
            T,
            voxel_size,
        )
        for g, T in zip(grids, matrices, strict=True)
    ]


def fuse_memory(num_blocks: int, *, has_log_odds: bool, fixed: float = 0.2e9) -> float:
    """Estimated peak beside the maps themselves and the running process [byte]; `python -m bench memory` measures it.

    It is 1.5 to 1.7 times what a site takes (372 and 1664 MB of 2490 x 2390 x 100 voxels, without and with log-odds),
    and up to 3.5 times what a building does, where the fixed part is most of it.

    Args:
        num_blocks: Blocks of 8 x 8 x 8 voxels of the fused map that are looked up, of which two thirds stay.
        has_log_odds: Whether log-odds are fused.
        fixed: What any fusion takes: compiled kernels, and the window that is worked on [byte].
    """
    # Blocks are put together from pieces, so that for a moment they are there twice.
    return fixed + 2.0 * 512 * (5 if has_log_odds else 1) * num_blocks


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
