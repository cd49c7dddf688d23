"""Buildings of every kind, whose solids and corners are known."""

import pytest

from voxjax.synthetic import make_building, make_hotel


@pytest.fixture(scope="session", params=["straight", "skewed", "hotel"])
def building(request):
    if request.param == "hotel":
        return make_hotel(4)
    return make_building(11, skew=0.3 if request.param == "skewed" else 0.0, clutter=1.5)


@pytest.fixture(scope="session")
def storey():
    """One row of rooms, for what a robot sees of it."""
    return make_building(1, num_rows=1, width=9.0)


@pytest.fixture(scope="session")
def two_rows():
    """Two rows of rooms, for teams of robots."""
    return make_building(2, num_rows=2, width=9.0)
