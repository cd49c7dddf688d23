"""Sheets of pictures: each map, and the fused map coloured by who saw what."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float, UInt8

from .._types import FREE, OCCUPIED, Array
from .colors import BACKGROUND, INK, SHARED_COLOR, color_by_height, map_color, tint_by_height
from .font import write_text
from .paint import ceiling_cut, paint_isometric, paint_top
from .png import encode_png

if TYPE_CHECKING:
    from ..grid import VoxelGrid

Image = UInt8[np.ndarray, "_ _ 3"]
_MARGIN = 24
_TITLE = 34


def draw_grid(
    grid: VoxelGrid,
    *,
    width: int = 760,
    height: int = 560,
    color: tuple[int, int, int] | UInt8[np.ndarray, "n 3"] | None = None,
    view: str = "isometric",
    cut_ceiling: bool = True,
) -> Image:
    """Draw one map.

    Args:
        grid: The map.
        width: Width [pixel].
        height: Height [pixel].
        color: None colours by height; one colour, or one for each of `grid.occupied_index()`, is tinted.
        view: "isometric" or "top".
        cut_ceiling: Take the upper part of closed buildings off, so that the rooms are seen.
    """
    states = np.asarray(grid.states)
    is_occupied = states == OCCUPIED
    index = np.argwhere(is_occupied)
    heights = index[:, 2].astype(np.float64)
    cut = ceiling_cut(is_occupied) if cut_ceiling else states.shape[2]
    is_below = index[:, 2] < cut
    if color is None:
        shown = color_by_height(heights[is_below])
    else:
        base = np.broadcast_to(np.asarray(color, np.uint8), index.shape)[is_below]
        shown = tint_by_height(base, heights[is_below])
    index = index[is_below]
    if view == "isometric":
        return paint_isometric(index, shown, width=width, height=height)
    column_color = np.full((*states.shape[:2], 3), 255, np.uint8)
    rising = np.argsort(index[:, 2], kind="stable")
    for layer in np.split(
        rising, np.flatnonzero(np.diff(index[rising, 2])) + 1
    ):  # the topmost is written last
        column_color[index[layer, 0], index[layer, 1]] = shown[layer]
    below = np.arange(states.shape[2]) < cut
    return paint_top(is_occupied & below, (states == FREE) & below, column_color, width=width, height=height)


def seen_by(
    grids: Sequence[VoxelGrid], poses: Sequence[Array | None], fused: VoxelGrid
) -> Bool[np.ndarray, "maps n"]:
    """Which maps have something occupied within one voxel of each occupied voxel of the fused map.

    Args:
        grids: The maps.
        poses: For each map the transform (4, 4) from its frame to that of `fused`, or None if it is no part.
        fused: The fused map.

    Returns:
        One row a map, one column for each of `fused.occupied_index()`.
    """
    points = fused.occupied_points().astype(np.float64)
    rows = np.zeros((len(grids), len(points)), bool)
    for row, grid, pose in zip(rows, grids, poses, strict=True):
        if pose is not None:
            T = np.asarray(pose, np.float64)
            row[:] = _is_near_occupied(grid, (points - T[:3, 3]) @ T[:3, :3])
    return rows


def share_colors(is_seen: Bool[np.ndarray, "maps n"]) -> UInt8[np.ndarray, "n 3"]:
    """The colour of the only map that saw a voxel, or the shared colour where several did."""
    colors = np.full((is_seen.shape[1], 3), (150, 150, 150), np.uint8)
    for number, row in enumerate(is_seen):
        colors[row] = map_color(number)
    colors[is_seen.sum(axis=0, dtype=np.int32) > 1] = SHARED_COLOR
    return colors


def draw_maps(
    grids: Sequence[VoxelGrid], *, names: Sequence[str] | None = None, cut_ceiling: bool = True
) -> Image:
    """Draw each map in isometric view (above) and from above (below), coloured by height."""
    panels = []
    for number, grid in enumerate(grids):
        title = f"{names[number] if names else f'map {number}'}   {grid.num_occupied:,} occupied voxels"
        isometric = draw_grid(grid, cut_ceiling=cut_ceiling)
        from_above = draw_grid(grid, view="top", height=420, cut_ceiling=cut_ceiling)
        panels.append(_stack([_titled(isometric, title), from_above]))
    return _frame(_rows(panels, per_row=2))


def draw_merge(
    grids: Sequence[VoxelGrid],
    poses: Sequence[Array | None],
    fused: VoxelGrid,
    *,
    names: Sequence[str] | None = None,
) -> Image:
    """Draw the maps, each in its own frame and colour, and the fused map coloured by which maps saw what.

    Args:
        grids: The maps that were merged.
        poses: For each map its transform (4, 4) into the frame of `fused`; None for maps that were left out.
        fused: The fused map.
        names: Labels of the maps.

    Returns:
        uint8 (height, width, 3).
    """
    labels = list(names) if names else [f"map {number}" for number in range(len(grids))]
    columns = min(max(len(grids), 2), 4)
    sheet_width = 1500
    small = sheet_width // columns
    panels = []
    for number, grid in enumerate(grids):
        left_out = "" if poses[number] is not None else "  (fits none, left out)"
        views = [
            draw_grid(grid, width=small, height=small * 2 // 3, color=map_color(number), view=view)
            for view in ("isometric", "top")
        ]
        title = f"{labels[number]}{left_out}"
        panels.append(_stack([_titled(views[0], title, map_color(number)), views[1]]))
    colors = share_colors(seen_by(grids, poses, fused))
    half = sheet_width // 2
    fused_panels = [
        _titled(draw_grid(fused, width=width, height=640, color=colors, view=view), title)
        for width, view, title in (
            (half, "isometric", f"fused   {fused.num_occupied:,} occupied voxels"),
            (sheet_width - half, "top", "fused, from above"),
        )
    ]
    legend = _legend(
        [*((label, map_color(n)) for n, label in enumerate(labels) if poses[n] is not None)], sheet_width
    )
    return _frame(_stack([_rows(panels, per_row=columns), _rows(fused_panels, per_row=2), legend]))


def grid_png(grid: VoxelGrid, *, width: int = 640, height: int = 440) -> bytes:
    """The picture of one map as the bytes of a PNG file, for notebooks."""
    return encode_png(draw_grid(grid, width=width, height=height))


def _is_near_occupied(grid: VoxelGrid, points: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
    """Whether the voxel of each point [m], or one of its 26 neighbours, is occupied."""
    padded = np.pad(np.asarray(grid.states) == OCCUPIED, 2)  # the outermost layer catches what lies outside
    cells = np.floor((points - np.asarray(grid.origin, np.float64)) / grid.voxel_size)
    cells = np.clip(cells + 2, 0, np.asarray(padded.shape) - 1).astype(np.int64)
    near = np.zeros(len(points), bool)
    for step in np.ndindex(3, 3, 3):
        x, y, z = np.clip(cells + np.asarray(step) - 1, 0, np.asarray(padded.shape) - 1).T
        near |= padded[x, y, z]
    return near


def _titled(image: Image, title: str, color: tuple[int, int, int] = INK) -> Image:
    """`image` below a line of text."""
    line = np.full((_TITLE, image.shape[1], 3), BACKGROUND, np.uint8)
    longest = (image.shape[1] - 16) // 12
    write_text(
        line, title if len(title) <= longest else title[: longest - 2] + "..", left=8, top=10, color=color
    )
    return np.concatenate([line, image])


def _legend(entries: Sequence[tuple[str, tuple[int, int, int]]], width: int) -> Image:
    """One line of coloured squares with their meanings."""
    line = np.full((_TITLE + 8, width, 3), BACKGROUND, np.uint8)
    left = 8
    for label, color in [*((f"only {name}", c) for name, c in entries), ("two or more", SHARED_COLOR)]:
        line[10:28, left : left + 18] = color
        write_text(line, label, left=left + 28, top=12)
        left += 28 + 12 * len(label) + 30
    return line


def _stack(images: Sequence[Image]) -> Image:
    """Images of any width one below the other."""
    width = max(image.shape[1] for image in images)
    return np.concatenate([_padded(image, image.shape[0], width) for image in images])


def _rows(images: Sequence[Image], *, per_row: int) -> Image:
    """Images side by side, `per_row` in each row."""
    rows = []
    for start in range(0, len(images), per_row):
        row = images[start : start + per_row]
        height = max(image.shape[0] for image in row)
        rows.append(np.concatenate([_padded(image, height, image.shape[1]) for image in row], axis=1))
    return _stack(rows)


def _padded(image: Image, height: int, width: int) -> Image:
    """`image` in the upper left of a background of that size."""
    canvas = np.full((height, width, 3), BACKGROUND, np.uint8)
    canvas[: image.shape[0], : image.shape[1]] = image
    return canvas


def _frame(image: Image) -> Image:
    """`image` with a margin on all sides."""
    return np.pad(image, ((_MARGIN, _MARGIN), (_MARGIN, _MARGIN), (0, 0)), constant_values=255)
