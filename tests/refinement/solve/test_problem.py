import jax

from voxjax.refinement.problems.pair import pose_problem

POINTS = 2048


def test_a_problem_is_a_pytree_of_arrays(pair):
    problem = pose_problem(*pair[:2], num_points=POINTS, both_ways=True)
    assert all(hasattr(leaf, "dtype") for leaf in jax.tree.leaves(problem))
