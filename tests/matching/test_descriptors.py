import numpy as np
import pytest

from voxjax import InputError, VoxelGrid
from voxjax.matching.descriptors import describe_map, match_descriptors, working_spacing


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
        points = np.asarray(level.points)[np.asarray(level.mask)] + described.center
        centred = room.occupied_points() - np.asarray(described.center)
        assert len(points) == len(np.unique(np.floor(centred / level.spacing), axis=0))
        low, high = room.extent
        assert (points > low).all()
        assert (points < high).all()


def test_normals_point_into_free_space(room):
    level = describe_map(room).levels[0]
    points = np.asarray(level.points)[np.asarray(level.mask)] + np.asarray(describe_map(room).center)
    normals = np.asarray(level.normals)[np.asarray(level.mask)]
    ahead = np.asarray(room.states)[tuple(room.index_from_world(points + 0.2 * normals).T)]
    assert np.mean(ahead == 1) > 0.85
    assert np.mean(ahead == 0) < 0.1


def test_without_free_space_walls_face_the_room():
    grid = VoxelGrid(furnished_room(free=False), np.zeros(3, np.float32), 0.1)
    described = describe_map(grid)
    assert described.side == "surroundings"
    level = described.levels[0]
    points, normals = (np.asarray(x)[np.asarray(level.mask)] for x in (level.points, level.normals))
    is_wall = np.abs(points[:, 0]) > 2.3
    assert np.mean((points * normals)[is_wall, 0] < 0.0) > 0.9


def test_a_map_matches_itself_row_by_row(room):
    level = describe_map(room).levels[1]
    matches, square = match_descriptors(level, level)
    assert np.mean(matches[:, 0] == matches[:, 1]) > 0.98  # but for points with equal surroundings
    assert len(matches) > 0.9 * np.count_nonzero(np.asarray(level.mask))
    assert square.max() < 1e-4


def test_padding_compiles_nothing_for_a_map_of_like_size(room):
    from voxjax.ops.descriptor import point_feature_histograms

    describe_map(room)
    before = point_feature_histograms._cache_size()  # pyright: ignore[reportAttributeAccessIssue]
    describe_map(VoxelGrid(furnished_room()[::-1].copy(), np.zeros(3, np.float32), 0.1))
    assert point_feature_histograms._cache_size() == before  # pyright: ignore[reportAttributeAccessIssue]


def test_truncated_neighbour_lists_are_counted():
    states = np.full((20, 20, 20), 2, np.uint8)
    full = describe_map(VoxelGrid(states, np.zeros(3, np.float32), 0.1), spacing=0.1)
    # 128 neighbours fill a ball of 3.1 voxels; the limit is 5, so only corners and edges have fewer
    assert 4000 < full.levels[0].num_truncated < 8000
    sheet = np.zeros((20, 20, 4), np.uint8)
    sheet[..., 1] = 2
    assert (
        describe_map(VoxelGrid(sheet, np.zeros(3, np.float32), 0.1), spacing=0.1).levels[0].num_truncated == 0
    )


def test_empty_and_tiny_maps_are_described_without_fault():
    states = np.zeros((5, 5, 5), np.uint8)
    empty = describe_map(VoxelGrid(states, np.zeros(3, np.float32), 0.1))
    assert not any(np.asarray(level.mask).any() for level in empty.levels)
    states[2, 2, 2] = 2
    one = describe_map(VoxelGrid(states, np.zeros(3, np.float32), 0.1))
    assert [np.count_nonzero(np.asarray(level.mask)) for level in one.levels] == [1, 1]
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
