"""Methods of the benchmark of refinement: `voxjax.refine`, and ICP of small_gicp and Open3D in stages of falling reach.

The settings of the peers were chosen on pairs of another seed (777) than those reported. For `near` starts: one stage
of a reach of 1 m, two of 1 and 0.3 m, three from 2 m on points averaged over 4, 2 and 1 voxels, last reaches of 0.2 and
0.3 m, and for Open3D no robust loss or Tukey's. One stage is two to three times less accurate for point-to-plane; the
others differ little. For `wide` starts, on one pair of 0.2 m voxels: six ways down from first reaches of 1 to 8 m, of
which those from 2 m on averaged points converge from nearly everywhere. One choice looks at a reported pair (seed 4000,
number 2): with a first reach of 4 m both point-to-plane methods leave even its true pose, so they begin with 2 m.
"""

import importlib
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

import voxjax as vx
from bench.peers import module_versions, require_module
from bench.worlds import MapPair
from voxjax.maps.prepared import prepare_map

Refine = Callable[[np.ndarray], np.ndarray]
"""Function from a start, (4, 4) `T_a_b`, to the refined pose."""

Prepare = Callable[[MapPair], Refine]

SMALLEST_REACH = 2.0
"""No stage of a peer reaches less far [voxel]."""

NUM_NEIGHBORS = 20
"""Points of which the peers estimate a normal or a covariance."""


class Stage(NamedTuple):
    """One run of ICP.

    Attributes:
        leaf: Side of the cells whose points are averaged [voxel]; 1 takes the voxel centres as they are.
        reach: Largest distance of a match [m].
    """

    leaf: float
    reach: float


NEAR = (Stage(2.0, 1.0), Stage(1.0, 0.3))
"""Stages of the peers for starts that are off by decimetres."""

WIDE = (Stage(4.0, 2.0), Stage(2.0, 1.0), Stage(1.0, 0.3))
"""Stages of the peers for starts that are off by metres."""

WIDE_DISTANCE = 2.0
"""First robust scale of voxjax for starts that are off by metres [m]; for others its default, 4 voxels."""

NUM_STEPS = 50
"""Most iterations of a stage; the peers stop before when a pose settles to 0.1 mm and 0.006 degrees."""


@dataclass(frozen=True)
class Refiner:
    """A method.

    Attributes:
        name: Name in tables.
        module: Module that it needs; None for voxjax.
        prepare_near: Function from a pair to what refines starts that are off by decimetres: it prepares maps,
            normals, trees.
        prepare_wide: Function from a pair to what refines starts that are off by metres.
    """

    name: str
    module: str | None
    prepare_near: Prepare
    prepare_wide: Prepare

    def versions(self) -> dict[str, str]:
        """Versions of the installed distributions that give its module."""
        return {} if self.module is None else module_versions([self.module])


def load_refiners(peers: Sequence[str]) -> list[Refiner]:
    """The methods of voxjax, one way and both ways, and the methods of the peers, whose modules are imported.

    Raises:
        vx.InputError: If a peer is unknown or cannot be imported: with the way to install it.
    """
    for name in peers:
        if name not in _INSTALL:
            raise vx.InputError(f"peer {name!r} is not known; choose from {', '.join(_INSTALL)}.")
        require_module(name, name, _INSTALL[name])
    return [r for r in REFINERS if r.module is None or r.module in peers]


def _voxjax(name: str, *, both_ways: bool, residuals: dict[str, float] | None = None) -> Refiner:
    def prepare(pair: MapPair, max_distance: float | None) -> Refine:
        a, b = prepare_map(pair.a), prepare_map(pair.b)
        return lambda T: np.asarray(
            vx.refine(a, b, T, both_ways=both_ways, max_distance=max_distance, residuals=residuals).T_a_b,
            np.float64,
        )

    return Refiner(name, None, lambda pair: prepare(pair, None), lambda pair: prepare(pair, WIDE_DISTANCE))


def _small_gicp(name: str, kind: str) -> Refiner:
    def prepare(pair: MapPair, stages: Sequence[Stage]) -> Refine:
        gicp: Any = importlib.import_module("small_gicp")
        voxel_size, threads = _voxel_size(pair), os.cpu_count() or 1

        def cloud_of(points: np.ndarray, leaf: float) -> tuple[Any, Any]:
            cloud = gicp.PointCloud(points)
            if leaf > 1.0:
                cloud = gicp.voxelgrid_sampling(cloud, leaf * voxel_size, threads)
            tree = gicp.KdTree(cloud, threads)
            gicp.estimate_normals_covariances(cloud, tree, NUM_NEIGHBORS, threads)
            return cloud, tree

        clouds = _clouds(pair, stages, cloud_of)

        def refine(T: np.ndarray) -> np.ndarray:
            for stage in stages:
                (a, tree), (b, _) = clouds[stage.leaf]
                found = gicp.align(
                    a,
                    b,
                    tree,
                    T,
                    registration_type=kind,
                    num_threads=threads,
                    max_iterations=NUM_STEPS,
                    max_correspondence_distance=max(stage.reach, SMALLEST_REACH * voxel_size),
                    rotation_epsilon=1e-4,
                    translation_epsilon=1e-4,
                )
                T = np.asarray(found.T_target_source)
            return T

        return refine

    return Refiner(name, "small_gicp", lambda pair: prepare(pair, NEAR), lambda pair: prepare(pair, WIDE))


def _open3d(name: str, near: str, wide: str) -> Refiner:
    def prepare(pair: MapPair, stages: Sequence[Stage], loss: str) -> Refine:
        o3d: Any = importlib.import_module("open3d")
        registration = o3d.pipelines.registration
        voxel_size = _voxel_size(pair)

        def cloud_of(points: np.ndarray, leaf: float) -> Any:
            cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
            if leaf > 1.0:
                cloud = cloud.voxel_down_sample(leaf * voxel_size)
            cloud.estimate_normals(o3d.geometry.KDTreeSearchParamKNN(NUM_NEIGHBORS))
            return cloud

        clouds = _clouds(pair, stages, cloud_of)

        def refine(T: np.ndarray) -> np.ndarray:
            for stage in stages:
                a, b = clouds[stage.leaf]
                reach = max(stage.reach, SMALLEST_REACH * voxel_size)
                kernel = registration.TukeyLoss(reach) if loss == "tukey" else registration.L2Loss()
                found = registration.registration_icp(
                    b,
                    a,
                    reach,
                    T,
                    registration.TransformationEstimationPointToPlane(kernel),
                    registration.ICPConvergenceCriteria(1e-6, 1e-6, NUM_STEPS),
                )
                T = np.asarray(found.transformation)
            return T

        return refine

    return Refiner(
        name, "open3d", lambda pair: prepare(pair, NEAR, near), lambda pair: prepare(pair, WIDE, wide)
    )


def _clouds(
    pair: MapPair, stages: Sequence[Stage], cloud_of: Callable[[np.ndarray, float], Any]
) -> dict[float, tuple[Any, Any]]:
    """Both maps' clouds at each leaf of the stages."""
    points = [grid.occupied_points().astype(np.float64) for grid in (pair.a, pair.b)]
    return {leaf: (cloud_of(points[0], leaf), cloud_of(points[1], leaf)) for leaf in {s.leaf for s in stages}}


def _voxel_size(pair: MapPair) -> float:
    return max(pair.a.voxel_size, pair.b.voxel_size)


_INSTALL = {
    "small_gicp": 'pip install "voxjax[bench]"',
    "open3d": "pip install open3d-cpu; on Debian and Ubuntu it also needs libusb-1.0-0, libgl1, libegl1 and libgomp1",
}

REFINERS = (
    _voxjax("voxjax, both ways", both_ways=True),
    _voxjax("voxjax, one way", both_ways=False),
    _voxjax("voxjax, and occupancies", both_ways=True, residuals={"planes": 1.0, "occupancies": 0.3}),
    _small_gicp("small_gicp point-to-plane", "PLANE_ICP"),
    _small_gicp("small_gicp GICP", "GICP"),
    _open3d("Open3D point-to-plane", near="tukey", wide="l2"),
)
