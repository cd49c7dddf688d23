"""Generated sites: buildings on a hillside with roads between them, as two maps that share a part.

The box around a site has some thousand voxels a side and is nearly empty: what a surveyor's or a robot's map of a
campus looks like. Maps are put together in blocks, so that no site is too large to be made.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

import voxjax as vx
from bench.worlds import MapPair
from voxjax.ops.blocks.block_array import BlockArray
from voxjax.ops.blocks.block_builder import BlockBuilder
from voxjax.ops.blocks.words import BLOCK
from voxjax.synthetic import simulate_team


@dataclass(frozen=True)
class Site:
    """What a site is made of.

    Attributes:
        sides: Extent along x, y, z [m]; buildings lie anywhere in it, each at a height of its own.
        num_buildings: How many there are; the first two thirds are in one map, the last two thirds in the other.
        voxel_size: Edge length of a voxel [m].
        drift: Standard deviation of where a map believes each building and each stretch of road to be [m].
    """

    sides: tuple[float, float, float] = (350.0, 340.0, 34.0)
    num_buildings: int = 9
    voxel_size: float = 0.1
    drift: float = 0.03

    @property
    def columns(self) -> int:
        """How many buildings stand along x."""
        return max(round(np.sqrt(self.num_buildings * self.sides[0] / self.sides[1])), 1)


def simulate_site(seed: int, site: Site | None = None) -> MapPair:
    """Two maps of a site, of which both have the buildings in the middle.

    Args:
        seed: Same seed and site, same maps.
        site: None takes the default.
    """
    site = Site() if site is None else site
    rng = np.random.default_rng([seed, 0])
    yaw = Rotation.from_rotvec([0.0, 0.0, rng.uniform(-np.pi, np.pi)]).as_matrix()
    T_site_b = np.eye(4)
    T_site_b[:3, :3], T_site_b[:3, 3] = yaw, rng.uniform(-1.0, 1.0, 3) * (50.0, 50.0, 5.0)
    frames = np.eye(4), T_site_b
    pieces: tuple[list[vx.VoxelGrid], list[vx.VoxelGrid]] = ([], [])
    for seen, T_site_piece in _pieces(rng, seed, site):
        for which, grid in enumerate(seen):
            if grid is None:
                continue
            drifted = np.array(T_site_piece)
            drifted[:3, 3] += rng.normal(scale=site.drift, size=3)
            pieces[which].append(grid.transformed(np.linalg.inv(frames[which]) @ drifted))
    a, b = (paste(part) for part in pieces)
    return MapPair(a, b, T_site_b, overlap=1.0 / 3.0)


def _pieces(
    rng: np.random.Generator, seed: int, site: Site
) -> Iterator[tuple[tuple[vx.VoxelGrid | None, vx.VoxelGrid | None], np.ndarray]]:
    """What each map sees of each building and each stretch of road, in frames of their own, and `T_site_piece`."""
    first = round(site.num_buildings / 3)
    places = np.stack([_place(rng, site, number) for number in range(site.num_buildings)])
    for number, place in enumerate(places):
        seen = number < 2 * first, number >= first
        building = simulate_team(
            int(np.random.SeedSequence([seed, number]).generate_state(1)[0]),
            num_robots=sum(seen),
            overlap=1.0,
            voxel_size=site.voxel_size,
        )
        turn = Rotation.from_rotvec([0.0, 0.0, rng.uniform(-np.pi, np.pi)]).as_matrix()
        T_site_building = np.eye(4)
        T_site_building[:3, :3], T_site_building[:3, 3] = turn, place
        maps = iter(zip(building.grids, building.poses, strict=True))
        for which in range(2):
            if seen[which]:
                grid, T_building_map = next(maps)
                both = (grid, None) if which == 0 else (None, grid)
                yield both, T_site_building @ np.asarray(T_building_map, np.float64)
        if number:
            for one, other in _road(rng, places[number - 1], place, site.voxel_size):
                yield (one if seen[0] else None, other if seen[1] and number > first else None), np.eye(4)


def _place(rng: np.random.Generator, site: Site, number: int) -> np.ndarray:
    """Where a building stands [m]: in a field of its own of a chessboard, column by column, at any height."""
    rows = -(-site.num_buildings // site.columns)
    column, row = divmod(number, rows)
    field = np.array([site.sides[0] / site.columns, site.sides[1] / rows])
    # Buildings are some 35 m wide, those that stand at the rim are cut by nothing.
    within = rng.uniform(-0.5, 0.5, 2) * np.maximum(field - 45.0, 0.0)
    return np.append((np.array([column, row]) + 0.5) * field + within, rng.uniform(0.0, site.sides[2] - 6.0))


def _road(
    rng: np.random.Generator, start: np.ndarray, end: np.ndarray, voxel_size: float
) -> Iterator[tuple[vx.VoxelGrid, vx.VoxelGrid]]:
    """A road with a wall that has gaps along it, in stretches of some 20 m, seen twice, each time with other noise."""
    length = float(np.linalg.norm(end - start))
    num = max(round(length / 20.0), 1)
    along = (end - start) / length
    across = np.array([-along[1], along[0], 0.0]) / max(np.hypot(along[0], along[1]), 1e-9)
    up, posts = np.array([0.0, 0.0, 1.0]), np.arange(0.0, length + 4.0, 4.0)
    for part in range(num):
        s = np.arange(part * length / num, (part + 1) * length / num, 0.7 * voxel_size)
        ground_s, ground_w = (g.reshape(-1) for g in np.meshgrid(s, np.arange(-2.0, 2.0, 0.7 * voxel_size)))
        wall_s, wall_h = (g.reshape(-1) for g in np.meshgrid(s, np.arange(0.0, 1.6, 0.7 * voxel_size)))
        # Pieces and gaps of the wall are some metres long.
        kept = np.interp(wall_s, posts, rng.normal(size=len(posts))) > 0
        wall_s, wall_h = wall_s[kept], wall_h[kept]
        points = np.concatenate(
            [
                start + ground_s[:, None] * along + ground_w[:, None] * across,
                start + wall_s[:, None] * along + 2.0 * across + wall_h[:, None] * up,
            ]
        )
        # The robot stops every two metres, and sees what is nearest to it.
        at = np.rint(np.concatenate([ground_s, wall_s]) / 2.0) * 2.0
        sensors = start + at[:, None] * along + 1.2 * up
        one, other = (
            vx.VoxelGrid.from_points(
                points + rng.normal(scale=0.02, size=points.shape),
                voxel_size=voxel_size,
                sensor_origins=sensors,
            )
            for _ in range(2)
        )
        yield one, other


def paste(grids: Sequence[vx.VoxelGrid]) -> vx.VoxelGrid:
    """One map of many on one lattice: each voxel has the greatest state that any of them gives it."""
    size = grids[0].voxel_size
    lows = np.stack([np.rint(np.asarray(grid.origin) / size).astype(np.int64) for grid in grids])
    low = lows.min(axis=0)
    shape = tuple(
        (np.max([at + grid.shape for at, grid in zip(lows, grids, strict=True)], axis=0) - low).tolist()
    )
    keys, blocks = [], []
    for at, grid in zip(lows - low, grids, strict=True):
        # Blocks of the whole: the piece is widened to begin at a border of them.
        begin, end = at // BLOCK, -(-(at + grid.shape) // BLOCK)
        array = grid.state_blocks()
        wide = array.window(begin * BLOCK - at, end * BLOCK - at)
        count = end - begin
        cut = wide.reshape(count[0], BLOCK, count[1], BLOCK, count[2], BLOCK).transpose(0, 2, 4, 1, 3, 5)
        cut = cut.reshape(-1, BLOCK, BLOCK, BLOCK)
        filled = np.flatnonzero(cut.any(axis=(1, 2, 3)))
        keys.append(np.stack(np.unravel_index(filled, tuple(count)), axis=1) + begin)
        blocks.append(cut[filled])
    return vx.VoxelGrid(_merged(np.concatenate(keys), np.concatenate(blocks), shape), low * size, size)


def _merged(index: np.ndarray, blocks: np.ndarray, shape: tuple[int, ...]) -> BlockArray:
    """Blocks of which several may lie at one place, the greatest value of each voxel kept."""
    order = np.lexsort(index.T[::-1])
    index, blocks = index[order], blocks[order]
    first = np.flatnonzero(np.append(True, (np.diff(index, axis=0) != 0).any(axis=1)))
    builder = BlockBuilder(shape, np.uint8)
    builder.add(index[first], np.maximum.reduceat(blocks, first, axis=0))
    return builder.finish()
