"""Other systems on the same maps: occupied voxel centres in, one pose out, refined in two stages by small_gicp.

Each peer works at the voxel size that `working_voxel` gives, with its authors' settings otherwise. Times include the
refinement, which is also told apart; they exclude taking the centres out of the maps.
"""

import importlib
import importlib.metadata
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from voxjax import InputError

LARGEST_WORKING_VOXEL = 0.3
_LIBRARIES = "on Debian and Ubuntu it also needs libusb-1.0-0, libgl1, libegl1, libgomp1 and libx11-6"


class Coarse(NamedTuple):
    """What a peer answers before refinement.

    Attributes:
        T_a_b: (4, 4).
        is_valid: The peer's own verdict; None where it has none.
        score: The peer's own figure: inliers, or the share of them.
    """

    T_a_b: np.ndarray
    is_valid: bool | None
    score: float


class PeerAnswer(NamedTuple):
    """A refined answer.

    Attributes:
        T_a_b: (4, 4) after refinement.
        is_valid: See `Coarse`.
        score: See `Coarse`.
        seconds: All of it, refinement included.
        refine_seconds: The refinement alone.
    """

    T_a_b: np.ndarray
    is_valid: bool | None
    score: float
    seconds: float
    refine_seconds: float


@dataclass(frozen=True)
class Peer:
    """Another system.

    Attributes:
        name: On the command line and in tables.
        modules: Modules that it needs.
        install: How to install it.
        solve: `solve(points_a, points_b, working_voxel)`, points (n, 3) [m].
    """

    name: str
    modules: tuple[str, ...]
    install: str
    solve: Callable[[np.ndarray, np.ndarray, float], Coarse]

    def versions(self) -> dict[str, str]:
        """Versions of the installed distributions that give its modules."""
        providers = importlib.metadata.packages_distributions()
        # A distribution of one compiled module is not always listed, and is named as its module.
        names = [name for module in self.modules for name in providers.get(module, [module])]
        return {name: importlib.metadata.version(name) for name in names}


def _kiss_matcher(points_a: np.ndarray, points_b: np.ndarray, working: float) -> Coarse:
    module: Any = importlib.import_module("kiss_matcher")
    matcher = module.KISSMatcher(module.KISSMatcherConfig(working))
    found = matcher.estimate(points_b, points_a)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = found.rotation, np.asarray(found.translation).reshape(3)
    return Coarse(T, bool(found.valid), float(matcher.get_num_final_inliers()))


def _open3d(points_a: np.ndarray, points_b: np.ndarray, working: float) -> Coarse:
    """FPFH of the downsampled points, mutual matches, RANSAC with Open3D's own bounds on edges and distances."""
    o3d: Any = importlib.import_module("open3d")
    registration = o3d.pipelines.registration
    o3d.utility.random.seed(0)
    clouds, features = [], []
    for points in (points_b, points_a):
        cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points.astype(np.float64)))
        cloud = cloud.voxel_down_sample(working)
        cloud.estimate_normals(o3d.geometry.KDTreeSearchParamHybrid(radius=2 * working, max_nn=30))
        around = o3d.geometry.KDTreeSearchParamHybrid(radius=5 * working, max_nn=100)
        clouds.append(cloud)
        features.append(registration.compute_fpfh_feature(cloud, around))
    reach = 1.5 * working
    found = registration.registration_ransac_based_on_feature_matching(
        *clouds, *features, True, reach, registration.TransformationEstimationPointToPoint(False), 3,
        [
            registration.CorrespondenceCheckerBasedOnEdgeLength(0.9),
            registration.CorrespondenceCheckerBasedOnDistance(reach),
        ],
        registration.RANSACConvergenceCriteria(100_000, 0.999),
    )  # fmt: skip
    return Coarse(np.asarray(found.transformation), None, float(found.fitness))


PEERS = (
    Peer(
        "kiss-matcher", ("kiss_matcher", "small_gicp"),
        'pip install "voxjax[bench]"', _kiss_matcher,
    ),
    Peer(
        "open3d", ("open3d", "small_gicp"),
        f"pip install open3d-cpu small-gicp; {_LIBRARIES}", _open3d,
    ),
)  # fmt: skip
"""Peers that can be asked for."""


def load_peers(names: Sequence[str]) -> list[Peer]:
    """The peers of those names, with their modules imported.

    Raises:
        InputError: If a name is unknown, or a peer cannot be imported: with the way to install it.
    """
    known = {peer.name: peer for peer in PEERS}
    for name in names:
        if name not in known:
            raise InputError(f"peer {name!r} is not known; choose from {', '.join(known)}.")
        for module in known[name].modules:
            try:
                importlib.import_module(module)
            except (ImportError, OSError) as error:  # a missing shared library may be either
                raise InputError(
                    f"peer {name!r} cannot be used because module {module} cannot be imported ({error}); "
                    f"install it: {known[name].install}."
                ) from error
    return [known[name] for name in names]


def working_voxel(voxel_size: float, *, is_real: bool) -> float:
    """Voxel size at which peers work [m].

    Simulated maps: 0.3 m. Real ones: 2.5 voxels of the map, at most 0.3 m; never finer than the map itself.
    """
    wanted = min(LARGEST_WORKING_VOXEL, 2.5 * voxel_size) if is_real else LARGEST_WORKING_VOXEL
    return max(wanted, voxel_size)


def run_peer(
    peer: Peer, points_a: np.ndarray, points_b: np.ndarray, *, voxel_size: float, is_real: bool
) -> PeerAnswer:
    """Let a peer register two clouds of voxel centres (n, 3) [m], refine its pose, take the time."""
    working = working_voxel(voxel_size, is_real=is_real)
    start = time.perf_counter()
    coarse = peer.solve(points_a, points_b, working)
    middle = time.perf_counter()
    T = refine_twice(points_a, points_b, coarse.T_a_b, working=working, voxel_size=voxel_size)
    end = time.perf_counter()
    return PeerAnswer(T, coarse.is_valid, coarse.score, end - start, end - middle)


def refine_twice(
    points_a: np.ndarray, points_b: np.ndarray, T_a_b: np.ndarray, *, working: float, voxel_size: float
) -> np.ndarray:
    """Refine a pose (4, 4) by small_gicp: coarse points with a wide reach, then finer ones with a narrow reach."""
    gicp: Any = importlib.import_module("small_gicp")
    threads = os.cpu_count() or 1
    for leaf, reach in ((working, 3 * working), (max(voxel_size, working / 2), working)):
        found = gicp.align(
            points_a.astype(np.float64), points_b.astype(np.float64), T_a_b, downsampling_resolution=leaf,
            max_correspondence_distance=reach, num_threads=threads, max_iterations=30,
        )  # fmt: skip
        T_a_b = np.asarray(found.T_target_source)
    return T_a_b
