"""How often registration compiles its kernels: maps of ten sizes share them."""

import collections

import jax

import voxjax as vx
from compilations import compilations
from small_worlds import draw_map, pose


def maps_of_ten_sizes():
    """Pairs of a building, each of another extent and voxel size, one seen in part, one cut to a room."""
    for k in range(10):
        voxel_size = 0.1 + 0.015 * k
        T = pose(yaw=7.0 * k, tilt=2.0 * k, translation=(1.0 - k, 0.3 * k, 0.2))
        seen = ((-1.0, -1.0, -1.0), (10.0 - 0.2 * k, 9.0 - 0.2 * k, 3.6))
        yield draw_map(voxel_size=voxel_size), draw_map(T, voxel_size=voxel_size, seen=seen)


def test_pairs_of_ten_sizes_compile_each_kernel_at_most_three_times():
    jax.clear_caches()  # what earlier tests compiled would not be counted
    pairs = list(maps_of_ten_sizes())
    assert len({grid.states.shape for pair in pairs for grid in pair}) >= 18
    assert len({grid.num_occupied for pair in pairs for grid in pair}) >= 18
    accepted, kernels, news = 0, collections.Counter(), []
    for a, b in pairs:
        with compilations() as found:
            accepted += vx.register(a, b, config={"source": {"thorough": True}}).accepted
        kernels += found
        news.append(found.total())
    assert accepted >= 5
    assert {"solve_pose", "_surface_piece", "_code_piece", "_align_piece", "agreement_matrix"} <= set(kernels)
    too_often = {name: count for name, count in kernels.items() if count > 3 and name not in PRIMITIVES}
    assert not too_often, kernels
    assert news[0] > 10
    assert max(news[1:]) <= 5, f"a pair of another size compiled much: {news}"


PRIMITIVES = {"convert_element_type", "stage"}
"""What JAX runs by itself, compiled once for each kind of a scalar or constant, whatever the maps."""
