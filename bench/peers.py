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

from bench.peer_features import fpfh, mutual_matches
from voxjax import InputError

_LIBRARIES = "on Debian and Ubuntu it also needs libusb-1.0-0, libgl1, libegl1, libgomp1 and libx11-6"


class Coarse(NamedTuple):
    """The answer of a peer before refinement.

    Attributes:
        T_a_b: (4, 4).
        is_valid: The peer's own verdict; None where it has none.
        score: The peer's own figure: inliers, the share of them, or the size of the largest clique.
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
        seconds: Time of all of it, refinement included [s].
        refine_seconds: Time of the refinement alone [s].
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
        name: Name on the command line and in tables.
        modules: Modules that it needs.
        install: Command and needs of its installation, for people.
        solve: `solve(points_a, points_b, working_voxel)`, points (n, 3) [m].
    """

    name: str
    modules: tuple[str, ...]
    install: str
    solve: Callable[[np.ndarray, np.ndarray, float], Coarse]

    def versions(self) -> dict[str, str]:
        """Versions of the distributions that give its modules."""
        return module_versions(self.modules)


def _version(name: str) -> str:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return "built from source"


def _kiss_matcher(points_a: np.ndarray, points_b: np.ndarray, working: float) -> Coarse:
    module: Any = importlib.import_module("kiss_matcher")
    matcher = module.KISSMatcher(module.KISSMatcherConfig(working))
    # The answers of all peers map their first cloud into the second.
    found = matcher.estimate(points_b, points_a)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = found.rotation, np.asarray(found.translation).reshape(3)
    return Coarse(T, bool(found.valid), float(matcher.get_num_final_inliers()))


def _open3d(points_a: np.ndarray, points_b: np.ndarray, working: float) -> Coarse:
    """FPFH of the downsampled points, mutual matches, RANSAC with Open3D's own bounds on edges and distances."""
    o3d: Any = importlib.import_module("open3d")
    registration = o3d.pipelines.registration
    # RANSAC draws at random, and a benchmark must give the same poses again.
    o3d.utility.random.seed(0)
    clouds, features = zip(*(fpfh(points, working) for points in (points_b, points_a)), strict=True)
    reach = 1.5 * working
    found = registration.registration_ransac_based_on_feature_matching(
        *clouds,
        *features,
        True,
        reach,
        registration.TransformationEstimationPointToPoint(False),
        3,
        [
            registration.CorrespondenceCheckerBasedOnEdgeLength(0.9),
            registration.CorrespondenceCheckerBasedOnDistance(reach),
        ],
        registration.RANSACConvergenceCriteria(100_000, 0.999),
    )
    return Coarse(np.asarray(found.transformation), None, float(found.fitness))


def _teaser(points_a: np.ndarray, points_b: np.ndarray, working: float) -> Coarse:
    """FPFH as `_open3d`, mutual matches, TEASER++ as in its example with FPFH: its bound on noise is the voxel size.

    Time and memory grow with the square of the matches, so that the nearest 5000 are taken. The score
    is the number of matches in the largest clique. Runs may differ: threads decide between cliques of one size.
    """
    module: Any = importlib.import_module("teaserpp_python")
    (cloud_b, features_b), (cloud_a, features_a) = (fpfh(points, working) for points in (points_b, points_a))
    rows_b, rows_a = mutual_matches(features_b.data.T, features_a.data.T, most=5000).T
    T, clique = np.eye(4), 0
    if len(rows_b) >= 3:
        solver = module.RobustRegistrationSolver(
            noise_bound=working,
            cbar2=1.0,
            estimate_scaling=False,
            rotation_max_iterations=10_000,
            rotation_estimation_algorithm=module.RotationEstimationAlgorithm.GNC_TLS,
            rotation_gnc_factor=1.4,
            rotation_cost_threshold=1e-16,
            inlier_selection_mode=module.InlierSelectionMode.PMC_EXACT,
        )
        solver.solve(np.asarray(cloud_b.points)[rows_b].T, np.asarray(cloud_a.points)[rows_a].T)
        clique = len(solver.getInlierMaxClique())
        if clique >= 3:  # its pose is not set, or not determined, below that
            found = solver.getSolution()
            T[:3, :3], T[:3, 3] = found.rotation, found.translation
    return Coarse(T, None, float(clique))


PEERS = (
    Peer(
        "kiss-matcher",
        ("kiss_matcher", "small_gicp"),
        'pip install "voxjax[bench]"',
        _kiss_matcher,
    ),
    Peer(
        "open3d",
        ("open3d", "small_gicp"),
        f"pip install open3d-cpu small-gicp; {_LIBRARIES}",
        _open3d,
    ),
    Peer(
        "teaser",
        ("teaserpp_python", "open3d", "small_gicp"),
        "pip install open3d-cpu small-gicp git+https://github.com/MIT-SPARK/TEASER-plusplus, which is built from "
        f"source and needs CMake, a C++ compiler and Eigen (libeigen3-dev); {_LIBRARIES}",
        _teaser,
    ),
)
"""Peers that can be asked for."""


def load_peers(names: Sequence[str]) -> list[Peer]:
    """The peers of those names, with their modules imported.

    Raises:
        InputError: If a name is unknown, or a peer cannot be imported; the message says how to install it.
    """
    known = {peer.name: peer for peer in PEERS}
    for name in names:
        if name not in known:
            raise InputError(f"peer {name!r} is not known; choose from {', '.join(known)}.")
        for module in known[name].modules:
            require_module(name, module, known[name].install)
    return [known[name] for name in names]


def require_module(peer: str, module: str, install: str) -> None:
    """Import a module that a peer needs.

    Raises:
        InputError: If it cannot be imported; the message says how to install it.
    """
    try:
        importlib.import_module(module)
    except (ImportError, OSError) as error:  # a missing shared library may be either
        raise InputError(
            f"peer {peer!r} cannot be used because module {module} cannot be imported ({error}); install it: {install}."
        ) from error


def module_versions(modules: Sequence[str]) -> dict[str, str]:
    """Versions of the distributions that give some modules; a module may have been built without one."""
    providers = importlib.metadata.packages_distributions()
    # A distribution of one compiled module is not always listed, and is named as its module.
    names = [name for module in modules for name in providers.get(module, [module])]
    return {name: _version(name) for name in names}


def working_voxel(voxel_size: float, *, is_real: bool) -> float:
    """Voxel size at which peers work [m].

    Simulated maps: 0.3 m. Real ones: 2.5 voxels of the map, at most 0.3 m; never finer than the map itself.
    """
    return max(min(0.3, 2.5 * voxel_size) if is_real else 0.3, voxel_size)


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
            points_a.astype(np.float64),
            points_b.astype(np.float64),
            T_a_b,
            downsampling_resolution=leaf,
            max_correspondence_distance=reach,
            num_threads=threads,
            max_iterations=30,
        )
        T_a_b = np.asarray(found.T_target_source)
    return T_a_b
