"""Chunks of Zarr arrays as bytes, without the package zarr: compressed by zstd, alone in a file or many in a shard.

A shard is a file of chunks one behind the other and of an index, which says where each chunk lies (the codec
`sharding_indexed` of the specification). What is written here any reader of Zarr 3 takes; of what others write, arrays
of the same codecs are read here, and the rest is left to zarr, which takes some milliseconds a chunk.
"""

import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Shaped, UInt64

Place = tuple[int, int, int]

SIDE = 64
"""Sides of chunks [voxel]: twice of it takes 8 to 14 % more bytes, and half of it eight times as many chunks."""
SHARD = 256
"""Sides of shards [voxel]: a disk takes milliseconds for a file, as long as ten chunks; one process writes a shard."""
LEVEL = 5
"""Level of zstd: 3 takes two fifths of the time for 15 to 18 % more bytes, 9 twice the time for 10 to 13 % fewer."""

_ABSENT = np.uint64(2**64 - 1)


def encoded_chunk(values: Shaped[np.ndarray, "x y z"]) -> bytes:
    """The bytes of a chunk; one at the end of the box is filled up with 0."""
    from numcodecs import zstd  # pyright: ignore[reportAttributeAccessIssue]

    dtype = values.dtype.newbyteorder("<")
    if values.shape != (SIDE,) * 3:
        values = np.pad(values, [(0, SIDE - n) for n in values.shape])
    return zstd.compress(np.ascontiguousarray(values, dtype), LEVEL)


def write_shard(path: Path, chunks: Mapping[Place, bytes]) -> None:
    """Write a shard; the folders that it lies in are made. Without chunks none is written.

    Args:
        path: The file.
        chunks: What chunks hold, by their places in the shard; the others hold 0 alone.
    """
    if not chunks:
        return
    index = np.full((SHARD // SIDE,) * 3 + (2,), _ABSENT, "<u8")
    begin = 0
    for place in sorted(chunks):
        index[place] = begin, len(chunks[place])
        begin += len(chunks[place])
    path.parent.mkdir(parents=True, exist_ok=True)
    with open(path, "xb") as file:
        for place in sorted(chunks):
            file.write(chunks[place])
        file.write(index.tobytes() + _checksum(index.tobytes()))


class Layout(NamedTuple):
    """How an array is kept whose chunks are read here.

    Attributes:
        folder: The folder of the array.
        dtype: Kind of number, of the byte order of the files.
        chunk: Number of voxels of a chunk along x, y, z.
        many: Number of chunks of a shard along x, y, z; None where each chunk has a file of its own.
    """

    folder: Path
    dtype: np.dtype
    chunk: tuple[int, ...]
    many: Place | None

    def shard_of(self, place: Place) -> Place:
        """Numbers of the file that holds the chunk at a place."""
        if self.many is None:
            return place
        x, y, z = (p // n for p, n in zip(place, self.many, strict=True))
        return x, y, z

    def index(self, shard: Place) -> UInt64[np.ndarray, "a b c 2"] | None:
        """Where the chunks of a shard lie: begin and number of bytes, or `is_absent`; None if the file is damaged."""
        assert self.many is not None
        size = 16 * math.prod(self.many)
        with open(self.folder / self.key(shard), "rb") as file:
            file.seek(max(os.fstat(file.fileno()).st_size - size - 4, 0))
            content = file.read(size + 4)
        if len(content) < size + 4 or _checksum(content[:size]) != content[size:]:
            return None
        return np.frombuffer(content, "<u8", size // 8).reshape(*self.many, 2).astype(np.uint64)

    def read(self, place: Place, index: UInt64[np.ndarray, "a b c 2"] | None) -> np.ndarray:
        """The chunk at a place, whole.

        Args:
            place: Which chunk.
            index: That of its shard; None without shards, and for a damaged one.

        Raises:
            ValueError: If its bytes are damaged; as zstd has it, RuntimeError too.
        """
        from numcodecs import zstd  # pyright: ignore[reportAttributeAccessIssue]

        most = 2 * self.dtype.itemsize * math.prod(self.chunk) + 1024
        begin, count = 0, most + 1
        if self.many is not None:
            if index is None:
                raise ValueError("the index of the shard")
            begin, count = index[tuple(p % n for p, n in zip(place, self.many, strict=True))].tolist()
        with open(self.folder / self.key(self.shard_of(place)), "rb") as file:
            file.seek(begin)
            content = file.read(min(count, most + 1))
        # No chunk is longer than that, and what is longer may be of any length once it is unpacked.
        if len(content) > most or (self.many is not None and len(content) != count):
            raise ValueError("the number of bytes")
        return np.frombuffer(zstd.decompress(content), self.dtype).reshape(self.chunk)

    def key(self, shard: Place) -> str:
        """Name of a file of chunks in the folder of the array."""
        return "/".join(("c", *map(str, shard)))


def is_absent(index: UInt64[np.ndarray, "a b c 2"]) -> np.ndarray:
    """Which chunks a shard does not hold, bool (a, b, c)."""
    return (index == _ABSENT).all(axis=-1)


def layout_of(folder: Path, metadata: Mapping[str, Any]) -> Layout | None:
    """How an array is kept; None where that is one of the many other ways, which zarr reads.

    Args:
        folder: The folder of the array.
        metadata: What zarr knows of it, as its `to_dict` gives that.
    """
    keys, codecs = metadata["chunk_key_encoding"], metadata["codecs"]
    if keys != {"name": "default", "configuration": {"separator": "/"}} or metadata.get(
        "storage_transformers"
    ):
        return None
    outer = tuple(metadata["chunk_grid"]["configuration"]["chunk_shape"])
    dtype = np.dtype(metadata["data_type"]).newbyteorder("<")
    names = [codec["name"] for codec in codecs]
    if names != ["sharding_indexed"]:
        return Layout(folder, dtype, outer, None) if _is_plain(codecs, dtype) else None
    sharding = codecs[0]["configuration"]
    chunk = tuple(sharding["chunk_shape"])
    x, y, z = (n // side for n, side in zip(outer, chunk, strict=True))
    ends = [codec["name"] for codec in sharding["index_codecs"]] == ["bytes", "crc32c"]
    is_ours = sharding["index_location"] == "end" and _is_plain(sharding["codecs"], dtype) and ends
    if (
        not is_ours
        or sharding["index_codecs"][0].get("configuration") != {"endian": "little"}
        or x * y * z > 1 << 16
    ):
        return None
    return Layout(folder, dtype, chunk, (x, y, z))


def _is_plain(codecs: Any, dtype: np.dtype) -> bool:
    """Whether chunks are their numbers in the order of x, y, z, packed by zstd."""
    if [codec["name"] for codec in codecs] != ["bytes", "zstd"]:
        return False
    order = codecs[0].get("configuration", {}).get("endian", "little")
    return dtype.itemsize == 1 or order == "little"


def _checksum(content: bytes) -> bytes:
    """CRC-32C, as the end of an index has it."""
    import google_crc32c

    return google_crc32c.value(content).to_bytes(4, "little")
