"""Do covariances tell the size of errors? Normalised errors squared of two covariances of the same poses."""

from collections.abc import Iterator

import jax.numpy as jnp
import numpy as np
from scipy.stats import chi2

import voxjax as vx
from bench.refinement_cases import starts_of
from bench.refinement_parts import Plan, Row
from voxjax.maps.prepared import prepare_map
from voxjax.refinement.problems.pair import pose_problem
from voxjax.refinement.residuals.known import tangent_between
from voxjax.refinement.solve.covariance import MAP_ACCURACY, PATCH_VOXELS, plane_information
from voxjax.refinement.solve.noise import implicit_covariance


def covariance_rows(plan: Plan, refiners: object) -> Iterator[Row]:
    """A row for each suite and covariance: mean of the normalised error squared (6 were it exact), share below 95 %.

    Both take errors that are shared by patches of a map, as large as the offsets from the planes are, and the error
    of a map as a whole; one by Gauss-Newton at the solution, one by the implicit function theorem through the errors.
    """
    del refiners
    found: dict[tuple[str, str], list[tuple[float, float]]] = {}
    for case in plan.suites:
        print(f"  {case.name}", flush=True)
        pair = case.load()
        if pair.T_a_b is None:
            continue
        a, b = prepare_map(pair.a), prepare_map(pair.b)
        start = starts_of(case, pair, 1, metres=0.1, degrees=1.0, seed=plan.seed)[0]
        refined = vx.refine(a, b, start, both_ways=True)
        problem = pose_problem(a, b, both_ways=True)
        T = jnp.asarray(refined.T_a_b)
        error = np.asarray(
            tangent_between(T, jnp.asarray(pair.T_a_b, jnp.float32), jnp.asarray(problem.centroid)),
            np.float64,
        )
        voxel = np.float32(pair.a.voxel_size)
        _, variance = plane_information(problem, T, jnp.asarray(voxel))
        units = np.concatenate([np.ones(3), np.full(3, 1.0 / float(problem.radius))]).astype(np.float32)
        implicit = implicit_covariance(
            problem,
            T,
            jnp.asarray(voxel),
            deviation=jnp.sqrt(variance + voxel**2 / 12.0),
            patch=jnp.asarray(voxel * np.float32(np.sqrt(PATCH_VOXELS))),
            prior=jnp.asarray(units),
        )
        whole = np.diag((MAP_ACCURACY * voxel * units.astype(np.float64)) ** 2)
        both = {"Gauss-Newton": refined.covariance, "implicit": np.asarray(implicit, np.float64) + whole}
        for name, covariance in both.items():
            covariance = np.asarray(covariance, np.float64)
            normalised = float(error @ np.linalg.solve(covariance, error))
            size = float(np.sqrt(np.trace(covariance[:3, :3])))
            found.setdefault((case.suite, name), []).append((normalised, size))
    for (suite, name), values in found.items():
        normalised, size = np.asarray(values).T
        yield {
            "suite": suite,
            "covariance": name,
            "num_poses": len(values),
            "mean": float(normalised.mean()),
            "median": float(np.median(normalised)),
            "below_95": float((normalised < chi2.ppf(0.95, 6)).mean()),
            "metres": float(np.median(size)),
        }
