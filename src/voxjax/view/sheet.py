"""Sheets of pictures: each map, and the fused map coloured by who saw what."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from .._runtime.memory import check_memory
from .._types import OCCUPIED, Array
from ..frames import image
from ..maps.main_part import main_part
from .ceiling import find_cut
from .colors import SHARED_COLOR, color_by_height, map_color, tint_by_height
from .columns import Columns, free_columns, top_columns
from .paint import paint_isometric, paint_top
from .panels import Image, framed, legend, rows, stack, titled, trimmed
from .png import encode_png

if TYPE_CHECKING:
    from ..grid import VoxelGrid


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
        cut_ceiling: Whether the upper part of closed buildings is taken off, so that the rooms are seen.

    Raises:
        InputError: If there is not enough memory.
    """
    return _drawn(
        grid,
        grid.occupied_index(),
        width=width,
        height=height,
        color=color,
        view=view,
        cut_ceiling=cut_ceiling,
    )


def _drawn(
    grid: VoxelGrid,
    index: Int[np.ndarray, "n 3"],
    *,
    width: int,
    height: int,
    color: tuple[int, int, int] | UInt8[np.ndarray, "n 3"] | None = None,
    view: str = "isometric",
    cut_ceiling: bool = True,
) -> Image:
    """`draw_grid` for a map whose `occupied_index` is known: large maps take seconds to list it."""
    _check_memory(grid, len(index))
    heights = index[:, 2].astype(np.float64)
    eye = (1.0, 1.0, 1.0) if view == "isometric" else (0.0, 0.0, 1.0)
    cut = find_cut(index, eye=eye) if cut_ceiling else None
    is_below = np.ones(len(index), bool) if cut is None else cut.keeps(index)
    if color is None:
        shown = color_by_height(heights[is_below])
    else:
        base = np.broadcast_to(np.asarray(color, np.uint8), index.shape)[is_below]
        shown = tint_by_height(base, heights[is_below])
    index = index[is_below]
    if view == "isometric":
        return paint_isometric(index, shown, width=width, height=height)
    columns = top_columns(index, shown)
    low, high = _shown_window(grid, columns)
    # Of a map that leans, free space counts up to its top.
    top = int(cut.height) if cut is not None and cut.is_upright else grid.shape[2]
    return paint_top(columns, free_columns(grid, top, low, high), low, width=width, height=height)


def _shown_window(grid: VoxelGrid, columns: Columns, *, border: int = 5) -> tuple[np.ndarray, np.ndarray]:
    """Lowest x and y of what is drawn from above, and one past the highest, int64 (2,) each.

    Args:
        grid: The map.
        columns: What of it is occupied.
        border: Free space shown around it [voxel].
    """
    # Rays that left the house through a window reach far: what is occupied decides what is shown.
    if len(columns.place):
        low, high = columns.place.min(axis=0).astype(np.int64), columns.place.max(axis=0) + np.int64(1)
    else:
        low, high = (corner[:2] for corner in grid.known_box())
        border = border if (low < high).all() else 0
    return np.maximum(low - border, 0), np.minimum(high + border, grid.shape[:2])


def _check_memory(grid: VoxelGrid, num_occupied: int) -> None:
    """Refuse a map for which the memory does not suffice: its file may have been a few bytes."""
    columns = float(grid.shape[0]) * grid.shape[1]
    # Places, colours and ranks of what is drawn; columns with something free, twice.
    need = 120.0 * num_occupied + 2.0 * columns
    what = f"a picture of {' x '.join(map(str, grid.shape))} voxels"
    check_memory(need, what, "crop the map, or take a larger voxel size", on_device=False)


def seen_by(
    grids: Sequence[VoxelGrid], poses: Sequence[Array | None], fused: VoxelGrid
) -> Bool[np.ndarray, "maps n"]:
    """Find which maps have something occupied within one voxel of each occupied voxel of the fused map.

    Args:
        grids: The maps.
        poses: For each map the transform (4, 4) from its frame to that of `fused`, or None if it is no part.
        fused: The fused map.

    Returns:
        One row a map, one column for each of `fused.occupied_index()`.
    """
    points = fused.occupied_points()
    is_seen = np.zeros((len(grids), len(points)), bool)
    for row, grid, pose in zip(is_seen, grids, poses, strict=True):
        if pose is not None:
            # Rows times R are multiplied by its transpose: from the fused frame back into the map's. About the map's
            # middle, that is right for rotations of a few digits too, however far out the map lies.
            local, place = grid.localized()
            T = np.asarray(pose, np.float64)
            row[:] = _is_near_occupied(local, (points - image(T, place)) @ T[:3, :3])
    return is_seen


def share_colors(is_seen: Bool[np.ndarray, "maps n"]) -> UInt8[np.ndarray, "n 3"]:
    """The colour of the only map that saw a voxel, or the shared colour where several did."""
    colors = np.full((is_seen.shape[1], 3), (150, 150, 150), np.uint8)
    for number, row in enumerate(is_seen):
        colors[row] = map_color(number)
    # What no map saw within a voxel stays grey.
    colors[is_seen.sum(axis=0, dtype=np.int32) > 1] = SHARED_COLOR
    return colors


def draw_maps(
    grids: Sequence[VoxelGrid],
    *,
    names: Sequence[str] | None = None,
    cut_ceiling: bool = True,
    width: int = 1520,
) -> Image:
    """Draw each map in isometric view (above) and from above (below), coloured by height.

    Isolated far pieces are not drawn, and counted in the title (`maps/isolated.py`).

    Args:
        grids: The maps; two stand side by side.
        names: Labels of the maps.
        cut_ceiling: Whether the upper part of closed buildings is taken off, so that the rooms are seen.
        width: Width of two maps [pixel], without the margin around the sheet.

    Returns:
        uint8 (height, width, 3).
    """
    across = width // 2
    panels = []
    for number, whole in enumerate(grids):
        # A stray far away would make everything else a dot.
        grid, num_isolated = main_part(whole)
        index = grid.occupied_index()
        label = names[number] if names else f"map {number}"
        title = f"{label}   {len(index):,} occupied voxels{_not_drawn(num_isolated)}"
        isometric = _drawn(grid, index, width=across, height=across * 3 // 4, cut_ceiling=cut_ceiling)
        from_above = _drawn(
            grid, index, width=across, height=across * 5 // 9, view="top", cut_ceiling=cut_ceiling
        )
        panels.append(stack([titled(isometric, title), from_above]))
    return framed(rows(panels, per_row=2))


def draw_merge(
    grids: Sequence[VoxelGrid],
    poses: Sequence[Array | None],
    fused: VoxelGrid,
    *,
    names: Sequence[str] | None = None,
    width: int = 1500,
) -> Image:
    """Draw the maps, each in its own frame and colour, and the fused map coloured by which maps saw what.

    Isolated far pieces are not drawn, and counted in the titles (`maps/isolated.py`).

    Args:
        grids: The maps that were merged.
        poses: For each map its transform (4, 4) into the frame of `fused`; None for maps that were left out.
        fused: The fused map.
        names: Labels of the maps.
        width: Width of the drawing [pixel], without the margin around the sheet.

    Returns:
        uint8 (height, width, 3).
    """
    # The legend has an entry for each map that is in the fused one; others could not be found in the picture.
    labels = list(names) if names else [f"map {number}" for number in range(len(grids))]
    grids, nums_isolated = zip(*map(main_part, grids), strict=True)
    fused, num_isolated = main_part(fused)
    is_used = [pose is not None for pose in poses]
    entries = [(f"only {labels[n]}", map_color(n)) for n, used in enumerate(is_used) if used]
    return framed(
        stack(
            [
                _maps_in_their_frames(grids, labels, is_used, width, nums_isolated),
                _fused_views(fused, share_colors(seen_by(grids, poses, fused)), width, num_isolated),
                legend([*entries, ("two or more", SHARED_COLOR)], width),
            ]
        )
    )


def _maps_in_their_frames(
    grids: Sequence[VoxelGrid],
    labels: Sequence[str],
    is_used: Sequence[bool],
    width: int,
    nums_isolated: Sequence[int],
) -> Image:
    """Each map in its colour, in isometric view and below it from above, side by side."""
    # A single map takes half of the width and more than four go into further rows, or labels could not be read.
    columns = min(max(len(grids), 2), 4)
    across = width // columns
    blocks = []
    for start in range(0, len(grids), columns):
        numbers = range(start, min(start + columns, len(grids)))
        views = [
            trimmed(
                [
                    draw_grid(grids[n], width=across, height=across * 2 // 3, color=map_color(n), view=view)
                    for n in numbers
                ]
            )
            for view in ("isometric", "top")
        ]
        for n, isometric, from_above in zip(numbers, *views, strict=True):
            note = "in its own frame" if is_used[n] else "fits none, left out"
            title = f"{labels[n]}: {note}{_not_drawn(nums_isolated[n])}"
            blocks.append(stack([titled(isometric, title, map_color(n)), from_above]))
    return rows(blocks, per_row=columns)


def _fused_views(fused: VoxelGrid, colors: UInt8[np.ndarray, "n 3"], width: int, num_isolated: int) -> Image:
    """The fused map in isometric view and, beside it, from above."""
    left, height, index = width // 2, width * 2 // 5, fused.occupied_index()
    isometric, from_above = trimmed(
        [
            _drawn(fused, index, width=left, height=height, color=colors),
            _drawn(fused, index, width=width - left, height=height, color=colors, view="top"),
        ]
    )
    title = f"fused: {len(index):,} occupied voxels{_not_drawn(num_isolated)}"
    return rows([titled(isometric, title), titled(from_above, "the same from above")], per_row=2)


def _not_drawn(num_isolated: int) -> str:
    """What a title says of voxels that lie far away from all the rest."""
    return f", {num_isolated:,} far away not drawn" if num_isolated else ""


def grid_png(grid: VoxelGrid, *, width: int = 640, height: int = 440) -> bytes:
    """The picture of one map as the bytes of a PNG file, for notebooks."""
    return encode_png(draw_grid(grid, width=width, height=height))


def _is_near_occupied(grid: VoxelGrid, points: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
    """Return whether the voxel of each point [m], or one of the 26 voxels around it, is occupied."""
    cells = np.floor((points - np.asarray(grid.origin, np.float64)) / grid.voxel_size)
    # Far places would not fit an integer: they are clipped as floats, to where no voxel of the grid is near.
    cells = np.clip(cells, -2, np.asarray(grid.shape) + 1).astype(np.int64)
    near = np.zeros(len(points), bool)
    # The voxel itself first, in which most points are done with.
    for step in sorted(np.ndindex(3, 3, 3), key=lambda step: sum(abs(s - 1) for s in step)):
        left = np.flatnonzero(~near)
        there = cells[left] + (np.asarray(step) - 1)
        is_inside = ((there >= 0) & (there < grid.shape)).all(axis=1)
        near[left[is_inside]] = grid.states_at(there[is_inside]) == OCCUPIED
    return near
