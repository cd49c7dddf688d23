import numpy as np
import pytest

from voxjax import InputError, VoxelGrid
from voxjax.io.crop import cells_within, check_crop, crop_grid

BOX = ((0.0, 0.0, 0.0), (1.0, 2.0, 3.0))


def test_a_crop_is_two_corners():
    low, high = check_crop(BOX)
    assert low.dtype == high.dtype == np.float64
    assert high.tolist() == [1.0, 2.0, 3.0]
    check_crop((np.full(3, -np.inf), np.full(3, np.inf)))


@pytest.mark.parametrize(
    "crop",
    [
        None,
        3.0,
        "box",
        (0, 0, 0, 1, 1, 1),
        BOX[::-1],
        (BOX[0], (1.0, 2.0, 0.0)),
        (BOX[0], (1.0, np.nan, 1.0)),
    ],
)
def test_what_is_no_box_is_refused(crop):
    with pytest.raises(InputError, match="crop must be a low and a high corner"):
        check_crop(crop)


def test_voxels_belong_to_the_box_that_holds_their_centres():
    low, high = np.full(3, 0.25), np.full(3, 0.75)
    for size, origin, expected in (
        (
            0.1,
            0.0,
            (2, 7),
        ),  # centres 0.25 to 0.65: the one on the low face is in, that on the high face is not
        (0.1, 0.02, (2, 7)),
        (0.1, -0.02, (3, 8)),
        (0.5, 0.0, (0, 1)),
        (2.0, 0.0, (0, 0)),
    ):
        first, end = cells_within((low, high), np.full(3, origin), size, (50, 50, 50))
        assert (first[0], end[0]) == expected
    first, end = cells_within(
        (np.full(3, -np.inf), np.array([0.3, np.inf, -9.0])), np.zeros(3), 0.1, (5, 6, 7)
    )
    assert first.tolist() == [0, 0, 0]
    assert end.tolist() == [3, 6, 0]


@pytest.mark.parametrize("seed", range(5))
def test_a_cropped_map_holds_the_known_voxels_whose_centres_lie_inside(seed):
    rng = np.random.default_rng(seed)
    states = rng.choice(3, (7, 8, 9), p=[0.9, 0.05, 0.05]).astype(np.uint8)
    odds = np.where(states == 0, 0, states - 1.25).astype(np.float32)
    grid = VoxelGrid(states, np.array([-0.2, 0.1, 0.4]), 0.1, odds)
    low, high = np.array([-0.01, 0.2, -np.inf]), np.array([0.41, 0.61, 1.0])
    cut = crop_grid(grid, (low, high))
    centres = grid.world_from_index(np.argwhere(states == 2))
    inside = centres[((centres >= low) & (centres < high)).all(axis=1)]
    np.testing.assert_allclose(cut.occupied_points(), inside, atol=1e-6)
    assert cut.crop_to_known() == cut
    assert cut.log_odds is not None
    assert set(np.unique(cut.log_odds)) <= {-0.25, 0.0, 0.75}


def test_a_box_beside_the_map_is_refused():
    grid = VoxelGrid(np.full((2, 2, 2), 2, np.uint8), np.zeros(3), 0.5)
    with pytest.raises(
        InputError, match=r"nothing in the crop from \(2, 0, 0\) to .* it spans \(0, 0, 0\) to"
    ):
        crop_grid(grid, ((2, 0, 0), (3, 1, 1)))
