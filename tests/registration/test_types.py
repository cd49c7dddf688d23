"""What a registration says of itself."""

import equinox as eqx
import jax
import numpy as np
import pytest

from fake_register import pose, registration
from voxjax import RESULTS, Registration


@pytest.mark.parametrize(
    ("verdict", "is_accepted"), [("accepted", True), ("ambiguous", False), ("no_overlap", False)]
)
def test_only_an_accepted_pose_may_be_used(verdict, is_accepted):
    found = registration(np.eye(4), verdict=verdict, score=0.25)
    assert found.accepted == is_accepted
    assert found.best_score == 0.25


def test_without_a_hypothesis_the_score_is_below_everything():
    eye = np.eye(4, dtype=np.float32)
    none = Registration(
        eye, "no_overlap", 0.0, np.eye(6, dtype=np.float32), (), "Nothing.", RESULTS.no_overlap, {}
    )
    assert none.best_score == -np.inf


def test_it_prints_on_one_line():
    found = registration(pose(np.radians(-170.0), (1.0, -2.0, 0.25)), verdict="ambiguous", confidence=0.4)
    assert str(found) == (
        "Registration(ambiguous, confidence 0.400, translation [1.000, -2.000, 0.250] m, turned by 170.00 deg: "
        "The verdict is ambiguous.)"
    )


def test_it_prints_also_where_jax_traces_it():
    printed = []

    def traced(T):
        found = registration(np.eye(4))
        printed.append(repr(eqx.tree_at(lambda one: one.T_a_b, found, T)))
        return T

    jax.eval_shape(traced, np.eye(4, dtype=np.float32))
    assert printed[0].startswith("Registration(verdict='accepted', T_a_b=")
    assert len(printed[0]) < 200
