"""Surfaces and fields of many maps in common tables, which all pairs of maps read: one copy of each map."""

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from ..._checks import InputError
from ..._runtime.buckets import wide_bucket_size
from ..._runtime.tables import as_table, pool_lengths
from ..._types import Array
from ...maps.prepared import PreparedMap
from ...ops.blocks.block_array import BLOCK_VOXELS
from ...ops.evidence.nearest import NOTHING_NEAR
from ..residuals.atlas import AtlasField, AtlasSurface
from ..residuals.fields import Field
from ..residuals.planes import NearestSurface
from .field_tables import field_length
from .parts import Target


def in_common_tables(targets: Sequence[Target], maps: Sequence[PreparedMap]) -> list[Target]:
    """Targets with their surfaces and fields in common tables of few lengths; differentiable in what is traced.

    Args:
        targets: What points of other maps meet in each map, for the same kinds of residuals.
        maps: The maps.

    Raises:
        InputError: If the maps are too large for one table.
    """
    place = _places(maps)
    surfaces = _surfaces([target.surface for target in targets], place)
    distances, opinions = (
        _fields([getattr(target, kind) for target in targets], place) for kind in ("distances", "opinions")
    )
    return [
        Target(surface, distance, opinion, target.has_free_space)
        for surface, distance, opinion, target in zip(surfaces, distances, opinions, targets, strict=True)
    ]


class _Places(NamedTuple):
    """Where the maps lie in common tables, and how long these are.

    Attributes:
        table: Rows of the common pools of the blocks of all maps, device array.
        first_blocks: Where the blocks of each map begin in it.
        sizes: Cells of each map in its pools.
        counts: Occupied voxels of each map.
        num_cells: Length of the common pools.
        num_rows: Length of the common lists of voxels.
    """

    table: Array
    first_blocks: list[int]
    sizes: list[int]
    counts: list[int]
    num_cells: int
    num_rows: int


def _places(maps: Sequence[PreparedMap]) -> _Places:
    """Where maps lie in common tables.

    Raises:
        InputError: If the maps are too large for one table.
    """
    # Tables are cut to what is in each map: padded ones would not fit together.
    rows, counts = [prepared.num_rows for prepared in maps], [prepared.num_points for prepared in maps]
    blocks = [prepared.num_blocks for prepared in maps]
    try:
        lengths = pool_lengths(sum(blocks), sum(rows), sum(counts))
    except InputError as error:
        raise InputError(f"grids do not fit one table together: {error}") from None
    parts = [
        np.asarray(prepared.table)[:count] + np.int32(first)
        for prepared, count, first in zip(maps, blocks, _firsts(rows), strict=True)
    ]
    sizes = [BLOCK_VOXELS * count for count in rows]
    return _Places(
        table=_table(parts, lengths[0]),
        first_blocks=_firsts(blocks),
        sizes=sizes,
        counts=counts,
        num_cells=BLOCK_VOXELS * lengths[1],
        num_rows=lengths[2],
    )


def _surfaces(surfaces: Sequence[NearestSurface], place: _Places) -> list[AtlasSurface]:
    """One after the other: keys of as many cells and lists of as many rows as each map has."""
    # Rows of the shortest lists of voxels that are weighed; lengths climb in wide steps.
    least_rows = 1 << 14
    sizes, counts, num_rows = place.sizes, place.counts, place.num_rows
    is_soft = any(surface.trust is not None for surface in surfaces)
    if is_soft:  # derivatives are as long
        num_rows = wide_bucket_size(sum(counts), least_rows)
    # It is added to a map's own numbers of its voxels: where they begin in the lists.
    first_rows = _firsts(counts)

    def keys(surface: NearestSurface, size: int, row: int) -> np.ndarray:
        own = np.asarray(surface.keys)[:size]
        # A key has its row in the low bits, and all rows together fit there, as checked above: adding moves it on.
        return np.where(own == NOTHING_NEAR, own, own + np.uint32(row))

    def rows(name: str) -> Array:
        parts = zip(surfaces, counts, strict=True)
        return _table([getattr(surface, name)[:count] for surface, count in parts], num_rows)

    def trust_of(surface: NearestSurface, count: int) -> Array:
        # In one table with soft maps, those without probabilities trust all their voxels.
        return np.ones(count, surface.points.dtype) if surface.trust is None else surface.trust[:count]

    all_keys = _table(
        [keys(*each) for each in zip(surfaces, sizes, first_rows, strict=True)], place.num_cells
    )
    anchors, normals, planarity = (rows(name) for name in ("points", "normals", "planarity"))
    trusts = [trust_of(*each) for each in zip(surfaces, counts, strict=True)] if is_soft else []
    trust = _table(trusts, num_rows) if is_soft else None
    return [
        AtlasSurface(
            keys=all_keys,
            dims=np.append(np.asarray(surface.dims), block).astype(np.int32),
            origin=surface.origin,
            voxel_size=surface.voxel_size,
            points=anchors,
            normals=normals,
            planarity=planarity,
            is_signed=surface.is_signed,
            trust=trust,
            table=place.table,
        )
        for surface, block in zip(surfaces, place.first_blocks, strict=True)
    ]


def _fields(fields: Sequence[Field | None], place: _Places) -> list[AtlasField] | list[None]:
    """One after the other, with rows of as many cells as each map has; None where there is none of a kind."""
    given = [field for field in fields if field is not None]
    if not given:
        return [None] * len(fields)
    counts = [len(field.values) for field in given]
    first_rows = _firsts(counts)
    parts = zip(given, place.sizes, first_rows, strict=True)
    # Rows move on by the values of the maps before; those of the outside do so as well, see below.
    all_rows = _table(
        [np.asarray(field.rows)[:size] + np.int32(row) for field, size, row in parts], place.num_cells
    )
    values = _table([field.values for field in given], field_length(sum(counts)))
    return [
        AtlasField(
            rows=all_rows,
            dims=np.append(np.asarray(field.dims), block).astype(np.int32),
            origin=field.origin,
            voxel_size=field.voxel_size,
            values=values,
            outside=np.asarray(field.outside + row, np.int32),
            table=place.table,
        )
        for field, block, row in zip(given, place.first_blocks, first_rows, strict=True)
    ]


def _firsts(lengths: Sequence[int]) -> list[int]:
    """Where each of several lists begins, one after the other."""
    return list(itertools.accumulate(lengths, initial=0))[:-1]


def _table(parts: Sequence[Array], length: int) -> Array:
    """Parts one after the other, followed by zeros up to a length; traced where a part is."""
    # Reserved memory takes values alone; what is traced is concatenated inside of its trace.
    if not any(isinstance(part, Tracer) for part in parts):
        return jax.device_put(as_table(np.concatenate([np.asarray(part) for part in parts]), length))
    whole = jnp.concatenate([jnp.asarray(part) for part in parts])
    return jnp.zeros((length, *whole.shape[1:]), whole.dtype).at[: len(whole)].set(whole)
