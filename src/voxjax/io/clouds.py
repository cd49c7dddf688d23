"""Points of a cloud as they come: which of them are places, which are equal, and what rounding has left of them."""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float64

from .._checks import LARGEST_LENGTH, InputError, as_float64
from ..maps import findings
from ..maps.isolated import isolated_pieces
from .spacing import Spacing, cloud_spacing


class Cloud(NamedTuple):
    """What is used of a cloud.

    Attributes:
        points: Places [m], in the type that the file has.
        sensor_origins: Where they were seen from [m], as given: None, (3,) or one row a point.
        num_rows: How many points the file has.
        num_dropped: How many of them are NaN or infinite.
    """

    points: Float[np.ndarray, "n 3"]
    sensor_origins: np.ndarray | None
    num_rows: int
    num_dropped: int

    def keep(self, is_kept: Bool[np.ndarray, " n"]) -> "Cloud":
        """The cloud with some of its points, and their sensors."""
        origins = self.sensor_origins
        has_row_each = origins is not None and origins.ndim == 2 and len(origins) == len(is_kept)
        return self._replace(
            points=self.points[is_kept],
            sensor_origins=origins[is_kept] if origins is not None and has_row_each else origins,
        )


class OrderedPoints(NamedTuple):
    """All points of a cloud in an order in which equal ones stand together.

    Attributes:
        points: float64 (n, 3) [m].
        is_first: bool (n,): whether a point differs from the one before it.
    """

    points: Float64[np.ndarray, "n 3"]
    is_first: Bool[np.ndarray, " n"]

    @property
    def distinct(self) -> Float64[np.ndarray, "m 3"]:
        """Each place once [m]."""
        return self.points[self.is_first]


def usable_cloud(points: Float[np.ndarray, "n 3"], sensor_origins: object, *, strict: bool) -> Cloud:
    """The points of a file that are places.

    Args:
        points: All rows of the file [m].
        sensor_origins: None, (3,) or one row for each row of the file [m].
        strict: Whether NaN and infinite points are an error.

    Raises:
        InputError: If no point is a place, the sensor origins are no numbers, or a point is none under `strict`.
    """
    if not len(points):
        raise InputError("the cloud has no points")
    try:
        origins = None if sensor_origins is None else as_float64(sensor_origins)
    except (TypeError, ValueError):
        raise InputError(
            f"sensor_origins must be an array of numbers [m], got {type(sensor_origins).__name__}"
        ) from None
    is_finite = np.asarray(np.isfinite(points).all(axis=1))
    num_dropped = len(points) - int(np.count_nonzero(is_finite))
    if num_dropped == len(points):
        raise InputError(f"all {len(points):,} points of the cloud are NaN or infinite")
    if strict and num_dropped:
        raise InputError(
            f"{num_dropped:,} of {len(points):,} points are NaN or infinite, which strict (--strict) refuses; remove "
            "those points, or read the cloud without it, which drops them"
        )
    cloud = Cloud(points, origins, len(points), num_dropped)
    cloud = cloud.keep(is_finite) if num_dropped else cloud
    num_beyond = int(np.count_nonzero((np.abs(cloud.points) > LARGEST_LENGTH).any(axis=1)))
    if num_beyond:
        raise InputError(
            f"{num_beyond:,} of {len(points):,} points lie beyond {LARGEST_LENGTH:g} m; remove those points"
        )
    return cloud


def ordered_points(points: Float[np.ndarray, "n 3"]) -> OrderedPoints:
    """Sort the points of a cloud."""
    ordered = points[np.lexsort(points.T)].astype(np.float64)
    is_first = np.ones(len(ordered), bool)
    is_first[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    return OrderedPoints(ordered, is_first)


def check_no_duplicates(ordered: OrderedPoints) -> None:
    """Refuse a cloud with equal points.

    Raises:
        InputError: If there are some.
    """
    remark = findings.duplicates_remark(ordered.points, ordered.is_first)
    if remark is not None:
        seen = remark.text.partition(";")[0]
        raise InputError(
            f"{seen}, which strict (--strict) refuses; remove them, or read the cloud without it"
        )


def lost_steps(points: Float[np.ndarray, "n 3"]) -> Float64[np.ndarray, "3"]:
    """What single precision has rounded the coordinates of a cloud to along each axis [m]; 0 where nothing is lost.

    A cloud that float32 rounded has coordinates at odd multiples of the step between neighbouring numbers of float32.
    Where all are even ones, as whole metres are, no rounding happened.
    """
    steps = np.zeros(3)
    for number, axis in enumerate(points.T):
        # Few points far out have larger steps than the map.
        step = float(np.spacing(np.float32(np.median(np.abs(axis)))))
        multiples = axis.astype(np.float64) / step
        if np.mean(multiples == np.rint(multiples)) > 0.5 and np.mean(multiples % 2.0 == 1.0) > 0.25:
            steps[number] = step
    return steps


def check_precision(points: Float[np.ndarray, "n 3"], length: float, what: str) -> None:
    """Refuse a cloud whose coordinates single precision has rounded too coarsely.

    Args:
        points: The points [m].
        length: What has to be told apart [m].
        what: What that is, with its value.

    Raises:
        InputError: If places are rounded to more than that.
    """
    steps = lost_steps(points)
    axis = int(np.argmax(steps))
    if steps[axis] <= length:
        return
    coordinates = points[:, axis]
    distance, num_values = np.median(np.abs(coordinates)), len(np.unique(coordinates))
    raise InputError(
        f"its {'xyz'[axis]} coordinates are {distance:,.0f} m from zero, where single precision knows places "
        f"{steps[axis]:g} m apart only, so that {len(points):,} points have {num_values:,} values: too "
        f"coarse for {what}; export the cloud again with doubles, or subtract an offset before it is "
        "written (a shift of this file brings nothing back)"
    )


def spacing_of(ordered: OrderedPoints, dtype: np.dtype) -> Spacing:
    """How far apart the points of a cloud lie; isolated far pieces have no say in it.

    One stray beside the lattice of all others hides it, and one far out makes rounding look as coarse as it is there.

    Args:
        ordered: The points.
        dtype: The type in which they were written.
    """
    distinct = ordered.distinct
    # Before there are voxels, a point is as wide as nothing.
    main = distinct[isolated_pieces(distinct, voxel_size=0.0).piece < 0]
    return cloud_spacing(main, rounding_of(main.astype(dtype)))


def chosen_spacing(ordered: OrderedPoints, points: Float[np.ndarray, "n 3"]) -> Spacing:
    """How far apart the points lie, for a cloud whose voxel size is to be estimated.

    Raises:
        InputError: If that cannot be told, or was lost in rounding.
    """
    spacing = spacing_of(ordered, points.dtype)
    if not math.isfinite(spacing.voxel_size):
        raise InputError(
            "the voxel size cannot be estimated, because fewer than half of the points have neighbours on all sides "
            "of a surface; give voxel_size= (--voxel-size) in metres"
        )
    # Below two steps, the spacing that is seen is the one that rounding made.
    check_precision(
        points, spacing.closing / 2, f"the spacing of the points, which seems to be {spacing.closing:.3g} m"
    )
    return spacing


def rounding_of(points: Float[np.ndarray, "n 3"]) -> float:
    """Step between neighbouring numbers of the points' type at the farthest of them [m]."""
    return float(np.spacing(np.abs(points).max(initial=0)))


def filled_voxels(points: Float[np.ndarray, "n 3"], voxel_size: float) -> Float64[np.ndarray, "m 3"]:
    """Indices of the voxels that hold points, each once; counted from the frame's origin."""
    index = np.floor(points.astype(np.float64) / voxel_size)
    low = index.min(axis=0)
    sides = index.max(axis=0) - low + 1.0
    if float(np.prod(sides)) >= 2.0**62:
        return np.unique(index, axis=0)
    # One number a voxel is sorted many times as fast as three.
    (_, ny, nz), (x, y, z) = (int(side) for side in sides), (index - low).astype(np.int64).T
    flat = np.sort((x * ny + y) * nz + z)
    flat = flat[np.diff(flat, prepend=-1) > 0]
    return np.stack([flat // (ny * nz), flat // nz % ny, flat % nz], axis=1) + low
