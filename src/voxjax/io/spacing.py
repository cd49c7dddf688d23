"""How far apart the points of a cloud lie, and the voxel size that follows from it.

A cloud samples surfaces. It makes a good map where a surface is closed: where the next voxel of the surface holds a
point as well, on every side. Distances to the nearest point do not tell that: along the scan line of a lidar they are
centimetres where the next line is half a metre away. So a point is asked how far it has to look until it has a
neighbour on each of four sides of the surface, and half of the points may have to look farther than the voxel is wide.
"""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree


class Spacing(NamedTuple):
    """How far apart the points of a cloud lie.

    Attributes:
        closing: Distance within which half of the points have a neighbour on each of four sides [m]; infinite where
            fewer do.
        nearest: Distance within which half of the points have a neighbour at all [m].
        lattice: Step of the lattice on which all points lie [m], as the centres of voxels do; None for other clouds.
    """

    closing: float
    nearest: float
    lattice: float | None

    @property
    def voxel_size(self) -> float:
        """Voxel size [m] at which the surface is closed: 1, 2 or 5 by a power of ten, of metres or of the lattice.

        Infinite where the points show no surface and no lattice.
        """
        if self.lattice is None:
            return round_length(self.closing)
        # Voxels that touch have centres at most this far apart. Where they fill no surface, a line has to do.
        length = self.closing if math.isfinite(self.closing) else self.nearest
        steps = length / (math.sqrt(3.0) * self.lattice)
        return self.lattice * round_length(max(steps, 1.0))


def cloud_spacing(points: Float[np.ndarray, "n 3"], rounding: float) -> Spacing:
    """How far apart points lie.

    Args:
        points: Distinct points, sorted [m].
        rounding: What the coordinates are rounded to [m].
    """
    closing, nearest = closing_lengths(points)
    lattice = lattice_step(points, rounding)
    # Coordinates that were rounded to a few digits lie on a lattice too, which says nothing about their spacing.
    length = closing if math.isfinite(closing) else nearest
    is_of_voxels = lattice is not None and length < 20 * lattice
    return Spacing(closing, nearest, lattice if is_of_voxels else None)


def closing_lengths(points: Float[np.ndarray, "n 3"], *, num_samples: int = 2000) -> tuple[float, float]:
    """Distances [m] within which half of the points have a neighbour on each of four sides of their surface, or any.

    The sides are sectors of the plane through the neighbours of a point, about the direction in which they reach
    farthest: two along the scan line of a lidar, and two across it. On a square lattice this is its step, for points
    that were thrown at random it is 1.5 over the root of their number per area. A cloud scaled by a number has its
    length scaled by it.

    Args:
        points: Distinct points [m]; equal ones would be neighbours on no side.
        num_samples: How many of them are asked.

    Returns:
        The medians over the sample; infinite if fewer than half of the points have such neighbours.
    """
    if len(points) < 2:
        return math.inf, math.inf
    # The generator is always the same one, so that the same cloud has the same length.
    chosen = np.random.default_rng(0).permutation(len(points))[:num_samples]
    tree = KDTree(points, balanced_tree=False, compact_nodes=False)
    lengths = np.full(len(chosen), np.inf)
    left, count = np.arange(len(chosen)), min(64, len(points) - 1)
    # Dense scan lines take many neighbours until one lies across; the median needs no more than half of the points.
    while count >= 4 and len(left):
        # In pieces, so that many neighbours of many points take no memory to speak of.
        pieces = np.array_split(chosen[left], -(-len(left) * count // (1 << 16)))
        lengths[left] = np.concatenate([_closed_within(points, piece, tree, count) for piece in pieces])
        left = left[np.isinf(lengths[left])]
        if count >= min(1024, len(points) - 1):
            break
        count = min(2 * count, len(points) - 1)
    nearest = np.asarray(tree.query(points[chosen], k=2)[0])[:, 1]
    closing, nearest = (np.quantile(sample, 0.5, method="inverted_cdf") for sample in (lengths, nearest))
    return float(closing), float(nearest)


def _closed_within(
    points: Float[np.ndarray, "n 3"], chosen: Int[np.ndarray, " m"], tree: KDTree, count: int
) -> Float[np.ndarray, " m"]:
    """Distance [m] within which points have a neighbour on each side; infinite if it is none of the nearest ones."""
    distance, index = map(np.asarray, tree.query(points[chosen], k=count + 1))
    # The nearest of all is the point itself.
    distance, around = distance[:, 1:], points[index[:, 1:]] - points[chosen][:, None]
    centred = around - around.mean(axis=1, keepdims=True)
    _, axes = np.linalg.eigh(np.einsum("mki,mkj->mij", centred, centred))
    along, across = (np.einsum("mki,mi->mk", around, axes[:, :, axis]) for axis in (2, 1))
    is_along = np.abs(along) >= np.abs(across)
    sides = (
        is_along & (along > 0),
        is_along & (along < 0),
        ~is_along & (across > 0),
        ~is_along & (across < 0),
    )
    return np.max([np.where(side, distance, np.inf).min(axis=1) for side in sides], axis=0)


def lattice_step(points: Float[np.ndarray, "n 3"], rounding: float) -> float | None:
    """Step [m] of the cubic lattice along the axes on which all points lie.

    Args:
        points: The points [m]; the lattice may be shifted against the frame.
        rounding: What the coordinates are rounded to [m].

    Returns:
        The step; None where there is no lattice, or rounding hides it.
    """
    values = [np.sort(axis) for axis in points.T]
    # Coordinates that differ by rounding alone are one.
    gaps = [gap[gap > 4 * rounding] for gap in map(np.diff, values)]
    if not any(map(len, gaps)):
        return None
    step = min(float(gap.min()) for gap in gaps if len(gap))
    # The smallest gap is off by rounding; all of them together hold the step to far more digits.
    counts = [np.rint(gap / step) for gap in gaps]
    step = sum(float(gap.sum()) for gap in gaps) / sum(float(count.sum()) for count in counts)
    tolerance = max(4 * rounding / step, 1e-3)
    if tolerance > 0.1:
        return None
    for axis in values:
        steps = (axis - axis[0]) / step if len(axis) else axis
        if len(steps) and np.abs(steps - np.rint(steps)).max() > tolerance:
            return None
    # The step was a number of few digits once, as voxel sizes are: the shortest one that rounding cannot tell from it.
    longest = max(float(count.sum()) for count in counts)
    choices = (float(f"{step:.{digits}g}") for digits in range(1, 18))
    return next(
        choice for choice in choices if abs(choice - step) * longest <= 4 * rounding or choice == step
    )


def round_length(length: float) -> float:
    """The nearest of 1, 2 and 5 by a power of ten, by ratio; infinite lengths stay."""
    if not math.isfinite(length):
        return length
    power = math.floor(math.log10(length))
    choices = [float(f"{digit}e{exponent}") for exponent in (power, power + 1) for digit in (1, 2, 5)]
    return min(choices, key=lambda choice: abs(math.log(length / choice)))
