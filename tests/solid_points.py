"""Which points lie in the solids of a building, for the tests of buildings."""


def is_solid(building, points):
    return (building.solids.distance(points) < 0).any(axis=1)
