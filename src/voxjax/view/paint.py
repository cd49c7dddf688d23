"""Voxels to pixels with NumPy alone: an isometric view and a view from above.

Both draw larger than asked by a whole factor and average down, which smooths the edges.
"""

import itertools
import math

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from .._runtime.memory import check_memory
from .colors import BACKGROUND, FREE_TINT
from .columns import Columns

MOST_PIXELS = 24_000_000
"""Pixels of a picture before it is made smaller."""

CELLS_AT_ONCE = 1 << 21
"""Of a view from above, pixels that are painted before they are made smaller."""


def paint_isometric(
    index: Int[np.ndarray, "n 3"], color: UInt8[np.ndarray, "n 3"], *, width: int, height: int
) -> UInt8[np.ndarray, "height width 3"]:
    """Draw voxels as shaded cubes seen from +x, +y and above, centred in a picture of that size.

    Args:
        index: Voxel coordinates.
        color: One colour a voxel.
        width: Width of the picture [pixel].
        height: Height of the picture [pixel].
    """
    if not len(index):
        return np.full((height, width, 3), BACKGROUND, np.uint8)
    index, color = _bearable(index, color)
    # Two axes run down to either side by half as much as across, and height runs up: whole steps, so that cubes
    # tile.
    across, down = index[:, 1] - index[:, 0], index[:, 0] + index[:, 1] - 2 * index[:, 2]
    spans = (2.0 * (np.ptp(across) + 2), float(np.ptp(down) + 4))  # in half-edges of a voxel
    half, factor = _best_scale(spans, width, height)
    # The sum of the coordinates grows toward the eye, which looks along their diagonal.
    order = np.argsort(index.sum(axis=1, dtype=np.int64), kind="stable")  # far to near
    # Places in the picture are counted in int64, for indices of voxels may be int32.
    pixel_x = (across[order].astype(np.int64) - across.min() + 1) * 2 * half
    pixel_y = (down[order].astype(np.int64) - down.min()) * half
    big = (int(pixel_y.max()) + 4 * half + 1, int(pixel_x.max()) + 2 * half + 1)
    # For each of its pixels: who is seen and how far, the shade, and the colours before they are one byte.
    what = f"a picture of {big[1]:,} x {big[0]:,} pixels before it is made smaller"
    check_memory(60.0 * big[0] * big[1], what, "crop the map, or take a larger voxel size", on_device=False)
    owner = np.full(big, -1, np.int64)
    for dx, dy, face in _cube_stamp(half):
        # The nearest voxel has the highest rank, so the maximum settles who is seen.
        np.maximum.at(
            owner.reshape(-1), (pixel_y + dy) * big[1] + pixel_x + dx, np.arange(len(order)) * 3 + face
        )
    is_hit = owner >= 0
    rank, face = owner[is_hit] // 3, owner[is_hit] % 3
    depth = np.full(big, np.nan)
    depth[is_hit] = index[order].sum(axis=1, dtype=np.int64)[rank]
    face_light = np.asarray([1.0, 0.80, 0.62])  # top, left, right
    shade = face_light[face] * _edge_shade(depth)[is_hit]
    picture = np.full((*big, 3), 255.0, np.float32)
    picture[is_hit] = color[order][rank] * shade[:, None]
    return _centred(_shrink(picture, factor), width, height)


def _bearable(
    index: Int[np.ndarray, "n 3"], color: UInt8[np.ndarray, "n 3"]
) -> tuple[Int[np.ndarray, "m 3"], UInt8[np.ndarray, "m 3"]]:
    """Larger voxels, where a picture of the given ones would have more pixels than are drawn before it is shrunk."""

    def num_pixels(factor: int) -> int:
        x, y, z = (np.ptp(index, axis=0).astype(np.int64) // factor + 1).tolist()
        return 2 * (x + y) * (x + y + 2 * z)

    if num_pixels(1) <= MOST_PIXELS:
        return index, color
    # Where voxels become larger anyway, a quarter of the pixels is still more than the picture shows.
    factor = next(factor for factor in itertools.count(2) if 4 * num_pixels(factor) <= MOST_PIXELS)
    # Of the voxels that become one, the nearest to the eye is seen.
    order = np.argsort(index.sum(axis=1, dtype=np.int64), kind="stable")[::-1]
    cell = index[order] // factor - index.min(axis=0) // factor
    flat = np.ravel_multi_index(tuple(cell.T), tuple(cell.max(axis=0) + 1))
    _, first = np.unique(flat, return_index=True)
    return cell[first], color[order[first]]


def paint_top(
    columns: Columns,
    is_free: Bool[np.ndarray, "x y"],
    low: Int[np.ndarray, "2"],
    *,
    width: int,
    height: int,
) -> UInt8[np.ndarray, "height width 3"]:
    """Draw a map from above, x to the right and y up: the topmost occupied voxel of each column.

    Columns with free voxels only get a light tint, unknown ones stay white.

    Args:
        columns: What is occupied; a ceiling hides the rooms unless it was cut off before.
        is_free: Which columns of the window that is drawn hold a free voxel.
        low: Lowest x and y of this window [voxel].
        width: Width of the picture [pixel].
        height: Height of the picture [pixel].
    """
    if not is_free.size:
        return np.full((height, width, 3), BACKGROUND, np.uint8)
    across, down = is_free.shape
    zoom, factor = _best_scale((float(across), float(down)), width, height)
    # Some rows at a time, which become whole rows of the smaller picture.
    least = factor // math.gcd(zoom, factor)
    step = least * max(CELLS_AT_ONCE // (across * zoom * zoom * least), 1)
    x, from_top = columns.place[:, 0] - low[0], down - 1 - (columns.place[:, 1] - low[1])
    order = np.argsort(from_top, kind="stable")
    starts = range(0, down, step)
    ends = np.searchsorted(from_top[order], [*starts, down])
    strips = []
    for start, begin, end in zip(starts, ends, ends[1:], strict=False):
        rows = order[begin:end]
        place = from_top[rows] - start, x[rows]
        tint = is_free[:, ::-1][:, start : start + step].T
        strip = _from_above(place, columns.top[rows], columns.color[rows], tint)
        strips.append(_shrink(strip.repeat(zoom, axis=0).repeat(zoom, axis=1), factor))
    return _centred(np.concatenate(strips), width, height)


def _from_above(
    place: tuple[np.ndarray, np.ndarray],
    height: Int[np.ndarray, " n"],
    color: UInt8[np.ndarray, "n 3"],
    is_free: Bool[np.ndarray, "h w"],
) -> Float[np.ndarray, "h w 3"]:
    """Some rows of a map from above: colours lightened where the column on the left is lower, darkened where higher."""
    top = np.zeros(is_free.shape)
    top[place] = height
    picture = np.full((*is_free.shape, 3), 255.0, np.float32)
    picture[is_free] = FREE_TINT
    light = np.clip(0.94 + 0.05 * (np.roll(top, 1, axis=1)[place] - top[place]) * -1.0, 0.72, 1.08)
    picture[place] = np.clip(color * light[:, None], 0, 255)
    return picture


def _best_scale(spans: tuple[float, float], width: int, height: int) -> tuple[int, int]:
    """Return the whole factors (enlarge, shrink) that fill the picture best, at a bearable cost.

    Args:
        spans: Extents (across, down) of what is drawn, in units of the drawing.
        width: Width of the picture [pixel].
        height: Height of the picture [pixel].
    """
    most_shrink, most_enlarge = 32, 16
    best = (1, most_shrink)
    for shrink in range(2, most_shrink + 1):
        enlarge = min(int(min(width * shrink / spans[0], height * shrink / spans[1])), most_enlarge)
        is_small = spans[0] * spans[1] * enlarge * enlarge <= MOST_PIXELS
        if enlarge >= 1 and is_small and enlarge * best[1] > best[0] * shrink:
            best = (enlarge, shrink)
        if best[0] >= 5 or (shrink >= 4 and best[1] < most_shrink):
            break  # finer steps would not be seen
    return best


def _cube_stamp(half: int) -> list[tuple[int, int, int]]:
    """Return pixels (dx, dy) of a cube from its top corner, and the face each shows: 0 top, 1 left, 2 right."""
    stamp = []
    for dy in range(4 * half):
        for dx in range(-2 * half, 2 * half):
            x, y = abs(dx + 0.5), dy + 0.5  # pixel centres never lie on an edge, so neighbouring cubes tile
            lower_edge = 2 * half - x / 2
            if x + 2 * abs(y - half) <= 2 * half:
                stamp.append((dx, dy, 0))
            elif lower_edge < y <= lower_edge + 2 * half:
                stamp.append((dx, dy, 1 if dx < 0 else 2))
    return stamp


def _edge_shade(depth: Float[np.ndarray, "h w"]) -> Float[np.ndarray, "h w"]:
    """Darken pixels whose neighbours are much nearer to the eye, which draws soft outlines around things."""
    bottom = np.nan_to_num(depth, nan=-1e9)
    excess = np.zeros_like(bottom)
    for axis, step in ((0, 1), (0, -1), (1, 1), (1, -1)):
        for reach in (2, 4):
            neighbour = np.roll(bottom, step * reach, axis=axis)
            excess += np.clip(neighbour - bottom - 2.0 * reach, 0.0, 20.0) * (neighbour > -1e8)
    return np.exp(-0.006 * excess)


def _shrink(picture: Float[np.ndarray, "h w 3"], factor: int) -> Float[np.ndarray, "h2 w2 3"]:
    """Average blocks of `factor` x `factor` pixels; the border is filled up with white."""
    pad = [(0, -picture.shape[axis] % factor) for axis in (0, 1)]
    padded = np.pad(picture, [*pad, (0, 0)], constant_values=255.0)
    height, width = padded.shape[0] // factor, padded.shape[1] // factor
    return padded.reshape(height, factor, width, factor, 3).mean(axis=(1, 3), dtype=np.float32)


def _centred(
    picture: Float[np.ndarray, "h w 3"], width: int, height: int
) -> UInt8[np.ndarray, "height width 3"]:
    """`picture` in the middle of a white one of the given size; what stands out is cut off."""
    canvas = np.full((height, width, 3), BACKGROUND, np.uint8)
    picture = picture[:height, :width]
    top, left = (height - picture.shape[0]) // 2, (width - picture.shape[1]) // 2
    canvas[top : top + picture.shape[0], left : left + picture.shape[1]] = np.clip(picture, 0, 255).astype(
        np.uint8
    )
    return canvas
