import jax
import numpy as np
import pytest

from block_maps import far_apart, peak_of, turned_map, ways
from compilations import assert_compiles_nothing
from device_path import device_path
from voxjax import InputError, VoxelGrid
from voxjax.matching.descriptors import describe_map, finest_level, match_descriptors, working_spacing
from voxjax.ops.descriptors import fpfh as descriptor
from voxjax.ops.descriptors import match as descriptor_match


def furnished_room(free=True, seed=0):
    """A room of 5.2 x 4 x 2.8 m with boxes, as states at 0.1 m."""
    rng = np.random.default_rng(seed)
    states = np.full((56, 44, 32), 0, np.uint8)
    states[2:-2, 2:-2, 2:-2] = 2
    states[3:-3, 3:-3, 3:-3] = 1
    for _ in range(7):
        size = rng.integers(4, 12, 3)
        low = [int(rng.integers(3, n - 3 - s)) for n, s in zip(states.shape, size, strict=True)]
        low[2] = 3
        box = tuple(slice(a, a + s) for a, s in zip(low, size, strict=True))
        states[box] = 2
        states[tuple(slice(s.start + 1, s.stop - 1) for s in box)] = 0
    if not free:
        states[states == 1] = 0
    return states


@pytest.fixture(scope="module")
def room():
    return VoxelGrid(furnished_room(), np.asarray([3, -2, 1], np.float32), 0.1)


def test_points_are_means_of_occupied_voxels_on_the_working_lattice(room):
    described = describe_map(room)
    for level, scale in zip(described.levels, (1.0, 1.6), strict=True):
        assert level.spacing == pytest.approx(0.25 * scale)
        points = np.asarray(level.points) + described.center
        centred = room.occupied_points() - np.asarray(described.center)
        assert len(points) == len(np.unique(np.floor(centred / level.spacing), axis=0))
        low, high = room.extent
        assert (points > low).all()
        assert (points < high).all()


def test_maps_of_many_points_are_described_at_one_coarser_level(room):
    points = [len(level.points) for level in describe_map(room).levels]
    # The last number that a level may have, and one that it just exceeds.
    for max_points, level in ((points[0], 0), (points[0] - 1, 1), (points[1], 1), (points[1] - 1, 2)):
        assert finest_level(room, spacing=0.25, max_points=max_points) == level
    for first in (1, 2, 3):
        (level,) = describe_map(room, finest=first).levels
        assert level.spacing == pytest.approx(0.25 * 1.6**first)
        # Cells lie about the mean of the points, which is where the map's own number of them comes from too.
        assert finest_level(room, spacing=0.25, max_points=len(level.points)) == first
    np.testing.assert_array_equal(
        describe_map(room, finest=1).levels[0].descriptors, describe_map(room).levels[1].descriptors
    )


def test_normals_point_into_free_space(room):
    level = describe_map(room).levels[0]
    points = np.asarray(level.points) + np.asarray(describe_map(room).center)
    normals = np.asarray(level.normals)
    ahead = np.asarray(room.states)[tuple(room.index_from_world(points + 0.2 * normals).T)]
    assert np.mean(ahead == 1) > 0.85
    assert np.mean(ahead == 0) < 0.1


def test_without_free_space_walls_face_the_room():
    grid = VoxelGrid(furnished_room(free=False), np.zeros(3, np.float32), 0.1)
    described = describe_map(grid)
    assert described.side == "surroundings"
    level = described.levels[0]
    points, normals = np.asarray(level.points), np.asarray(level.normals)
    is_wall = np.abs(points[:, 0]) > 2.3
    assert np.mean((points * normals)[is_wall, 0] < 0.0) > 0.9


def test_a_map_matches_itself_row_by_row(room):
    level = describe_map(room).levels[1]
    matches, square = match_descriptors(level, level)
    assert np.mean(matches[:, 0] == matches[:, 1]) > 0.98  # but for points with equal surroundings
    assert len(matches) > 0.9 * len(level.points)
    assert square.max() < 1e-4


KERNELS = (
    descriptor.is_within,
    descriptor.monomials,
    descriptor.closeness,
    descriptor.pair_bins,
    descriptor.count_bins,
    descriptor._fit,
    descriptor_match._squares,
)


def test_maps_of_ten_sizes_compile_each_kernel_once():
    room = furnished_room()
    first = describe_map(VoxelGrid(room, np.zeros(3, np.float32), 0.1))
    match_descriptors(first.levels[0], first.levels[0])
    with assert_compiles_nothing(*KERNELS):
        for k in range(10):
            grid = VoxelGrid(room[: 55 - 4 * k, : 30 + k, 3 * k // 2 :].copy(), np.zeros(3, np.float32), 0.1)
            described = describe_map(grid, spacing=0.12)
            level = described.levels[0]
            assert len(match_descriptors(level, level)[0]) > 0.5 * len(level.points)


def test_accelerators_describe_and_match_alike(room):
    on_host = describe_map(room).levels[1]
    matches, _ = match_descriptors(on_host, on_host)
    with device_path():
        level = describe_map(room).levels[1]
        again, _ = match_descriptors(level, level)
    np.testing.assert_array_equal(level.points, on_host.points)
    np.testing.assert_allclose(level.normals, on_host.normals, atol=1e-3)
    # rounding moves pairs on a border of two bins, here and there
    assert np.mean(np.abs(np.asarray(level.descriptors) - on_host.descriptors) < 1e-3) > 0.99
    assert np.mean(again[:, 0] == again[:, 1]) > 0.98
    assert len(again) == pytest.approx(len(matches), rel=0.02)


def test_all_neighbours_count_in_solid_blocks():
    states = np.full((14, 14, 14), 2, np.uint8)
    level = describe_map(VoxelGrid(states, np.zeros(3, np.float32), 0.1), spacing=0.1).levels[0]
    assert len(level.points) == 14**3
    sums = (np.asarray(level.descriptors) ** 2).reshape(14**3, 3, -1).sum(axis=2)
    np.testing.assert_allclose(sums, 1.0, atol=1e-4)


def test_empty_and_tiny_maps_are_described_without_fault():
    states = np.zeros((5, 5, 5), np.uint8)
    empty = describe_map(VoxelGrid(states, np.zeros(3, np.float32), 0.1))
    assert not any(len(level.points) for level in empty.levels)
    states[2, 2, 2] = 2
    one = describe_map(VoxelGrid(states, np.zeros(3, np.float32), 0.1))
    assert [len(level.points) for level in one.levels] == [1, 1]
    assert match_descriptors(empty.levels[0], one.levels[0])[0].shape == (0, 2)


def test_spacing_follows_the_coarsest_map_and_ends_at_thirty_centimetres():
    assert working_spacing(0.04) == pytest.approx(0.1)
    assert working_spacing(0.05, 0.1) == pytest.approx(0.25)
    assert working_spacing(0.2) == pytest.approx(0.3)
    assert working_spacing(0.5) == pytest.approx(0.5)


def test_unusable_requests_are_refused_in_a_sentence(room):
    bare = VoxelGrid(furnished_room(free=False), np.zeros(3, np.float32), 0.1)
    with pytest.raises(InputError, match="use_free_space must be False"):
        describe_map(bare, use_free_space=True)
    with pytest.raises(InputError, match="spacing must be a finite number above 0"):
        describe_map(room, spacing=-1.0)
    with pytest.raises(InputError, match="same spacing"):
        match_descriptors(describe_map(room).levels[0], describe_map(room).levels[1])


@pytest.mark.parametrize("use_free_space", [True, False])
def test_descriptors_are_the_same_in_blocks_and_in_tiles(use_free_space, monkeypatch):
    first, *others = (
        describe_map(each, use_free_space=use_free_space) for each in ways(turned_map(), monkeypatch)
    )
    assert len(first.levels) == 2
    for other in others:
        assert other.side == first.side
        for one, two in zip(jax.tree.leaves(first), jax.tree.leaves(other), strict=True):
            np.testing.assert_array_equal(one, two)


@pytest.mark.parametrize("use_free_space", [True, False])
def test_two_maps_far_apart_are_described_in_memory_for_these_and_not_for_the_box(use_free_space):
    room = turned_map()
    grid = far_apart(room)
    found, peak = peak_of(lambda: describe_map(grid, use_free_space=use_free_space))
    alone = describe_map(room, use_free_space=use_free_space)
    # Cells of the working lattice begin elsewhere in either, so that they are only about as many.
    for level, other in zip(found.levels, alone.levels, strict=True):
        assert len(level.points) == pytest.approx(2 * len(other.points), rel=0.05)
        assert np.ptp(np.asarray(level.points), axis=0)[0] > 300.0
    assert peak < 60e6 < grid.num_voxels / 50
