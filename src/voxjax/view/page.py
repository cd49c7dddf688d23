"""A self-contained HTML page in which the fused map can be turned around (needs the extra `view`)."""

from __future__ import annotations

import contextlib
import io
import socket
from collections.abc import Sequence
from importlib.util import find_spec
from typing import TYPE_CHECKING

import numpy as np

from .._checks import InputError
from .._types import Array
from .ceiling import find_cut
from .colors import tint_by_height
from .sheet import seen_by, share_colors

if TYPE_CHECKING:
    from ..grid import VoxelGrid


def check_page_support() -> None:
    """Raise if the library behind the page is not installed.

    Raises:
        InputError: If it is not installed; the message says what to install.
    """
    if find_spec("viser") is None:
        raise InputError(
            "--html needs the package viser, which is not installed; run: pip install 'voxjax[view]'."
        )


def page_html(grids: Sequence[VoxelGrid], poses: Sequence[Array | None], fused: VoxelGrid) -> str:
    """Return a web page that shows the fused map, coloured by which maps saw what, without its ceiling.

    Args:
        grids: The maps that were merged.
        poses: For each map its transform (4, 4) into the frame of `fused`; None for maps that were left out.
        fused: The fused map.

    Raises:
        InputError: If the package viser is not installed.
    """
    check_page_support()
    import viser

    index, eye = fused.occupied_index(), (0.6, 0.6, 0.7)
    # From above, where the camera starts, a ceiling would hide all rooms.
    cut = find_cut(index, eye=eye)
    is_shown = np.ones(len(index), bool) if cut is None else cut.keeps(index)
    points = fused.occupied_points()[is_shown]
    colors = share_colors(seen_by(grids, poses, fused))[is_shown]
    colors = tint_by_height(colors, index[is_shown, 2].astype(np.float64))
    centre = points.mean(axis=0, dtype=np.float64) if len(points) else np.zeros(3)
    reach = float(np.ptp(points, axis=0).max()) if len(points) else 1.0
    with contextlib.redirect_stdout(io.StringIO()):  # viser prints a banner
        server = viser.ViserServer(host="127.0.0.1", port=_free_port(), verbose=False)
    try:
        server.scene.set_up_direction("+z")
        server.initial_camera.position = tuple(np.asarray(eye) * reach)
        server.initial_camera.look_at = (0.0, 0.0, 0.0)
        # The camera turns about the page's origin, so the map is centred there.
        server.scene.add_point_cloud(
            "/fused",
            (points - centre).astype(np.float32),
            colors,
            point_size=fused.voxel_size,
            point_shape="square",
        )
        return server.scene.as_html()
    finally:
        # The page is complete in itself; the server has served only to put it together.
        with contextlib.redirect_stdout(io.StringIO()):
            server.stop()


def _free_port() -> int:
    """A port of this machine that is free now; the page's library insists on listening while it draws."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
