"""Maps written as Zarr stores (version 3), chunk by chunk; see `zarr_reading` for what a store holds."""

from collections.abc import Iterable
from functools import partial
from pathlib import Path

import numpy as np
from jaxtyping import Float32, Int, UInt8

from .._runtime.threads import num_cores, spread
from .._runtime.whole_folders import Folder
from ..grid import VoxelGrid
from ..ops.blocks.block_array import Shape
from .zarr_reading import MARKER, VERSION, check_zarr_support

CHUNK = 64
"""Sides of chunks [voxel]: half of it takes four to ten times as long, and twice of it 8 to 14 % more bytes."""


def encode_zarr(grid: VoxelGrid) -> Folder:
    """The store of a map, to be written by `whole_files.write_files`.

    Raises:
        InputError: If the package zarr is not installed.
    """
    check_zarr_support()
    return Folder(partial(_write_grid, grid), MARKER)


class MapStore:
    """A store that is being written, in any order; what is not written is unknown.

    Attributes:
        shape: Number of voxels along x, y, z.
    """

    def __init__(
        self, folder: Path, shape: Shape, origin: Iterable[float], voxel_size: float, *, has_log_odds: bool
    ) -> None:
        """Make the store.

        Args:
            folder: Its name, which nothing has.
            shape: Number of voxels along x, y, z.
            origin: Outer corner of voxel (0, 0, 0) [m].
            voxel_size: Edge length of a voxel [m].
            has_log_odds: Whether it holds log-odds too.
        """
        import zarr.codecs
        import zarr.storage

        self.shape = shape
        place = {"origin": [float(x) for x in origin], "voxel_size": float(voxel_size), "units": "m"}
        group = zarr.create_group(
            zarr.storage.LocalStore(folder), zarr_format=3, attributes={"voxjax_map": VERSION, **place}
        )
        self._arrays = {}
        for name, dtype in (("states", "uint8"), ("log_odds", "float32"))[: 1 + has_log_odds]:
            self._arrays[name] = group.create_array(
                name,
                shape=shape,
                chunks=(CHUNK,) * 3,
                dtype=dtype,
                fill_value=0,
                compressors=zarr.codecs.ZstdCodec(level=9),
                dimension_names=("x", "y", "z"),
                # The words of the climate and forecast conventions, which other readers know.
                attributes={"flag_values": [0, 1, 2], "flag_meanings": "unknown free occupied"}
                if name == "states"
                else {},
                config={"write_empty_chunks": False},
            )

    def write(
        self,
        low: Int[np.ndarray, "3"],
        states: UInt8[np.ndarray, "x y z"] | None,
        log_odds: Float32[np.ndarray, "x y z"] | None = None,
    ) -> None:
        """Write a window of whole chunks, but for those at the end of the box.

        Args:
            low: Its lowest voxel, at the border of a chunk.
            states: Its states; None to leave these.
            log_odds: Its log-odds, likewise.
        """
        for name, values in (("states", states), ("log_odds", log_odds)):
            if values is not None and values.any():
                window = tuple(slice(a, a + n) for a, n in zip(low.tolist(), values.shape, strict=True))
                self._arrays[name][window] = values


def _write_grid(grid: VoxelGrid, folder: Path) -> None:
    """Make the store of a map."""
    store = MapStore(folder, grid.shape, grid.origin, grid.voxel_size, has_log_odds=grid.has_log_odds)

    def write(cube: np.ndarray) -> None:
        low = cube * CHUNK
        high = np.minimum(low + CHUNK, grid.shape)
        store.write(low, grid.states_in(low, high), grid.log_odds_in(low, high))

    cubes, step = grid.cubes(CHUNK), 4 * num_cores()
    for start in range(0, len(cubes), step):
        spread(write, cubes[start : start + step])
