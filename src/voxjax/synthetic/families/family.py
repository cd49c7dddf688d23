"""Two maps of a place of a family, by name."""

import zlib
from collections.abc import Callable

import numpy as np

from ... import rigid
from ..._checks import InputError
from ..team import Frame, draw_frame
from ._types import FamilyMaps
from .campus import make_campus
from .forest import make_forest
from .garage import make_garage
from .hall import make_hall
from .mine import make_mine
from .pairs import any_part, choose_parts
from .place import Place
from .room import make_room
from .stairwell import make_stairwell
from .storeys import make_storey
from .street import make_street
from .surveys import alike, part_of_many, single_scans, unlike
from .terrain import simulate_terrain
from .tunnel import make_tunnel
from .visitor import Survey, Visitor
from .warehouse import make_warehouse

PLACES: dict[str, Callable[[np.random.Generator, np.random.Generator], Place]] = {
    "storeys": make_storey,
    "warehouse": make_warehouse,
    "garage": make_garage,
    "tunnel": make_tunnel,
    "mine": make_mine,
    "stairwell": make_stairwell,
    "street": make_street,
    "forest": make_forest,
    "room": make_room,
    "hall": make_hall,
    "campus": make_campus,
}
"""What draws a place, by its kind."""

FAMILIES: tuple[str, ...] = (*PLACES, "terrain", "scans", "parts", "sensors")
"""Kinds of places, rolling terrain from the air, and three families that meet several kinds: single scans, small maps
within large ones, and maps of different sensors and voxel sizes."""

_MIXED: dict[str, tuple[tuple[str, ...], Callable[[np.random.Generator, Place], tuple[Survey, Survey]]]] = {
    "scans": (("street", "forest", "garage", "warehouse", "mine"), single_scans),
    "parts": (("street", "storeys", "tunnel", "mine", "forest"), part_of_many),
    "sensors": (("street", "storeys", "garage", "warehouse", "tunnel"), unlike),
}


def make_place(kind: str, seed: int, *, style: int | None = None) -> Place:
    """Draw a place.

    Args:
        kind: One of `PLACES`.
        seed: Same seed and style, same place.
        style: Places of one style share sizes and manner; None takes the seed.

    Raises:
        InputError: If there is no such kind.
    """
    if kind not in PLACES:
        raise InputError(f"kind must be one of {', '.join(PLACES)}, got {kind!r}.")
    styles = np.random.default_rng([_key(kind), seed if style is None else style, 0])
    return PLACES[kind](styles, np.random.default_rng([_key(kind), seed, 1]))


def simulate_family(
    family: str,
    seed: int,
    *,
    overlap: float = 0.4,
    changed: float = 0.0,
    elsewhere: bool = False,
    frame: Frame = "yaw",
    has_free_space: bool = True,
) -> FamilyMaps:
    """Let two robots map a place, each a part of its own, with its own noise, drift and frame.

    Args:
        family: One of `FAMILIES`.
        seed: Same seed and options, same maps.
        overlap: Share of the voxels of one map that lie on the other, about; where the place is too small for it, the
            nearest that can be had.
        changed: Share of the pieces that the second robot finds replaced by others; 1 for another storey of the plan.
        elsewhere: Whether the second robot is in another place, with half a chance one of the same style.
        frame: How the maps' frames lie: turned about the vertical, also tilted by up to 8 degrees, or anyhow.
        has_free_space: Whether maps know free space; without, they are made of the echoes alone.

    Raises:
        InputError: If there is no such family.
    """
    if family not in FAMILIES:
        raise InputError(f"family must be one of {', '.join(FAMILIES)}, got {family!r}.")
    rng = np.random.default_rng([_key(family), seed, 2])
    if family == "terrain":
        return simulate_terrain(
            rng,
            overlap=overlap,
            changed=changed,
            elsewhere=elsewhere,
            frame=frame,
            has_free_space=has_free_space,
        )
    kinds, draw = _MIXED.get(family, ((family,), alike))
    kind = kinds[int(rng.integers(len(kinds)))]
    place = make_place(kind, seed)
    # The other place has a seed that no place of a plain seed has.
    other = (
        make_place(kind, seed + (1 << 31), style=seed if rng.random() < 0.5 else None) if elsewhere else place
    )
    surveys = draw(rng, place)
    scenes = place.scene(rng), other.scene(rng, changed)
    visitors = tuple(
        Visitor([_key(family), seed, 3 + number], where, scene, survey)
        for number, (where, scene, survey) in enumerate(zip((place, other), scenes, surveys, strict=True))
    )
    return _map_parts(rng, visitors, surveys, frame, None if elsewhere else overlap, has_free_space)


def _map_parts(
    rng: np.random.Generator,
    visitors: tuple[Visitor, ...],
    surveys: tuple[Survey, Survey],
    frame: Frame,
    overlap: float | None,
    has_free_space: bool,
) -> FamilyMaps:
    """The maps of parts of both ways that overlap by so much, or of any parts of two places."""
    a, b = visitors
    if overlap is None:
        parts = any_part(rng, a), any_part(rng, b)
    else:
        parts = choose_parts(rng, a, b, overlap, 1.5 * max(survey.voxel_size for survey in surveys))
    T_world_a, T_world_b = (draw_frame(rng, frame) for _ in visitors)
    grids = (
        a.map(parts[0], T_world_a, has_free_space=has_free_space),
        b.map(parts[1], T_world_b, has_free_space=has_free_space),
    )
    return FamilyMaps(grids, None if overlap is None else rigid.inverse(T_world_a) @ T_world_b)


def _key(name: str) -> int:
    """A number for a name, so that families share no draws."""
    return zlib.crc32(name.encode())
