"""Chunks of a map in a Zarr store, each read when it is needed, and the sentences of what is wrong with one."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, UInt64

from .._checks import InputError
from .._types import OCCUPIED
from ..ops.blocks.block_array import Shape
from .zarr_shards import Layout, Place, is_absent

MARKER = "zarr.json"
"""Name of the file that each Zarr group of version 3 holds."""


class StoreError(InputError):
    """What is wrong with a chunk of a store, which may be read long after that was opened; the message names it."""


class StoreChunks:
    """Reads the chunks of an array of a store; other processes can be given it."""

    def __init__(
        self, path: Path, name: str, shape: Shape, chunk: Shape, source: Callable[[Place], np.ndarray]
    ) -> None:
        """Remember the store as it is now.

        Args:
            path: Its folder.
            name: Name of the array.
            shape: Number of voxels along x, y, z.
            chunk: Number of voxels of a chunk.
            source: Gives a chunk, whole or cut to the box; raises whatever it likes where that is damaged.
        """
        self._path, self._name, self._shape, self._chunk, self._source = path, name, shape, chunk, source
        self._identity = _identity(path)

    def __call__(self, place: Place) -> np.ndarray:
        """The chunk at a place, cut to the box.

        Raises:
            StoreError: If it is damaged, or the store is not the one any more that was opened.
        """
        # Chunks that are gone would be taken for ones that hold nothing.
        if _identity(self._path) != self._identity:
            raise StoreError(f"{self._path} was replaced or removed after it was opened; read it again.")
        what = f"{self._path} cannot be read: the chunk {place} of its array {self._name!r}"
        try:
            values = self._source(place)
        except MemoryError:
            raise
        except Exception as error:  # the codecs promise no set of exceptions for damaged bytes
            raise StoreError(f"{what} is damaged.") from error
        left = (n - side * p for n, side, p in zip(self._shape, self._chunk, place, strict=True))
        values = values[tuple(map(slice, left))]
        if values.dtype == np.uint8 and values.max(initial=0) > OCCUPIED:
            raise StoreError(f"{what} must hold 0 unknown, 1 free or 2 occupied, got {values.max()}.")
        if values.dtype != np.uint8 and not np.isfinite(values).all():
            raise StoreError(f"{what} must hold finite numbers, got NaN or infinite ones.")
        return values


class ChunksOfZarr:
    """Chunks as zarr reads them, whatever their codecs."""

    def __init__(self, array: Any) -> None:
        """Take an array of zarr."""
        self._array = array

    def __call__(self, place: Place) -> np.ndarray:
        """The chunk at a place, cut to the box."""
        sides = zip(self._array.chunks, place, strict=True)
        return np.asarray(self._array[tuple(slice(side * p, side * (p + 1)) for side, p in sides)])


class PlainChunks:
    """Chunks in files that are read here; where the chunks of shards lie is read once."""

    def __init__(self, layout: Layout, files: Bool[np.ndarray, "a b c"]) -> None:
        """Read the index of each shard.

        Args:
            layout: How the array is kept.
            files: Which files of chunks it has.
        """
        self._layout = layout
        self._indices: dict[Place, UInt64[np.ndarray, "a b c 2"] | None] = {}
        if layout.many is not None:
            for x, y, z in np.argwhere(files).tolist():
                self._indices[x, y, z] = layout.index((x, y, z))

    def leave_out_absent(self, known: Bool[np.ndarray, "x y z"]) -> None:
        """Note chunks that a shard does not hold; those of a damaged shard stay, so that reading them says so.

        Args:
            known: Which chunks there are, of whole shards.
        """
        for place, index in self._indices.items():
            if index is not None:
                sides = zip(place, index.shape[:3], strict=True)
                known[tuple(slice(n * p, n * (p + 1)) for p, n in sides)] &= ~is_absent(index)

    def __call__(self, place: Place) -> np.ndarray:
        """The chunk at a place, whole."""
        return self._layout.read(place, self._indices.get(self._layout.shard_of(place)))


def _identity(path: Path) -> tuple[int, ...] | None:
    """What tells a store from another one of the same name; None where there is none."""
    try:
        status = os.stat(path / MARKER)
    except OSError:
        return None
    return status.st_dev, status.st_ino, status.st_mtime_ns
