"""Maps written as Zarr stores (version 3), shard by shard; see `zarr_reading` for what a store holds."""

from collections.abc import Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float32, Int, UInt8

from .._runtime.threads import spread
from .._runtime.whole_folders import Folder
from ..grid import VoxelGrid
from ..ops.blocks import kept
from ..ops.blocks.block_array import Shape
from .zarr_chunks import MARKER
from .zarr_reading import VERSION, check_zarr_support
from .zarr_shards import LEVEL, SHARD, SIDE, Place, encoded_chunk, write_shard

Window = tuple[Int[np.ndarray, "3"], UInt8[np.ndarray, "x y z"], Float32[np.ndarray, "x y z"] | None]
"""Lowest voxel, states and log-odds of a part of a shard."""


def encode_zarr(grid: VoxelGrid) -> Folder:
    """The store of a map, to be written by `whole_files.write_files`.

    Raises:
        InputError: If the package zarr is not installed.
    """
    check_zarr_support()
    return Folder(partial(_write_grid, grid), MARKER)


class MapStore(NamedTuple):
    """A store that is being written, shards in any order; what is not written is unknown.

    Several processes may write one, each shards of its own.

    Attributes:
        folder: Its folder.
        shape: Number of voxels along x, y, z.
    """

    folder: Path
    shape: Shape

    @classmethod
    def make(
        cls, folder: Path, shape: Shape, origin: Iterable[float], voxel_size: float, *, has_log_odds: bool
    ) -> "MapStore":
        """Make the store with nothing in it but what says what it is.

        Args:
            folder: Its name, which nothing has.
            shape: Number of voxels along x, y, z.
            origin: Outer corner of voxel (0, 0, 0) [m].
            voxel_size: Edge length of a voxel [m].
            has_log_odds: Whether it holds log-odds too.
        """
        import zarr.codecs
        import zarr.storage

        place = {"origin": [float(x) for x in origin], "voxel_size": float(voxel_size), "units": "m"}
        group = zarr.create_group(
            zarr.storage.LocalStore(folder), zarr_format=3, attributes={"voxjax_map": VERSION, **place}
        )
        for name, dtype in (("states", "uint8"), ("log_odds", "float32"))[: 1 + has_log_odds]:
            group.create_array(
                name,
                shape=shape,
                chunks=(SIDE,) * 3,
                shards=(SHARD,) * 3,
                dtype=dtype,
                fill_value=0,
                compressors=zarr.codecs.ZstdCodec(level=LEVEL),
                dimension_names=("x", "y", "z"),
                # The words of the climate and forecast conventions, which other readers know.
                attributes={"flag_values": [0, 1, 2], "flag_meanings": "unknown free occupied"}
                if name == "states"
                else {},
            )
        return cls(folder, shape)

    def shard_box(self, place: Int[np.ndarray, "3"]) -> tuple[np.ndarray, np.ndarray]:
        """Lowest voxel of a shard, and one past its highest, int64 (3,)."""
        low = np.asarray(place, np.int64) * SHARD
        return low, np.minimum(low + SHARD, self.shape)

    def write(self, place: Int[np.ndarray, "3"], windows: Iterable[Window]) -> None:
        """Write a shard, once: in memory are one window, and the bytes of the others.

        Args:
            place: Which shard.
            windows: Parts of it, of whole chunks but at the end of the box; None in place of log-odds leaves these.
        """
        found: list[tuple[np.ndarray, bytes | None, bytes | None]] = []
        for low, states, log_odds in windows:
            cubes = np.argwhere(np.ones([-(-n // SIDE) for n in states.shape], bool))
            parts = [tuple(slice(SIDE * n, SIDE * (n + 1)) for n in cube) for cube in cubes]
            bytes_of_states = spread(lambda part, states=states: _encoded(states[part]), parts)
            bytes_of_odds = [None] * len(parts)
            if log_odds is not None:
                bytes_of_odds = spread(lambda part, log_odds=log_odds: _encoded(log_odds[part]), parts)
            found += zip(low // SIDE + cubes, bytes_of_states, bytes_of_odds, strict=True)
        self.put(place, found)

    def put(
        self, place: Int[np.ndarray, "3"], chunks: Iterable[tuple[np.ndarray, bytes | None, bytes | None]]
    ) -> None:
        """Write a shard of chunks that are encoded already.

        Args:
            place: Which shard.
            chunks: The place of each in the store, the bytes of its states and those of its log-odds; None for 0 alone.
        """
        first = np.asarray(place) * (SHARD // SIDE)
        found: tuple[dict[Place, bytes], dict[Place, bytes]] = {}, {}
        for at, *contents in chunks:
            x, y, z = (at - first).tolist()
            for of_array, content in zip(found, contents, strict=True):
                if content is not None:
                    of_array[x, y, z] = content
        for name, of_array in zip(("states", "log_odds"), found, strict=True):
            write_shard(self.folder.joinpath(name, "c", *map(str, place)), of_array)


def _encoded(values: np.ndarray) -> bytes | None:
    """The bytes of a chunk; None if all of it is 0."""
    return encoded_chunk(values) if values.any() else None


def _write_grid(grid: VoxelGrid, folder: Path) -> None:
    """Make the store of a map."""
    store = MapStore.make(folder, grid.shape, grid.origin, grid.voxel_size, has_log_odds=grid.has_log_odds)
    # Methods of the map, each a module of equinox, would take as long to be called as the window.
    states, log_odds = grid._states, grid._log_odds

    def encode(cube: np.ndarray) -> tuple[np.ndarray, bytes | None, bytes | None]:
        low = cube * SIDE
        high = np.minimum(low + SIDE, store.shape)
        of_odds = None if log_odds is None else _encoded(kept.window(log_odds, low, high))
        return cube, _encoded(kept.window(states, low, high)), of_odds

    for place, cubes in _by_shard(grid.cubes(SIDE)):
        store.put(place, spread(encode, cubes))


def _by_shard(cubes: Int[np.ndarray, "m 3"]) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """The chunks of each shard together."""
    places, numbers = np.unique(cubes * SIDE // SHARD, axis=0, return_inverse=True)
    numbers = numbers.reshape(-1)
    ends = np.cumsum(np.bincount(numbers, minlength=len(places)))
    in_order = cubes[np.argsort(numbers, kind="stable")]
    return zip(places, np.split(in_order, ends[:-1]), strict=True) if len(places) else iter(())
