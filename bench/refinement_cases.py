"""Pairs and starts of the benchmark of refinement: maps with a known pose, and poses a known error away from it.

The error of a start is about the image of map b's centroid: turned by exactly so many degrees about a random axis,
shifted by exactly so many metres in a random direction. Everything is drawn from the seed and the case's name.
"""

import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from bench.cases import folder_cases
from bench.worlds import FRAMES, MapPair
from voxjax.synthetic import simulate_team


@dataclass(frozen=True)
class RefinementCase:
    """One pair of maps of one place; light until it is loaded.

    Attributes:
        name: Unique name, from which starts are drawn.
        suite: "sim" (the folder of test maps), "drift-free" (generated, the mapper knows where it is) or "drifting"
            (generated, with a drift of centimetres).
        frame: How the maps' frames lie: "yaw", "tilt" or "so3".
        load: Function that gives the maps and the truth, which is never None.
    """

    name: str
    suite: str
    frame: str
    load: Callable[[], MapPair]


def sim_cases(root: Path) -> list[RefinementCase]:
    """Pairs of one place in the folder "sim" below `root`; hotels and different buildings are left out."""
    return [
        RefinementCase(case.name, "sim", case.rotation, case.load)
        for case in folder_cases(root, ["sim"])
        if case.kind == "pair"
    ]


def generated_cases(suite: str, count: int, seed: int) -> list[RefinementCase]:
    """The first pairs of a seed: suite "drift-free" or "drifting", which share their buildings and frames."""
    return [_generated(suite, seed, number) for number in range(count)]


def _generated(suite: str, seed: int, number: int) -> RefinementCase:
    rng = np.random.default_rng([seed, number, 2])
    voxel_sizes = (0.1, 0.1, 0.2)
    # The turn of frames is slower than that of sizes, so that each size meets each frame.
    frame = FRAMES[number // len(voxel_sizes) % len(FRAMES)]
    voxel_size = voxel_sizes[number % len(voxel_sizes)]
    overlap, clutter = float(rng.uniform(0.3, 0.6)), float(rng.uniform(0.4, 2.0))
    drift = float(rng.uniform(0.01, 0.06)) if suite == "drifting" else 0.0
    world = int(np.random.SeedSequence([seed, number]).generate_state(1)[0])

    def load() -> MapPair:
        team = simulate_team(
            world, overlap=overlap, frame=frame, voxel_size=voxel_size, drift=drift, clutter=clutter
        )
        measured = min(team.overlap(0, 1), team.overlap(1, 0))
        return MapPair(team.grids[0], team.grids[1], team.true_pose(0, 1), measured)

    return RefinementCase(f"{suite}/{seed}_{number}_{frame}_{voxel_size:g}", suite, frame, load)


def pose_off(
    T_a_b: np.ndarray, centroid: np.ndarray, *, metres: float, degrees: float, rng: np.random.Generator
) -> np.ndarray:
    """A pose whose error is exactly so large.

    Args:
        T_a_b: (4, 4) truth.
        centroid: Centroid of map b [m], in frame b.
        metres: Distance by which the centroid's image is moved, in a random direction.
        degrees: Angle by which the map is turned about that image, about a random axis.
        rng: Drawn from six times whatever the lengths, so that starts of one number point the same way.
    """
    # Turned about the image of the centroid, so that the two errors do not mix.
    axis, direction = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
    turn = Rotation.from_rotvec(np.radians(degrees) * axis).as_matrix()
    T = np.eye(4)
    T[:3, :3] = turn @ T_a_b[:3, :3]
    image = T_a_b[:3, :3] @ centroid + T_a_b[:3, 3] + metres * direction
    T[:3, 3] = image - T[:3, :3] @ centroid
    return T


def starts_of(
    case: RefinementCase,
    pair: MapPair,
    count: int,
    *,
    metres: float = 0.3,
    degrees: float = 3.0,
    seed: int,
) -> Sequence[np.ndarray]:
    """Starts of a case whose errors have one size; the same case, size and seed give the same starts.

    Args:
        case: The case, whose name decides the directions of the errors.
        pair: Maps and truth of the case.
        count: Number of starts.
        metres: Error of position of each start; the default is a start off by decimetres.
        degrees: Error of rotation of each start.
        seed: Seed of the directions.

    Raises:
        ValueError: If the pair has no true pose.
    """
    if pair.T_a_b is None:
        raise ValueError(f"case {case.name} has no true pose")
    centroid = pair.centroid_of_b
    return [
        pose_off(
            pair.T_a_b,
            centroid,
            metres=metres,
            degrees=degrees,
            rng=np.random.default_rng([seed, number, zlib.crc32(case.name.encode())]),
        )
        for number in range(count)
    ]
