"""Chunks as bytes: what zarr takes, which layouts are read here, and what is damaged."""

import os

import numpy as np
import pytest
import zarr
import zarr.codecs
from zarr.codecs import ShardingCodec, ZstdCodec

from voxjax.io.zarr_shards import encoded_chunk, is_absent, layout_of, write_shard

SHAPE = (300, 70, 64)


def made(tmp_path, dtype="uint8", **options):
    """An array of zarr, empty, and its folder."""
    options = {"chunks": (64,) * 3, "shards": (256,) * 3, "compressors": ZstdCodec(level=1)} | options
    array = zarr.create_array(tmp_path / "a", shape=SHAPE, dtype=dtype, fill_value=0, **options)
    return array, tmp_path / "a"


def parts(dtype):
    """Two chunks, the second cut by the end of the box, by their places in the second shard."""
    rng = np.random.default_rng(0)
    return {
        (0, 0, 0): rng.integers(0, 3, (44, 64, 64)).astype(dtype),
        (0, 1, 0): rng.integers(0, 3, (44, 6, 64)).astype(dtype),
    }


@pytest.mark.parametrize("dtype", ["uint8", "float32"])
def test_zarr_reads_a_shard_that_was_written_here_and_so_do_we(tmp_path, dtype):
    array, folder = made(tmp_path, dtype)
    values = parts(dtype)
    write_shard(folder / "c" / "1" / "0" / "0", {place: encoded_chunk(v) for place, v in values.items()})
    np.testing.assert_array_equal(array[256:, :64], values[0, 0, 0])
    np.testing.assert_array_equal(array[256:, 64:], values[0, 1, 0])
    assert not np.any(array[:256])
    layout = layout_of(folder, array.metadata.to_dict())
    assert layout is not None
    index = layout.index((1, 0, 0))
    assert index is not None
    np.testing.assert_array_equal(np.argwhere(~is_absent(index)), sorted(values))
    whole = layout.read((4, 1, 0), index)
    np.testing.assert_array_equal(whole[:44, :6], values[0, 1, 0])
    assert not whole[44:].any()
    assert whole.dtype == np.dtype(dtype)


def test_without_chunks_there_is_no_shard(tmp_path):
    write_shard(tmp_path / "c" / "0", {})
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize(
    "options",
    [
        {"shards": None, "compressors": zarr.codecs.GzipCodec()},
        {"shards": None, "compressors": None},
        {"shards": None, "serializer": zarr.codecs.BytesCodec(endian="big")},
        {"shards": None, "chunk_key_encoding": {"name": "v2", "separator": "."}},
        {"shards": None, "filters": [zarr.codecs.TransposeCodec(order=(2, 1, 0))]},
        {"compressors": (ZstdCodec(), zarr.codecs.Crc32cCodec())},
    ],
    ids=["gzip", "not packed", "big endian", "other names", "transposed", "checksums"],
)
def test_other_layouts_are_left_to_zarr(tmp_path, options):
    array, folder = made(tmp_path, "float32", **options)
    assert layout_of(folder, array.metadata.to_dict()) is None


@pytest.mark.parametrize(
    "options", [{"index_location": "start"}, {"index_codecs": [zarr.codecs.BytesCodec()]}]
)
def test_other_indices_are_left_to_zarr(tmp_path, options):
    codec = ShardingCodec(chunk_shape=(64,) * 3, codecs=[zarr.codecs.BytesCodec(), ZstdCodec()], **options)
    array = zarr.create(shape=SHAPE, chunks=(256,) * 3, dtype="uint8", store=tmp_path / "a", codecs=[codec])
    assert layout_of(tmp_path / "a", array.metadata.to_dict()) is None


@pytest.mark.parametrize("damage", ["cut", "flipped index", "flipped chunk", "too long"])
def test_damage_is_found(tmp_path, damage):
    array, folder = made(tmp_path)
    layout = layout_of(folder, array.metadata.to_dict())
    assert layout is not None
    path = folder / "c" / "1" / "0" / "0"
    content = encoded_chunk(parts("uint8")[0, 0, 0])
    write_shard(path, {(0, 0, 0): b"x" * 10**6 if damage == "too long" else content})
    data = bytearray(path.read_bytes())
    if damage == "cut":
        del data[: len(data) - 1000]
    elif damage != "too long":
        data[-100 if damage == "flipped index" else 3] ^= 255
    path.write_bytes(bytes(data))
    index = layout.index((1, 0, 0))
    assert (index is None) == (damage in ("cut", "flipped index"))
    with pytest.raises((ValueError, RuntimeError)):
        layout.read((4, 0, 0), index)
