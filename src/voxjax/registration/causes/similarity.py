"""Alignment with a scale: how many times as large map b would have to be for its surfaces to lie on those of map a.

Eight parameters: a pose, the logarithm of the scale, and by how much the surfaces of one map stand before those of the
other. Where voxel sizes or sensors differ all walls of a room come nearer together, which is no scale: it moves near
walls as much as far ones. How far a scale can be trusted is measured in the pair: the surfaces are parted by where they
lie, and each part is left out once (the jackknife). Drift moves whole parts, so that it shows in this error, which the
residuals of single voxels taken as independent would not.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from ...maps.prepared import PreparedMap, sample_rows
from ...ops.evidence.lookup import cells_on_host
from ...ops.evidence.nearest import INDEX_BITS, NOTHING_NEAR


class Start(NamedTuple):
    """Where an alignment starts.

    Attributes:
        scale: What the lengths of map b are multiplied by.
        T_a_b: float32 (4, 4), maps points of the scaled map into a.
    """

    scale: float
    T_a_b: Float[np.ndarray, "4 4"]

    @property
    def matrix(self) -> Float[np.ndarray, "4 4"]:
        """float64 (4, 4), maps points of map b as it is into a."""
        T = self.T_a_b.astype(np.float64)
        T[:3, :3] *= self.scale
        return T


class Similarity(NamedTuple):
    """How map b lies in map a once all its lengths are multiplied.

    Attributes:
        scale: What the lengths of map b are multiplied by.
        T_a_b: float32 (4, 4), maps points of the scaled map into a.
        log_error: Standard error of the logarithm of the scale; infinite where surfaces lie in too few parts to tell.
        agreement: Share of the points that lie beside a surface of a, nearer ones counting more.
    """

    scale: float
    T_a_b: Float[np.ndarray, "4 4"]
    log_error: float
    agreement: float

    @property
    def start(self) -> Start:
        """This as the start of another alignment."""
        return Start(self.scale, self.T_a_b)

    @property
    def matrix(self) -> Float[np.ndarray, "4 4"]:
        """float64 (4, 4), maps points of map b as it is into a."""
        return self.start.matrix


class Samples(NamedTuple):
    """Points of map b that are aligned.

    Attributes:
        points: Points on its surfaces (n, 3) [m].
        sides: Which side of each is free (n, 3); 0 where that means nothing.
    """

    points: np.ndarray
    sides: np.ndarray

    @classmethod
    def of(cls, a: PreparedMap, b: PreparedMap, num_points: int) -> "Samples":
        """Points of map b, drawn by leverage.

        Args:
            a: First map, without whose free space sides mean nothing.
            b: Second map.
            num_points: How many points.
        """
        rows = sample_rows(b, num_points)
        points, sides = (np.asarray(part)[rows].astype(np.float64) for part in (b.anchors, b.sides))
        return cls(points, sides if a.has_free_space and b.has_free_space else np.zeros_like(sides))


class _Matches(NamedTuple):
    """Points of b that are near surfaces of a.

    Attributes:
        places: Where they lie in a (m, 3) [m].
        normals: Normals of the surfaces (m, 3).
        fronts: 1 where the normal points to the free side (m,), 0 where that is not known.
        residuals: Distances from the planes of the surfaces (m,) [m].
        weights: How much each counts (m,).
    """

    places: np.ndarray
    normals: np.ndarray
    fronts: np.ndarray
    residuals: np.ndarray
    weights: np.ndarray


def align_similarity(
    a: PreparedMap,
    samples: Samples,
    T_a_b: Float[np.ndarray, "4 4"],
    *,
    scale: float = 1.0,
    num_steps: int,
    start_distance: float,
    final_distance: float,
    with_error: bool = True,
) -> Similarity:
    """Align map b to the surfaces of a, with a scale of all its lengths.

    Args:
        a: First map.
        samples: Points of map b as it is.
        T_a_b: Pose (4, 4) of the scaled map, where the alignment starts.
        scale: What the lengths of map b are multiplied by at the start.
        num_steps: Steps, at least one.
        start_distance: Robust scale at which the alignment starts [voxel].
        final_distance: Robust scale at which it ends [voxel].
        with_error: Whether the error of the scale is estimated, which takes as long as some steps; else it is infinite.
    """
    linear, shift = scale * T_a_b[:3, :3].astype(np.float64), T_a_b[:3, 3].astype(np.float64)
    voxel, log_scale, log_error, agreement = a.grid.voxel_size, np.log(scale), np.inf, 0.0
    offset = 0.0
    for step in range(num_steps + 1):
        # The robust scale shrinks over the first two thirds of the steps, as in `ops.evidence.align`.
        share = min(1.5 * step / num_steps, 1.0)
        reach = voxel * start_distance * (final_distance / start_distance) ** share
        found = _match(a, samples.points @ linear.T + shift, samples.sides @ linear.T, reach)
        found = found._replace(residuals=found.residuals - offset * found.fronts)
        if found.weights.sum() <= 0.0:
            break
        centre = np.average(found.places, axis=0, weights=found.weights)
        jacobian = _jacobian(found, centre)
        if step == num_steps:
            log_error = _log_error(found, jacobian, voxel) if with_error else np.inf
            agreement = found.weights.sum() / len(samples.points)
            break
        change = _solve(*_equations(jacobian, found))
        # A start that meets few points must not be thrown farther than matches are looked for, nor turned far.
        bounds = np.repeat([voxel * start_distance, 0.5, 0.1, voxel], [3, 3, 1, 1])
        change = np.clip(change, -bounds, bounds)
        turn = Rotation.from_rotvec(change[3:6]).as_matrix() * np.exp(change[6])
        linear, shift = turn @ linear, turn @ (shift - centre) + centre + change[:3]
        log_scale += change[6]
        offset += change[7]
    scale = float(np.exp(log_scale))
    T = np.eye(4, dtype=np.float32)
    T[:3, :3], T[:3, 3] = linear / scale, shift
    return Similarity(scale, T, float(log_error), float(agreement))


def _match(a: PreparedMap, moved: np.ndarray, sides: np.ndarray, reach: float) -> _Matches:
    """Points of b, in a, beside the surfaces that are nearest to them.

    Args:
        a: First map.
        moved: Points of b (n, 3) in a [m].
        sides: Which side of each is free (n, 3), in a; 0 where that is not known.
        reach: Robust scale [m].
    """
    index = ((moved - a.grid.origin) / a.grid.voxel_size).astype(np.float32).T
    cell, is_inside = cells_on_host(iter(index), a.grid.shape, np.asarray(a.table))
    keys = np.take(np.asarray(a.keys), cell)
    near = np.flatnonzero(is_inside & (keys != NOTHING_NEAR))
    row = keys[near] & np.uint32((1 << INDEX_BITS) - 1)
    places, normals = moved[near], np.asarray(a.normals)[row].astype(np.float64)
    gap, known = places - np.asarray(a.anchors)[row], np.asarray(a.sides)[row]
    # Thin walls have two faces, and the wrong one may be the nearer; well below 0, as in `ops.evidence.scoring`.
    is_alike = np.einsum("ij,ij->i", sides[near], known) > -0.3
    fronts = np.asarray(known.any(axis=1) & sides[near].any(axis=1), np.float64)
    robust = 1.0 / (1.0 + np.einsum("ij,ij->i", gap, gap) / reach**2) ** 2
    weights = robust * is_alike * np.asarray(a.planarity)[row]
    return _Matches(places, normals, fronts, np.einsum("ij,ij->i", gap, normals), weights)


def _jacobian(found: _Matches, centre: np.ndarray) -> Float[np.ndarray, "m 8"]:
    """How the residuals change with a shift, a turn about a centre, a scale about it, and surfaces that stand out."""
    arm = found.places - centre
    along = np.einsum("ij,ij->i", arm, found.normals)
    return np.column_stack([found.normals, np.cross(arm, found.normals), along, -found.fronts])


def _equations(jacobian: np.ndarray, found: _Matches) -> tuple[np.ndarray, np.ndarray]:
    """Normal matrix (8, 8) and gradient (8,)."""
    weighted = jacobian * found.weights[:, None]
    return weighted.T @ jacobian, weighted.T @ found.residuals


def _solve(hessian: np.ndarray, gradient: np.ndarray) -> np.ndarray:
    """The step (8,); what no surface fixes does not change."""
    diagonal = np.diag(hessian)
    shares = np.repeat([diagonal[:3].mean(), diagonal[3:6].mean(), *diagonal[6:]], [3, 3, 1, 1])
    return -np.linalg.solve(hessian + np.diag(1e-4 * shares + 1e-12), gradient)


def _log_error(found: _Matches, jacobian: np.ndarray, voxel: float, num_bins: int = 4) -> float:
    """Standard error of the logarithm of the scale, by leaving out one part of the surfaces at a time.

    Args:
        found: Points beside their surfaces, once they are aligned.
        jacobian: Their derivatives.
        voxel: Width of a voxel [m].
        num_bins: Parts along each of the two longest axes of the points.
    """
    arm = found.places - np.average(found.places, axis=0, weights=found.weights)
    axes = np.linalg.eigh((arm * found.weights[:, None]).T @ arm)[1][:, 1:]
    part = np.zeros(len(arm), np.int64)
    for along in (arm @ axes).T:
        bounds = np.quantile(along, np.arange(1, num_bins) / num_bins)
        part = num_bins * part + np.searchsorted(bounds, along)
    hessian, gradient = _equations(jacobian, found)
    found_without = []
    for one in np.unique(part):
        rows = part == one
        of_part = _equations(jacobian[rows], _Matches._make(each[rows] for each in found))
        found_without.append(_solve(hessian - of_part[0], gradient - of_part[1])[6])
    count = len(found_without)
    if count < 2:
        return np.inf
    jackknife = (count - 1) / count * np.sum((np.asarray(found_without) - np.mean(found_without)) ** 2)
    # Voxels round a surface to a place that all of it shares, so that it shows in no residual: by a number drawn evenly
    # from the width of a voxel, in each part another one, and seen over the lever that the scale has.
    diagonal = np.linalg.inv(hessian + 1e-9 * np.diag(np.diag(hessian)) + 1e-12 * np.eye(8))[6, 6]
    rounding = voxel**2 / 12 * diagonal * found.weights.sum() / count
    return float(np.sqrt(jackknife + rounding))
