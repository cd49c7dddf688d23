"""A stand-in for `register` that answers from a table of true poses, to test what is built on it."""

from types import SimpleNamespace

import numpy as np

from oracles.motions import turned
from voxjax import RESULTS, Registration, VoxelGrid
from voxjax.registration.types import Evidence, Hypothesis, Verdict


def registration(T_a_b, *, verdict: Verdict = "accepted", confidence=0.9, score=0.5):
    """A registration with that pose and verdict."""
    pose = np.asarray(T_a_b, np.float32)
    evidence = Evidence(
        score=score, occupied_agreement=0.8, free_conflict=0.01, num_hits=100, num_conflicts=1
    )
    outcome = {
        "accepted": RESULTS.successful,
        "ambiguous": RESULTS.ambiguous,
        "no_overlap": RESULTS.no_overlap,
    }
    return Registration(
        T_a_b=pose,
        verdict=verdict,
        confidence=confidence,
        covariance=np.eye(6, dtype=np.float32),
        hypotheses=(Hypothesis(T_a_b=pose, score=score, source="corner", evidence=evidence),),
        reason=f"The verdict is {verdict}.",
        result=outcome[verdict],
        stats={
            "num_corners_a": 5,
            "num_corners_b": 6,
            "num_associations": 30,
            "clique_size": 4,
            "num_hypotheses": 12,
            "seconds": {"features": 0.5},
        },
    )


def cube_map(number, *, size=6):
    """A small map that is unlike those with other numbers."""
    states = np.ones((size, size, size), np.uint8)
    states[number % size, :, 0] = 2
    states[0, number % size, 1 : 2 + number % 3] = 2
    return VoxelGrid(states, np.zeros(3, np.float32), 0.5)


def pose(angle, translation):
    """A pose: a turn about z [rad] and a translation."""
    return turned("z", angle, translation)


def fake_features(grid, *, voxel_size, config):
    """Features that know their map alone."""
    middle = np.mean(grid.extent, axis=0)
    return SimpleNamespace(grid=grid, origin=middle, searched=SimpleNamespace(late=None))


WORLD = [pose(0.3 * n, (2.0 * n, -n, 0.5 * n)) for n in range(5)]
"""True poses of five maps."""


def relative(a, b):
    """The true pose of map b in the frame of map a."""
    return np.linalg.inv(WORLD[a]) @ WORLD[b]


def assert_is(found, expected):
    """A pose was found, and it is the expected one."""
    assert found is not None
    np.testing.assert_allclose(found, expected, atol=1e-5)


class FakeRegister:
    """Answers with the true relative pose of two of the known maps, and a verdict from a table.

    Attributes:
        calls: The options of each call.
    """

    def __init__(self, grids, world_poses, *, verdicts=None, confidences=None):
        self.grids, self.world_poses = list(grids), world_poses
        self.verdicts, self.confidences = verdicts or {}, confidences or {}
        self.calls = []

    def number(self, grid):
        grid = getattr(grid, "grid", grid)
        return next(n for n, known in enumerate(self.grids) if known == grid)

    def __call__(self, a, b, **options):
        first, second = self.number(a), self.number(b)
        self.calls.append(options)
        if options.get("on_stage") is not None:
            options["on_stage"]("hypotheses")
        T = np.linalg.inv(self.world_poses[first]) @ self.world_poses[second]
        return registration(
            T,
            verdict=self.verdicts.get((first, second), "accepted"),
            confidence=self.confidences.get((first, second), 0.9),
        )

    def install(self, monkeypatch):
        """Take the place of the registration that `merge` calls, and of the features before it."""
        from voxjax.pipeline import many

        monkeypatch.setattr(many, "register", self)
        monkeypatch.setattr(many, "register_features", self)
        monkeypatch.setattr(many, "features_at", fake_features)
        return self
