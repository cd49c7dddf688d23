"""What a person should know about a map before it is used: one remark each, a sentence with its numbers.

All functions take numbers and arrays and open no file. Nothing found here is an error: a remark says what was seen,
why it matters and what can be done. What a good map has as well is no remark.
"""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Real

from ..frames import float32_step, float32_tells
from .isolated import IsolatedPieces

FOOT = 0.3048
"""Length of a foot [m]."""


class Remark(NamedTuple):
    """Something about a map that its user should know.

    Attributes:
        code: Short name of the kind, such as "isolated"; does not change with the wording.
        text: One sentence without a full stop.
        numbers: The figures in the sentence.
    """

    code: str
    text: str
    numbers: Mapping[str, float]

    def as_dict(self) -> dict[str, object]:
        """Plain data for JSON: "code", "text" and the numbers by their names."""
        return {"code": self.code, "text": self.text, **self.numbers}


def isolated_remark(pieces: IsolatedPieces, *, is_dropped: bool = False) -> Remark | None:
    """Pieces far from the rest of the map; None if there are none.

    Args:
        pieces: What was found, in metres.
        is_dropped: Whether they were left out.
    """
    count, number = int(pieces.num_voxels.sum()), len(pieces.distance)
    if not number:
        return None
    nearest, farthest = float(pieces.distance.min()), float(pieces.distance.max())
    far = f"{_metres(nearest)} to {_metres(farthest)}" if number > 1 else _metres(farthest)
    voxels, parts = "voxel" if count == 1 else "voxels", "piece" if number == 1 else "pieces"
    advice = "they were left out" if is_dropped else "drop_isolated (--drop-isolated) leaves such strays out"
    return Remark(
        "isolated",
        f"isolated from the rest by {far} m: {count:,} occupied {voxels} in {number:,} {parts}; {advice}",
        {
            "num_voxels": count,
            "num_pieces": number,
            "nearest_m": nearest,
            "farthest_m": farthest,
            "is_dropped": is_dropped,
        },
    )


def dropped_remark(num_dropped: int, num_rows: int) -> Remark | None:
    """Points that are no places; None if there are none."""
    if not num_dropped:
        return None
    return Remark(
        "not_finite",
        f"{num_dropped:,} of {num_rows:,} points are NaN or infinite and were dropped",
        {"num_dropped": num_dropped, "num_points": num_rows},
    )


def duplicates_remark(ordered: Real[np.ndarray, "n 3"], is_first: Bool[np.ndarray, " n"]) -> Remark | None:
    """Points that are equal to others; None if there are none.

    Args:
        ordered: All points, sorted, so that equal ones stand together.
        is_first: True where a point differs from the one before it.
    """
    num_duplicates = int(len(is_first) - np.count_nonzero(is_first))
    if not num_duplicates:
        return None
    starts = np.flatnonzero(is_first)
    runs = np.diff(np.append(starts, len(is_first)))
    # Rays that met nothing often have one place, that of the sensor, where no surface is.
    most, place = int(runs.max()) - 1, ordered[starts[runs.argmax()]]
    where = ", ".join(f"{value:g}" for value in place)
    of_one = ""
    if 2 * most > num_duplicates > 1:
        of_one = f", {most:,} of them at ({where}), as rays that met nothing may have"
    return Remark(
        "duplicates",
        f"{num_duplicates:,} of {len(is_first):,} points are equal to others{of_one}; equal points fill one voxel",
        {"num_duplicates": num_duplicates, "num_points": len(is_first)},
    )


def faces_remark(points: Real[np.ndarray, "n 3"], voxel_size: float) -> Remark | None:
    """Points that lie on faces between voxels, where rounding decides the voxel; None if few do.

    Args:
        points: The points [m].
        voxel_size: Edge length of a voxel [m].
    """
    places = np.asarray(points, np.float64) / voxel_size
    # Coordinates were single precision once, whatever keeps them now; a hundredth of a voxel is no rounding any more.
    farthest = np.abs(places).max(axis=0, initial=0.0).astype(np.float32)
    tolerance = np.minimum(4.0 * np.spacing(farthest), 0.01).astype(np.float64)
    share = float((np.abs(places - np.rint(places)) <= tolerance).any(axis=1).mean()) if len(places) else 0.0
    chance = 1.0 - float(np.prod(1.0 - 2.0 * tolerance))
    # Coordinates of few digits meet faces by chance too: ten values a voxel do so in 27 % of the points.
    if share - chance <= 0.3 * (1.0 - chance):
        return None
    return Remark(
        "on_faces",
        f"{100 * share:.0f} % of the points lie on faces between voxels of {voxel_size:g} m, where rounding decides "
        "the voxel; shift the points by half a voxel (shift=, voxjax convert --shift), or choose another voxel size",
        {"share": share, "by_chance": chance, "voxel_size": voxel_size},
    )


def units_remark(spacing: float, sides: Real[np.ndarray, "3"]) -> Remark | None:
    """Lengths that are improbable in metres and usual in another unit; None for all others.

    Args:
        spacing: Voxel size, or how far apart the points of a cloud lie [m].
        sides: Extent of the map along x, y, z without what is isolated [m].
    """
    smallest = float(sides.min())
    # These are properties of the world: sensors of robots resolve metres, and no robot maps a kilometre of height.
    coarse, high = 5.0, 1000.0
    if math.isfinite(spacing) and spacing >= coarse:
        return _unit("millimetres", 0.001, f"a spacing of {spacing:.4g} m", spacing, smallest)
    if smallest >= high:
        return _unit(
            "millimetres", 0.001, f"an extent of {smallest:.4g} m along each axis", spacing, smallest
        )
    # A round number of metres, written in feet, is hardly ever one that somebody chose.
    if _is_round(spacing * FOOT) and not _is_round(spacing):
        words = f"a spacing of {spacing:.6g} m, which is {spacing * FOOT:.4g} m in feet,"
        return _unit("feet", FOOT, words, spacing, smallest)
    return None


def _unit(unit: str, factor: float, words: str, spacing: float, smallest: float) -> Remark:
    # A cloud of few points has no spacing that could be measured.
    measured = {"spacing_m": spacing} if math.isfinite(spacing) else {}
    return Remark(
        "units",
        f"{words} hints at {unit}; if so, multiply all coordinates by {factor:g} (scale={factor:g}, voxjax convert "
        f"--scale {factor:g})",
        {"factor": factor, "smallest_side_m": smallest, **measured},
    )


def _is_round(length: float) -> bool:
    """Whether a length has one digit, or is 25 or 15 by a power of ten."""
    if not (math.isfinite(length) and length > 0):
        return False
    digits = length / 10.0 ** math.floor(math.log10(length))
    return any(abs(digits / whole - 1.0) < 5e-5 for whole in (1, 1.5, 2, 2.5, 3, 4, 5, 6, 7, 8, 9, 10))


def far_frame_remark(
    low: Real[np.ndarray, "3"], high: Real[np.ndarray, "3"], voxel_size: float
) -> Remark | None:
    """A map so far from the origin of its frame that float32 would lose its places; None for all others.

    Args:
        low: Lowest corner [m].
        high: Highest corner [m].
        voxel_size: Edge length of a voxel [m].
    """
    corners = np.stack([low, high]).astype(np.float64)
    farthest = float(np.abs(corners).max())
    if float32_tells(farthest, voxel_size):
        return None
    step = float32_step(farthest)
    distance = float(np.linalg.norm(corners.mean(axis=0)))
    return Remark(
        "far_frame",
        f"the map lies {_metres(distance)} m from the origin of its frame: positions are kept in float64, where single "
        f"precision would round them to {step:.2g} m",
        {"distance_m": distance, "float32_step_m": step},
    )


def rounded_origin_remark(origin: Real[np.ndarray, "3"], voxel_size: float) -> Remark | None:
    """A map whose file has put it where single precision could; None where that is where it was, to a hundredth.

    Args:
        origin: Outer corner as the file has it [m].
        voxel_size: Edge length of a voxel [m].
    """
    farthest = float(np.abs(origin).max())
    if float32_tells(farthest, voxel_size):
        return None
    step = float32_step(farthest)
    return Remark(
        "rounded_origin",
        f"the file keeps its origin, {_metres(farthest)} m from zero, in single precision, which knows places "
        f"{step:.2g} m apart there: the whole map may lie up to {step / 2:.2g} m off along each axis; write it again "
        "from its source",
        {"float32_step_m": step, "voxel_size": voxel_size},
    )


def emptiness_remark(shape: tuple[int, ...], num_known: int) -> Remark | None:
    """A box that is nearly empty; None for all others.

    Args:
        shape: Number of voxels along x, y, z.
        num_known: How many of them are free or occupied.
    """
    sides = sorted(shape)
    # A surface that spans the box has about as many voxels as its largest side; sparse scans have a tenth of that.
    largest_side = sides[1] * sides[2]
    if not 0 < num_known < largest_side / 100.0:
        return None
    share = num_known / math.prod(shape)
    return Remark(
        "nearly_empty",
        f"{100 * share:.2g} % of the box of {' x '.join(map(str, shape))} voxels is known, less than a hundredth of "
        "its largest side: the voxels are finer than the points lie apart, or a few lie far from the others",
        {"share_known": share, "num_known": num_known},
    )


def estimate_remark(voxel_size: float, closing: float, lattice: float | None) -> Remark:
    """The voxel size that was chosen for a cloud.

    Args:
        voxel_size: What was chosen [m].
        closing: Distance within which half of the points have neighbours on all sides [m].
        lattice: Step of the lattice that the points lie on [m]; None if there is none.
    """
    why = f"half of the points have neighbours on all sides of their surface within {closing:.3g} m"
    if lattice is not None:
        why = f"the points lie on a lattice of {lattice:g} m"
    return Remark(
        "estimated_voxel_size",
        f"voxel size estimated: {voxel_size:g} m, for {why}; voxel_size= (--voxel-size) sets another",
        {"voxel_size": voxel_size, "spacing_m": closing if lattice is None else lattice},
    )


def grid_remarks(
    low: Float[np.ndarray, "3"],
    high: Float[np.ndarray, "3"],
    voxel_size: float,
    num_known: int,
    *,
    has_strays: bool,
) -> list[Remark]:
    """Remarks about the box of a map, whatever it was made of.

    Args:
        low: Lowest corner [m].
        high: Highest corner [m].
        voxel_size: Edge length of a voxel [m].
        num_known: How many voxels are free or occupied.
        has_strays: Whether isolated voxels lie in the box, which then say more than that it is empty.
    """
    shape = tuple(int(side) for side in np.rint((high - low) / voxel_size))
    remarks = [
        far_frame_remark(low, high, voxel_size),
        None if has_strays else emptiness_remark(shape, num_known),
    ]
    return [remark for remark in remarks if remark is not None]


def _metres(length: float) -> str:
    """A length with the digits that a person reads."""
    return f"{length:,.0f}" if length >= 100 else f"{length:.3g}"
