"""The pairs of N maps that are held against each other, and the maps that keep their pose."""

import itertools
from collections.abc import Collection, Mapping, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ... import rigid
from ..._checks import InputError, shown
from ..._types import Array
from ...maps.prepared import PreparedMap, sample_rows
from ...ops.evidence.lookup import Block, lookup
from ...ops.evidence.nearest import NOTHING_NEAR
from ..residuals.terms import Term, check_terms
from ..solve.joint_equations import relative_pose

Pair = tuple[int, int]


def check_map(name: str, number: int, num_maps: int) -> int:
    """The number of a map.

    Raises:
        InputError: If there is no such map.
    """
    # Numbers may come as NumPy's or as whole floats, but must not count from the end, as -1 would.
    if number != int(number) or not 0 <= number < num_maps:
        raise InputError(f"{name} must be the number of a map, 0 to {num_maps - 1}, got {number!r}.")
    return int(number)


def checked_pairs(name: str, pairs: Collection[Pair], num_maps: int) -> list[Pair]:
    """Pairs of different maps, each once, in the order given.

    Raises:
        InputError: If one is no pair of maps, or is named twice.
    """
    checked = []
    for pair in pairs:
        if len(pair) != 2 or pair[0] == pair[1]:
            raise InputError(f"{name} must be two different maps each, got {tuple(pair)!r}.")
        checked.append((check_map(name, pair[0], num_maps), check_map(name, pair[1], num_maps)))
    # (a, b) and (b, a) are one pair: both together would count its surfaces twice.
    if len({frozenset(pair) for pair in checked}) < len(checked):
        raise InputError(f"{name} must name each pair of maps once, got {checked!r}.")
    return checked


def checked_terms(
    terms: Mapping[Pair, Sequence[Term]] | None, pairs: Sequence[Pair] | None, num_maps: int
) -> dict[Pair, tuple[Term, ...]]:
    """Terms of pairs of maps.

    Args:
        terms: Further residuals as the user gave them; None for none.
        pairs: Pairs that `checked_pairs` gave; None if they are not known yet.
        num_maps: How many maps there are.

    Raises:
        InputError: If terms are of no pair of maps, or of one that `pairs` has the other way round.
    """
    terms = {} if terms is None else terms
    if not isinstance(terms, Mapping):
        raise InputError(
            f"terms must be a mapping from pairs (a, b) to lists of terms, got {shown(terms)}; name the pairs."
        )
    pairs_named = checked_pairs("terms", terms, num_maps)
    named = {
        pair: check_terms(f"terms[{pair}]", those)
        for pair, those in zip(pairs_named, terms.values(), strict=True)
    }
    for a, b in named:
        if pairs is not None and (b, a) in pairs:
            raise InputError(
                f"terms must name pairs the way round that pairs does, got ({a}, {b}) for ({b}, {a}); give terms about "
                f"T_{b}_{a}, or name ({a}, {b}) in pairs."
            )
    return named


def with_named(pairs: Sequence[Pair], named: Collection[Pair]) -> list[Pair]:
    """Pairs and those that are named beside them; the way round that they are named."""
    # Terms are about `T_a_b`, so that the way round in which they were named decides.
    ways = {frozenset(pair): pair for pair in named}
    return [*(ways.pop(frozenset(pair), pair) for pair in pairs), *ways.values()]


def overlapping_pairs(maps: Sequence[PreparedMap | None], poses: Float[np.ndarray, "maps 4 4"]) -> list[Pair]:
    """Pairs (a, b), a < b, of maps that overlap under the poses, by the greater share of the two ways."""
    # Two maps overlap if so many of the voxels of one, by leverage, are within reach of the other's surfaces.
    min_share = 0.1
    filled = {number: prepared for number, prepared in enumerate(maps) if prepared is not None}
    points = {number: _points(prepared) for number, prepared in filled.items()}

    # Both ways count: a small map may lie wholly in a large one, of which it covers little.
    def share(a: int, b: int) -> float:
        T_a_b = relative_pose(jnp.asarray(poses[a]), jnp.asarray(poses[b]))
        return float(_share_in_reach(filled[a].keys, filled[a].block, T_a_b, points[b]))

    return [
        (a, b) for a, b in itertools.combinations(filled, 2) if max(share(a, b), share(b, a)) >= min_share
    ]


def connected_parts(num_maps: int, pairs: Sequence[Pair]) -> Int[np.ndarray, "maps"]:
    """For each map the lowest number of the maps that pairs connect it with, itself included."""
    a, b = np.asarray(pairs, np.int64).reshape(-1, 2).T
    graph = coo_array((np.ones(len(pairs), np.int8), (a, b)), shape=(num_maps, num_maps))
    part = connected_components(graph, directed=False)[1]
    # Labels of parts are arbitrary; the lowest number of a part does not depend on the order of pairs.
    _, lowest, number = np.unique(part, return_index=True, return_inverse=True)
    return lowest[number]


def held_maps(parts: Int[np.ndarray, "maps"], anchor: int) -> Bool[np.ndarray, "maps"]:
    """Which maps stay where they are: the first of each part, but of the anchor's part the anchor."""
    # The number of a part is that of its lowest map, which is thereby the one that equals its own entry.
    is_held = parts == np.arange(len(parts))
    is_held[parts == parts[anchor]] = False
    is_held[anchor] = True
    return is_held


@jax.jit
def _share_in_reach(keys: Array, block: Block, T_a_b: Array, points: Array) -> Array:
    """Share of points of b with a voxel of a in reach of the field."""
    near = lookup(keys, block, rigid.apply(T_a_b, points), NOTHING_NEAR) != NOTHING_NEAR
    return jnp.mean(near, dtype=jnp.float32)


def _points(prepared: PreparedMap) -> np.ndarray:
    # Voxels of each map that are looked up in another to see whether they overlap.
    overlap_points = 1024
    return np.asarray(prepared.points)[sample_rows(prepared, overlap_points)]
