"""Fusion of nearest voxels, block by block: what is fused, and how, for any window of the fused lattice.

`plan_fusion` decides where the fused map lies; `BlockFusion.blocks_in` then gives the blocks of a window of it, and
only those in which a map knows something. Windows are independent of each other, whichever way the lattice is cut: who
keeps the fused map anywhere else than in memory asks for one window after the other, and holds one of them at a time.
Maps that lie in a store are read as windows need them, if that is asked for.
"""

import functools
import zlib
from collections.abc import Iterator, Sequence
from itertools import compress
from typing import NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float32, Int, UInt8

from .._types import Array
from ..frames import snapped, to_local
from ..grid import VoxelGrid
from ..ops.blocks.block_array import BLOCK_VOXELS, BlockArray
from ..ops.blocks.windows import cut_tiles
from ..ops.blocks.words import BLOCK
from ..ops.resampling.block_lookup import (
    EMPTY,
    INSIDE,
    MIXED,
    OUTSIDE,
    PARTLY,
    MovedBlocks,
    Survey,
    check_target,
    padded,
    runs,
)
from ..ops.resampling.lattice import cell_of_image, moved_bounds, origin_of_cell
from ..ops.resampling.moved_store import MovedStore
from ..ops.resampling.rigid import source_from_target
from ..ops.resampling.stored import Stored
from .rules import fuse_keep, fuse_log_odds, fuse_paper, log_odds_of_states

ADVICE = "check the poses, leave out far maps, or give a larger voxel_size"

Pose = TypeVar("Pose")
"""Values of a pose, or what JAX traces."""

Bounds = tuple[Int[np.ndarray, "3"], Int[np.ndarray, "3"]]


class FusedBlocks(NamedTuple):
    """Blocks of a fused map.

    Attributes:
        places: (m, 3): block (i, j, k) begins at voxel (8 i, 8 j, 8 k) of the fused map.
        states: uint8 (m, 8, 8, 8), or (m,) for blocks that one state each fills. Where the fused map ends within a
            block, what lies beyond its end is of no meaning.
        log_odds: float32 likewise; None but under the rule "log_odds".
    """

    places: Int[np.ndarray, "m 3"]
    states: UInt8[np.ndarray, "m *block"]
    log_odds: Float32[np.ndarray, "m *block"] | None

    @property
    def is_level(self) -> bool:
        """Whether one value each fills the blocks."""
        return self.states.ndim == 1


class BlockFusion:
    """Maps that are to be fused, and where the result lies.

    Attributes:
        origin: float64 (3,) [m]: outer corner of voxel (0, 0, 0) of the fused map.
        shape: Number of voxels along x, y, z.
        voxel_size: Width of the voxels [m].
        rule: "paper", "keep" or "log_odds".
        sources: The maps that know something, in blocks or in a store.
    """

    def __init__(
        self,
        sources: list[MovedBlocks | MovedStore],
        origin: np.ndarray,
        shape: tuple[int, int, int],
        voxel_size: float,
        rule: str,
    ) -> None:
        """Take what `plan_fusion` has decided."""
        self.sources, self.origin, self.shape = sources, origin, shape
        self.voxel_size, self.rule = voxel_size, rule

    def windows(self, most: int = 1 << 23) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Windows in which maps may know something: lowest block and one past the highest of each, none twice.

        Args:
            most: Voxels of a window, about.
        """
        # Windows of windows: where the lattice is empty, few are looked at.
        many = 1 << 8
        for large in cut_tiles(self.shape, halo=0, most=many * most):
            first, last = large.low // BLOCK, -(-large.high // BLOCK)
            if self.holds_any(first, last):
                for small in cut_tiles(tuple((large.high - large.low).tolist()), halo=0, most=most):
                    low, high = first + small.low // BLOCK, first - (-small.high // BLOCK)
                    if self.holds_any(low, high):
                        yield low, high

    def holds_any(self, low: Int[np.ndarray, "3"], high: Int[np.ndarray, "3"]) -> bool:
        """Whether any map may know something in a window; a cheap question."""
        return any(source.holds_any(low, high) for source in self.sources)

    def blocks_in(self, low: Int[np.ndarray, "3"], high: Int[np.ndarray, "3"]) -> Iterator[FusedBlocks]:
        """The blocks of a window in which a map knows something, each once; all others are unknown.

        Args:
            low: Lowest block of the window; a whole number of blocks from the corner of the fused map.
            high: One past its highest. The memory that this takes grows with what is in the window.
        """
        near, level, mixed = self._survey(low, high)
        yield from self._fuse_level(low, near, np.nonzero(level))
        at = np.nonzero(mixed)
        if not len(at[0]):
            return
        # Maps that have nothing to say of a block are not asked: blocks go together that are up to the same maps.
        reaching = np.stack([self._takes_part(survey)[at] for _, survey in near])
        _, group = np.unique(np.packbits(reaching, axis=0).T, axis=0, return_inverse=True)
        places = low + np.stack(at, axis=1)
        for number in range(int(group.max()) + 1):
            chosen = np.flatnonzero(group.reshape(-1) == number)
            asked = [source for (source, _), says in zip(near, reaching[:, chosen[0]], strict=True) if says]
            yield from self._fuse_mixed(places[chosen], asked)

    def count(self, low: Int[np.ndarray, "3"], high: Int[np.ndarray, "3"]) -> tuple[int, int]:
        """How many blocks of a window one value fills, and how many are looked up voxel by voxel."""
        _, level, mixed = self._survey(low, high)
        return int(np.count_nonzero(level)), int(np.count_nonzero(mixed))

    def _survey(
        self, low: np.ndarray, high: np.ndarray
    ) -> tuple[list[tuple[MovedBlocks, Survey]], np.ndarray, np.ndarray]:
        """The maps near a window, and which of its blocks one value fills or have to be looked up, bool (u, v, w)."""
        shape = tuple((np.asarray(high) - low).tolist())
        is_known, is_mixed = np.zeros(shape, bool), np.zeros(shape, bool)
        # The paper's rule asks which maps' boxes reach a voxel, known or not.
        is_paper = self.rule == "paper" and self.holds_any(low, high)
        asked = [source for source in self.sources if is_paper or source.holds_any(low, high)]
        met = [part for part in (source.near(low, high) for source in asked) if part is not None]
        near = [(part, part.survey(low, high)) for part in met]
        for _, survey in near:
            is_known |= survey.kind != EMPTY
            is_mixed |= survey.kind == MIXED
            if is_paper:
                is_mixed |= survey.cover == PARTLY
        return near, is_known & ~is_mixed, is_known & is_mixed

    def _takes_part(self, survey: Survey) -> np.ndarray:
        """Whether a map has a say in the blocks of a window."""
        return survey.cover != OUTSIDE if self.rule == "paper" else survey.kind != EMPTY

    def _fuse_level(
        self, low: np.ndarray, near: list[tuple[MovedBlocks, Survey]], at: tuple[np.ndarray, ...]
    ) -> Iterator[FusedBlocks]:
        """The rule on one voxel a block."""
        places = low + np.stack(at, axis=1)
        for rows, length in runs(-(-len(places) // BLOCK_VOXELS)):
            part = slice(rows.start * BLOCK_VOXELS, rows.stop * BLOCK_VOXELS)

            def wide(values: np.ndarray, length: int = length) -> np.ndarray:
                return padded(values, length * BLOCK_VOXELS).reshape(length, BLOCK_VOXELS)

            values = tuple(tuple(map(wide, source.middles(places[part]))) for source, _ in near)
            covered = tuple(wide(survey.cover[at][part] == INSIDE) for _, survey in near)
            yield self._fused(places[part], values, covered, (-1,))

    def _fuse_mixed(self, places: np.ndarray, sources: list[MovedBlocks]) -> Iterator[FusedBlocks]:
        """The rule voxel by voxel."""
        lookups = [source.look_up(places) for source in sources]
        for part, length in runs(len(places)):
            values = tuple(look_up(part, length) for look_up in lookups)
            covered = None
            if self.rule == "paper":
                covered = tuple(source.covered(places[part], length) for source in sources)
            yield self._fused(places[part], values, covered, (-1, BLOCK, BLOCK, BLOCK))

    def _fused(
        self,
        places: np.ndarray,
        values: tuple[tuple[Array, ...], ...],
        covered: tuple[Array, ...] | None,
        shape: tuple[int, ...],
    ) -> FusedBlocks:
        """What the rule makes of padded values, in a shape that begins with the places."""
        states, log_odds = apply_rule(values, covered, rule=self.rule)
        count = len(places)
        odds = None if log_odds is None else np.asarray(log_odds).reshape(shape)[:count]
        return FusedBlocks(places, np.asarray(states).reshape(shape)[:count], odds)


@functools.partial(jax.jit, static_argnames=("rule",))
def apply_rule(
    values: tuple[tuple[Array, ...], ...], covered: tuple[Array, ...] | None, *, rule: str
) -> tuple[Array, Array | None]:
    """A rule on voxels of several maps: their states and, under the rule "log_odds", log-odds.

    Args:
        values: States uint8 of each map and, where it has them, log-odds float32 of the same shape.
        covered: Whether the voxels lie in each map's box; for the rule "paper" alone.
        rule: One of `rules.RULES`.
    """
    states = jnp.stack([of_map[0] for of_map in values])
    if rule == "paper":
        assert covered is not None
        return fuse_paper(states, jnp.stack(covered)), None
    if rule == "keep":
        return fuse_keep(states), None
    odds = [of_map[-1] if len(of_map) == 2 else log_odds_of_states(of_map[0]) for of_map in values]
    return fuse_log_odds(states, jnp.stack(odds))


def plan_fusion(
    grids: Sequence[VoxelGrid],
    poses: Sequence[np.ndarray],
    *,
    rule: str,
    voxel_size: float,
    from_stores: bool = False,
) -> BlockFusion | None:
    """Decide where a fused map lies and put the maps into blocks.

    Args:
        grids: Maps.
        poses: `T_world_map` (4, 4) float64 of each, rigid.
        rule: One of `rules.RULES`.
        voxel_size: Width of the voxels of the result [m]; finer maps are coarsened to it, in memory.
        from_stores: Whether maps that lie in a store stay there: each window then reads what it needs of them. Else
            they are read once.

    Returns:
        What is to be fused, or None where no map knows anything.

    Raises:
        InputError: If the fused map would have more than 2**31 blocks, or lies too far from the origin of its frame.
    """
    grids, poses = with_content(grids, poses)
    coarse = [grid if grid.voxel_size >= voxel_size else grid.with_voxel_size(voxel_size) for grid in grids]
    local, matrices, zero = _in_local_frames(coarse, poses, voxel_size)
    kept = [_stored(grid) if from_stores and grid.is_stored else grid.state_blocks() for grid in local]
    bounds = [
        moved_bounds(states, np.asarray(grid.origin), grid.voxel_size, T, voxel_size)
        for states, grid, T in zip(kept, local, matrices, strict=True)
    ]
    found = common_box(bounds)
    if found is None:
        return None
    low, shape = found
    x, y, z = shape.tolist()
    check_target((x, y, z), "the fused map", ADVICE)
    sources = []
    for grid, states, T, (first, end) in zip(local, kept, matrices, bounds, strict=True):
        # A map that knows nothing has an empty box and adds nothing.
        if (end > first).all():
            # Backward, from the fused grid to the map: each fused voxel asks what lies at its place.
            affine = source_from_target(T, np.asarray(grid.origin), grid.voxel_size, low, voxel_size)
            sources.append(_source(grid, states, affine, with_log_odds=rule == "log_odds"))
    if rule == "log_odds":  # the only one whose values are rounded
        sources = _in_one_order(sources)
    return BlockFusion(sources, origin_of_cell(low + zero, voxel_size), (x, y, z), voxel_size, rule)


def with_content(grids: Sequence[VoxelGrid], poses: Sequence[Pose]) -> tuple[list[VoxelGrid], list[Pose]]:
    """Maps that may know something, with their poses; all of them where none does.

    A map that knows nothing adds nothing wherever it lies, and must not make the box reach there.
    """
    # Of a store, the list of its chunks is all that is looked at.
    known = [len(g.cubes(BLOCK)) > 0 if g.is_sparse else bool(np.any(g.known_box()[1])) for g in grids]
    if not any(known):
        return list(grids), list(poses)
    return list(compress(grids, known)), list(compress(poses, known))


def common_box(bounds: Sequence[Bounds]) -> Bounds | None:
    """Lowest cell and shape of the box around all maps, by the cells of each; None if nothing is known in any."""
    filled = [(low, high) for low, high in bounds if (high > low).all()]
    if not filled:
        return None
    low = np.min([low for low, _ in filled], axis=0)
    return low, np.max([high for _, high in filled], axis=0) - low


def _in_local_frames(
    grids: Sequence[VoxelGrid], matrices: Sequence[np.ndarray], voxel_size: float
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


def _stored(grid: VoxelGrid, *, with_log_odds: bool = False) -> Stored:
    """What is read of a map in a store; its cubes are small enough for windows to leave out what is empty."""
    side = 8 * BLOCK
    cubes = np.zeros([-(-n // side) for n in grid.shape], bool)
    cubes[tuple(grid.cubes(side).T)] = True
    # Of a module, so that a plan goes to other processes.
    read = functools.partial(_read_window, grid, with_log_odds)
    return Stored(grid.shape, cubes, side, read, 2 if with_log_odds and grid.has_log_odds else 1)


def _read_window(
    grid: VoxelGrid, with_log_odds: bool, low: tuple[int, ...], high: tuple[int, ...]
) -> tuple[np.ndarray, ...]:
    """States of a window and, if they are asked for and there, log-odds."""
    log_odds = grid.log_odds_in(low, high) if with_log_odds else None
    states = grid.states_in(low, high)
    return (states,) if log_odds is None else (states, log_odds)


def _source(
    grid: VoxelGrid, states: BlockArray | Stored, affine: np.ndarray, *, with_log_odds: bool
) -> MovedBlocks | MovedStore:
    """A map that is to be looked up; its log-odds only where they are asked for."""
    if isinstance(states, Stored):
        return MovedStore(_stored(grid, with_log_odds=with_log_odds), affine)
    log_odds = grid.log_odds_blocks() if with_log_odds else None
    return MovedBlocks((states,) if log_odds is None else (states, log_odds), affine)


def _in_one_order(sources: list[MovedBlocks | MovedStore]) -> list[MovedBlocks | MovedStore]:
    """Maps in an order that follows from what they hold and where, whatever order they were given in.

    A sum of three log-odds or more is rounded as it is ordered, and where it is about zero, the state follows.
    """
    places = [(source.affine.tobytes(), source.shape) for source in sources]
    sums: list[tuple[int, ...]] = [()] * len(sources)
    # What maps hold is looked at only where they lie at one place; two may be added either way.
    if len(sources) > 2 and len(set(places)) < len(places):
        sums = [_checksums(source) for source in sources]
    order = sorted(range(len(sources)), key=lambda number: (places[number], sums[number]))
    return [sources[number] for number in order]


def _checksums(source: MovedBlocks | MovedStore) -> tuple[int, ...]:
    """Checksums of places and values of blocks that are not all 0, of each array, wherever the map is kept."""
    found = []
    for number in range(source.num_arrays):
        of_places, of_values = 0, 0
        for index, blocks in source.parts(number):
            of_places = zlib.crc32(np.ascontiguousarray(index, np.int64).view(np.uint8).data, of_places)
            of_values = zlib.crc32(np.ascontiguousarray(blocks).view(np.uint8).data, of_values)
        found += [of_places, of_values]
    return tuple(found)
