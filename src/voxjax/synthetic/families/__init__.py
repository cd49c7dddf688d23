"""Families of generated places: each file draws one kind, with the way that robots take through it.

A place is solids, some of which change from day to day, a sensor that suits it, and a path. Start at
`simulate_family`, which gives two maps of a place, or of two places of one family, and the true pose between them.
"""

from ._types import FamilyMaps as FamilyMaps
from .family import FAMILIES as FAMILIES
from .family import PLACES as PLACES
from .family import make_place as make_place
from .family import simulate_family as simulate_family
from .place import Place as Place
