"""What was found of a pair of maps is kept while the pair is registered: several searches need the same rotations."""

from collections.abc import Callable, Hashable
from typing import Any, TypeVar
from weakref import WeakKeyDictionary

from .map_features import MapFeatures

Found = TypeVar("Found")

_KEPT: WeakKeyDictionary[MapFeatures, WeakKeyDictionary[MapFeatures, dict[Hashable, Any]]] = (
    WeakKeyDictionary()
)
"""What is kept of each map a and each map b. Features do not change, so that nothing of it ever gets old."""


def kept_of_pair(a: MapFeatures, b: MapFeatures, key: Hashable, find: Callable[[], Found]) -> Found:
    """What `find` gives, which is called only where nothing is kept under this key for these two maps.

    Args:
        a: First map.
        b: Second map.
        key: What is found, with all settings that it depends on.
        find: Finds it; it must not hold the maps in what it gives, which would keep them alive.
    """
    of_pair = _KEPT.setdefault(a, WeakKeyDictionary()).setdefault(b, {})
    if key not in of_pair:
        of_pair[key] = find()
    return of_pair[key]


def forget_pair(a: MapFeatures, b: MapFeatures) -> None:
    """Let go of what is kept of two maps and their coarser copies: of many maps, all pairs would take gigabytes.

    Args:
        a: First map.
        b: Second map.
    """
    for one in (a, *a.coarser.values()):
        of_one = _KEPT.get(one, WeakKeyDictionary())
        for other in (b, *b.coarser.values()):
            of_one.pop(other, None)
