"""Structures of results as plain data: what is written comes back, and nothing else is believed."""

import json
import sys
from collections import namedtuple

import jax
import numpy as np
import pytest

from voxjax._runtime.result_trees import plain_structure, structure_of
from voxjax.refinement.residuals.terms import Level

LEVEL = Level(np.ones(()), np.zeros((), np.int32))
Foreign = namedtuple("Foreign", "value")


@pytest.mark.parametrize(
    "tree", [1, (1, None, [2, 3]), {"b": (1,), "a": []}, LEVEL, [LEVEL, {"x": (LEVEL, 3)}, None]]
)
def test_what_is_written_comes_back(tree):
    structure = jax.tree.structure(tree)
    plain = json.loads(json.dumps(plain_structure(structure)))
    assert structure_of(plain) == structure


@pytest.mark.parametrize("tree", [Foreign(1), {1: 2}, (1, Foreign(2))])
def test_other_types_cannot_be_written(tree):
    with pytest.raises(ValueError, match="cannot be written down"):
        plain_structure(jax.tree.structure(tree))


@pytest.mark.parametrize(
    "plain",
    [
        "else",
        7,
        [],
        ["set", "array"],
        ["named", "os", "system", "array"],
        ["named", "voxjax", "register", "array"],
        ["named", "voxjax.grid", "VoxelGrid", "array"],
        ["named", "voxjax.synthetic.nothing", "Level", "array"],
        ["named", "voxjax.refinement.residuals.terms", "Level", "array"],
        ["tuple", {"a": 1}],
    ],
)
def test_anything_else_is_refused_and_imports_nothing(plain):
    before = set(sys.modules)
    with pytest.raises(ValueError, match="structure of results"):
        structure_of(plain)
    assert set(sys.modules) == before
