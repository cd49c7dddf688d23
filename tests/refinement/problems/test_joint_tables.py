"""Pairs of maps in a joint problem read common tables."""

from typing import Any

import jax
import numpy as np

from refinement_problems import KINDS, LOOP
from voxjax.refinement.problems.joint import joint_problem

POINTS = 256


def test_pairs_read_one_table_of_each_kind(maps):
    problem = joint_problem(maps, LOOP, np.arange(3) == 0, residuals=KINDS["all"], num_points=POINTS)
    (group,) = problem.edges
    terms: Any = group.common.terms
    planes, distances, opinions = (terms[2 * k : 2 * k + 2] for k in range(3))
    tables = [term.surface.keys for term in planes] + [term.surface.points for term in planes]
    tables += [term.field.rows for term in (*distances, *opinions)]
    tables += [term.surface.table for term in planes] + [term.field.table for term in (*distances, *opinions)]
    tables += [term.field.values for term in (*distances, *opinions)]
    assert all(table is not None for table in tables)
    assert len({id(table) for table in tables}) == 7
    stacked = [leaf.size for leaf in jax.tree.leaves(group.own)]
    assert max(stacked) == 3 * 3 * POINTS
