"""Verdicts on generated valleys: rolling ground with houses and trees, as two maps from the air that share a part."""

import time
from collections.abc import Iterator

import numpy as np

import voxjax as vx
from bench.worlds import MapPair
from voxjax.metrics import pose_error
from voxjax.synthetic.families import terrain
from voxjax.synthetic.families.terrain import Valley


def simulate_valley(seed: int, valley: Valley | None = None) -> MapPair:
    """Two maps of a valley.

    Args:
        seed: Same seed and valley, same maps.
        valley: None takes the default.
    """
    valley = Valley() if valley is None else valley
    found = terrain.simulate_valley(seed, valley)
    return MapPair(*found.grids, found.T_a_b, overlap=valley.overlap)


def valley_rows(seed: int, sizes: tuple[float, ...] = (0.5, 1.0, 2.0), *, width: int = 300) -> Iterator[dict]:
    """Verdicts, errors and seconds of valleys of one number of voxels, with and without free space.

    Args:
        seed: Same seed, same maps.
        sizes: Edge lengths of the voxels [m].
        width: Voxels along x and y.
    """
    for voxel_size in sizes:
        for has_free_space in (True, False):
            pair = simulate_valley(
                seed, Valley(side=width * voxel_size, voxel_size=voxel_size, has_free_space=has_free_space)
            )
            for _ in range(2):
                start = time.perf_counter()
                found = vx.register(pair.a, pair.b)
                seconds = time.perf_counter() - start
            error = pose_error(np.asarray(found.T_a_b), np.asarray(pair.T_a_b), pair.centroid_of_b)
            yield {
                "voxel [m]": voxel_size,
                "side [m]": width * voxel_size,
                "free space": "from the air" if has_free_space else "none",
                "occupied": f"{pair.a.num_occupied} / {pair.b.num_occupied}",
                "verdict": found.verdict,
                "confidence": found.confidence,
                "error [voxel]": error.metres / voxel_size,
                "error [deg]": error.degrees,
                "seconds": seconds,
            }
