"""Maps from scans and poses: log-odds integration by ray casting in the map's own frame, like OctoMap."""

from typing import NamedTuple

import numpy as np

from .._runtime.buckets import bucket_size
from .._types import FREE, OCCUPIED, UNKNOWN
from ..grid import VoxelGrid
from ..ops.resampling.raycast import crossed_voxels
from .lidar import Scan


class _Rays(NamedTuple):
    """A scan in voxels of the map: one ray an end voxel, hits first, and the lattice box that holds it."""

    start: np.ndarray
    ends: np.ndarray
    num_hits: int
    low: np.ndarray
    shape: tuple[int, int, int]


def build_map(scans: list[Scan], poses: np.ndarray, *, voxel_size: float) -> VoxelGrid:
    """Integrate scans into a map with log-odds.

    A scan raises each voxel that it hits once and lowers each other one that it crosses once. Voxels above
    log-odds 0 are occupied, the others that were touched are free.

    Args:
        scans: Scans in the sensor's frame; at least one.
        poses: (n, 4, 4): `T_map_sensor` that the mapper believes in.
        voxel_size: Edge length of a voxel [m].
    """
    rays = [_in_voxels(scan, T, voxel_size) for scan, T in zip(scans, poses, strict=True)]
    low = np.min([r.low for r in rays], axis=0)
    high = np.max([r.low + r.shape for r in rays], axis=0)
    log_odds, is_known = np.zeros(high - low, np.float32), np.zeros(high - low, bool)
    # One capacity for all scans, so that their rays share one compiled kernel.
    capacity = bucket_size(max(int(np.prod(r.shape)) for r in rays))
    for r in rays:
        window = tuple(slice(a, a + n) for a, n in zip(r.low - low, r.shape, strict=True))
        _integrate(log_odds[window], is_known[window], r, capacity)
    # Log-odds of 0 do not say whether a voxel was touched, so that what is known is kept beside them.
    states = np.where(is_known, np.where(log_odds > 0, OCCUPIED, FREE), UNKNOWN).astype(np.uint8)
    return VoxelGrid(states, (low * voxel_size).astype(np.float32), voxel_size, log_odds).crop_to_known()


def _integrate(log_odds: np.ndarray, is_known: np.ndarray, rays: _Rays, capacity: int) -> None:
    """Add one scan to the window of the map that holds it, in place."""
    # OctoMap's defaults: probabilities 0.7 of a hit and 0.4 of a miss, limits 0.1192 and 0.971, rounded.
    hit, miss = np.float32(0.85), np.float32(-0.4)
    lowest, highest = np.float32(-2.0), np.float32(3.5)
    starts = np.broadcast_to(rays.start, rays.ends.shape) - rays.low
    is_missed = crossed_voxels(starts, rays.ends - rays.low, rays.shape, capacity=capacity).copy()
    hits = tuple(np.floor(rays.ends[: rays.num_hits] - rays.low).astype(np.int64).T)
    # Voxels that are hit are among those that rays cross, so that this marks them as well.
    is_known |= is_missed
    # A voxel that one ray of the scan hits and another crosses counts as hit, as in OctoMap: surfaces seen at a
    # grazing angle would vanish otherwise.
    is_missed[hits] = False
    missed = np.nonzero(is_missed)
    log_odds[missed] = np.maximum(log_odds[missed] + miss, lowest)
    log_odds[hits] = np.minimum(log_odds[hits] + hit, highest)


def _in_voxels(scan: Scan, T: np.ndarray, voxel_size: float) -> _Rays:
    """The scan seen from a pose, as rays on the lattice."""
    ends = (scan.points @ T[:3, :3].T + T[:3, 3]) / voxel_size
    # A scan counts each voxel once, so of the rays that end in one voxel a single one is cast.
    groups = [_one_a_voxel(ends[: scan.num_hits]), _one_a_voxel(ends[scan.num_hits :])]
    start, ends = T[:3, 3] / voxel_size, np.concatenate(groups)
    low = np.floor(np.minimum(ends.min(axis=0, initial=np.inf), start)).astype(np.int64)
    high = np.floor(np.maximum(ends.max(axis=0, initial=-np.inf), start)).astype(np.int64)
    x, y, z = (int(n) for n in high - low + 1)
    return _Rays(start, ends, len(groups[0]), low, (x, y, z))


def _one_a_voxel(places: np.ndarray) -> np.ndarray:
    """The first place in each voxel."""
    if not len(places):
        return places
    index = np.floor(places).astype(np.int64)
    # 21 bits for each axis: a scan reaches far fewer voxels than two million.
    key = (index - index.min(axis=0)) @ np.asarray([1 << 42, 1 << 21, 1], np.int64)
    return places[np.sort(np.unique(key, return_index=True)[1])]
