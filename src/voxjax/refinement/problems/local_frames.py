"""Maps of a refinement in local frames, where float32 has digits to spare, and the poses found back in their own."""

from collections.abc import Mapping
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Float32

from ..._runtime.placement import is_traced
from ..._types import Array
from ...frames import from_local, to_local
from ...grid import VoxelGrid, check_grid
from ...maps.prepared import PreparedMap


class LocalFrames(NamedTuple):
    """Maps in the frames in which they are refined.

    Attributes:
        grids: The maps, by the names that errors call them.
        origins: Origin of each map's local frame in its own frame [m]; zero where the map stayed as it was.
    """

    grids: dict[str, VoxelGrid | PreparedMap]
    origins: list[Float[np.ndarray, "3"]]

    def own_pose(
        self,
        found: Float[Array, "*starts 4 4"],
        start: Float[Array, "*starts 4 4"],
        given: Float[Array, "*starts 4 4"],
    ) -> Float[Array, "*starts 4 4"]:
        """A pose between the local frames of two maps as the one between their own, float64; a traced one as it is.

        Args:
            found: One pose, or several.
            start: From where each was found, in local frames.
            given: The same starts between the maps' own frames: what is still the start comes back as it was given.
        """
        if is_traced(found) or is_traced(start):  # then it was found between the maps' own frames
            return found
        own = from_local(np.asarray(found), *self.origins)
        is_start = (np.asarray(found) == np.asarray(start)).all(axis=(-2, -1), keepdims=True)
        return np.where(is_start, np.asarray(given, np.float64), own)

    def local_poses(
        self, poses: Float[np.ndarray, "maps 4 4"], world: Float[np.ndarray, "3"]
    ) -> Float32[np.ndarray, "maps 4 4"]:
        """Poses of all maps in the world as those between their local frames and one that begins at `world` [m]."""
        local = [to_local(T, world, origin) for T, origin in zip(poses, self.origins, strict=True)]
        return np.stack(local).astype(np.float32)

    def own_poses(
        self,
        found: Float[Array, "maps 4 4"],
        world: Float[np.ndarray, "3"],
        start: Float[np.ndarray, "maps 4 4"],
        is_held: Bool[np.ndarray, "maps"],
    ) -> Float[Array, "maps 4 4"]:
        """Poses found from `local_poses` as those of the maps in the world, float64; traced ones keep their dtype.

        Args:
            found: Poses in local frames.
            world: Where the local frame of the world begins [m].
            start: The poses that the maps had: those that are held or still there keep them to the bit, which a way
                there and back would not do.
            is_held: Which maps are held.
        """
        if is_traced(found):  # then no map is in a local frame, and the world alone was shifted
            shift = np.zeros((1, 4, 4), found.dtype)
            shift[0, :3, 3] = world
            return jnp.where(is_held[:, None, None], start.astype(found.dtype), found + shift)
        own = [
            from_local(T, world, origin) for T, origin in zip(np.asarray(found), self.origins, strict=True)
        ]
        is_start = (np.asarray(found) == self.local_poses(start, world)).all(axis=(1, 2))
        return np.where((is_held | is_start)[:, None, None], start, np.stack(own))


def local_frames(grids: Mapping[str, VoxelGrid | PreparedMap], *, is_wanted: bool) -> LocalFrames:
    """Maps in local frames.

    Maps stay in their own frames where something is traced, whose digits are those that JAX has, and so do maps that
    were prepared before.

    Args:
        grids: The maps, by the names that errors call them; what is no map stays for those who say so.
        is_wanted: Whether poses are values, and nobody else's residuals are about the maps' own frames.

    Raises:
        InputError: If JAX has lost where a map lies.
    """
    for name, grid in grids.items():
        if isinstance(grid, VoxelGrid):
            check_grid(name, grid)
    parts = [jax.tree.leaves(grid) for grid in grids.values() if isinstance(grid, VoxelGrid)]
    if not is_wanted or any(is_traced(part) for each in parts for part in each):
        return LocalFrames(dict(grids), [np.zeros(3)] * len(grids))
    moved = [
        grid.localized() if isinstance(grid, VoxelGrid) else (grid, np.zeros(3)) for grid in grids.values()
    ]
    return LocalFrames(
        dict(zip(grids, (grid for grid, _ in moved), strict=True)), [origin for _, origin in moved]
    )
