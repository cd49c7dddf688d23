"""Chunks of a map in a Zarr store, each read when it is needed, and the sentences of what is wrong with one."""

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
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
        self,
        path: Path,
        given: Path,
        name: str,
        shape: Shape,
        chunk: Shape,
        source: "ChunksOfZarr | PlainChunks",
    ) -> None:
        """Remember the store as it is now.

        Args:
            path: Its folder, absolute.
            given: Its name for messages.
            name: Name of the array.
            shape: Number of voxels along x, y, z.
            chunk: Number of voxels of a chunk.
            source: Gives a chunk, whole or cut to the box; raises whatever it likes where that is damaged.
        """
        self._path, self._given, self._name = path, given, name
        self._shape, self._chunk, self._source = shape, chunk, source
        self._identity = _identity(path)

    def __call__(self, place: Place) -> np.ndarray:
        """The chunk at a place, cut to the box.

        Raises:
            StoreError: If it is damaged, cannot be read or takes too much memory, or the store is not the one any more
                that was opened.
        """
        # Chunks that are gone would be taken for ones that hold nothing.
        if _identity(self._path) != self._identity:
            raise StoreError(f"{self._given} was replaced or removed after it was opened; read it again.")
        chunk = f"the chunk {place} of its array {self._name!r}"
        try:
            return self._checked(place, f"{self._given} cannot be read: {chunk}")
        except MemoryError as error:
            raise StoreError(
                f"{self._given} cannot be read: this process may not take the memory for {chunk}."
            ) from error

    def _checked(self, place: Place, what: str) -> np.ndarray:
        """The chunk at a place, cut to the box; `what` is the beginning of what is said of it."""
        try:
            with file_named(f"{self._name}/{self._source.key(place)}"):
                values = self._source(place)
        except MemoryError:
            raise
        except InputError as error:
            raise StoreError(f"{self._given} cannot be read: {error}.") from error
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

    def __init__(self, folder: Path, array: Any) -> None:
        """Take an array of zarr and the folder that it lies in."""
        self._folder, self._array = folder, array

    def key(self, place: Place) -> str:
        """Name of the file of the chunk at a place, in the folder of the array."""
        sides = zip(place, self._array.chunks, self._array.shards or self._array.chunks, strict=True)
        return self._array.metadata.encode_chunk_key(tuple(p * side // file for p, side, file in sides))

    def __call__(self, place: Place) -> np.ndarray:
        """The chunk at a place, cut to the box."""
        sides = zip(self._array.chunks, place, strict=True)
        values = np.asarray(self._array[tuple(slice(side * p, side * (p + 1)) for side, p in sides)])
        os.stat(self._folder / self.key(place))  # a file that is gone zarr takes for one of 0 alone
        return values


class PlainChunks:
    """Chunks in files that are read here; where the chunks of shards lie is read once."""

    def __init__(self, layout: Layout, files: Bool[np.ndarray, "a b c"]) -> None:
        """Read the index of each shard.

        Args:
            layout: How the array is kept.
            files: Which files of chunks it has.

        Raises:
            InputError: If the file of a shard cannot be read; the message is for a sentence that names the store.
        """
        self._layout = layout
        self._indices: dict[Place, UInt64[np.ndarray, "a b c 2"] | None] = {}
        if layout.many is not None:
            for x, y, z in np.argwhere(files).tolist():
                with file_named(f"{layout.folder.name}/{layout.key((x, y, z))}"):
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

    def key(self, place: Place) -> str:
        """Name of the file of the chunk at a place, in the folder of the array."""
        return self._layout.key(self._layout.shard_of(place))

    def __call__(self, place: Place) -> np.ndarray:
        """The chunk at a place, whole."""
        return self._layout.read(place, self._indices.get(self._layout.shard_of(place)))


@contextmanager
def file_named(name: str) -> Iterator[None]:
    """Let an error of the system within the block name a file or folder of the store.

    Raises:
        InputError: In its place; the message is for a sentence that names the store.
    """
    try:
        yield
    except OSError as error:
        if error.errno is None:  # a codec's own, such as that of gzip
            raise
        if error.errno == errno.ENOMEM:
            raise MemoryError(str(error)) from error
        raise InputError(f"{name}: {error.strerror or error}") from error


def _identity(path: Path) -> tuple[int, ...] | None:
    """What tells a store from another one of the same name; None where there is none."""
    try:
        status = os.stat(path / MARKER)
    except OSError:
        return None
    return status.st_dev, status.st_ino, status.st_mtime_ns
