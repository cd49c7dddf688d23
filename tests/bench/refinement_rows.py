"""Small pairs, methods and rows of results for tests of the benchmark of refinement."""

import numpy as np
from bench.refinement_cases import RefinementCase
from bench.refinement_peers import Refiner
from bench.worlds import MapPair

from oracles import motions
from voxjax import VoxelGrid


def made_pair():
    rng = np.random.default_rng(3)
    grids = [
        VoxelGrid(rng.integers(0, 3, (6, 7, 8)).astype(np.uint8), np.full(3, shift, np.float32), 0.1)
        for shift in (0.0, 20.0)
    ]
    return MapPair(grids[0], grids[1], motions.random_pose(rng), 1.0)


def made_case(pair, name="drift-free/one", suite="drift-free"):
    return RefinementCase(name, suite, "yaw", lambda: pair)


def refiner(name, refine):
    return Refiner(name, None, lambda pair: lambda T: refine(pair, T), lambda pair: lambda T: refine(pair, T))


def accuracy_row(method, metres, degrees, suite="drift-free"):
    return {
        "suite": suite,
        "method": method,
        "num_pairs": 2,
        "num_poses": 4,
        "converged": 1.0,
        "metres": [metres, 2 * metres],
        "voxels": [10 * metres, 20 * metres],
        "degrees": [degrees, 2 * degrees],
        "seconds": [0.1, 0.2],
        "prepare_seconds": [0.2, 0.3],
    }


def basin_row(method, shares, line="both"):
    steps = np.linspace(0.0, 1.0, len(shares))
    return {
        "line": line,
        "method": method,
        "num_pairs": 2,
        "num_trials": [10] * len(shares),
        "metres": (2 * steps).tolist(),
        "degrees": (30 * steps).tolist(),
        "converged": shares,
    }
