import pytest

from oracles import octree as oracle
from voxjax import InputError
from voxjax.io.budget import Budget
from voxjax.io.fit import check_fit, dense_bytes
from voxjax.io.octomap import decode_bt
from voxjax.io.octomap_leaves import leaves_of_bt
from voxjax.io.paint import canvas_for

GROUND = {(33000 + 8 * i, 33000 + 8 * j, 33000, 16): 2 for i in range(40) for j in range(40)}
SITE = oracle.file_of(GROUND | {(33000, 33000, 33400, 16): 1})
STRAY = oracle.file_of(GROUND | {(33000, 33000, 65000, 16): 2})


@pytest.fixture(autouse=True)
def _little_memory(monkeypatch):
    monkeypatch.setenv("VOXJAX_MEMORY", "0.02")


def test_a_map_that_spans_too_much_says_at_which_voxel_size_it_fits():
    with pytest.raises(InputError) as caught:
        decode_bt(SITE)
    told = str(caught.value)
    assert (
        "the map of 313 x 313 x 401 voxels of 0.1 m (1,600 occupied in the file) needs about 0.0393 GB"
        in told
    )
    assert "VOXJAX_MEMORY allows 0.02 GB" in told
    assert "take voxel_size=0.2 (--voxel-size 0.2), at which it fits" in told
    assert "crop= (--crop)" in told
    assert "isolated" not in told
    assert decode_bt(SITE, voxel_size=0.2).shape == (157, 157, 201)


def test_isolated_pieces_are_named_where_they_make_the_map_large():
    with pytest.raises(
        InputError, match=r"leave out its isolated pieces \(1 voxel up to 3200 m .*box is 313 x 313 x 1,"
    ):
        decode_bt(STRAY)
    assert decode_bt(STRAY, drop_isolated=True).shape == (313, 313, 1)


def test_the_voxel_size_that_is_told_is_the_smallest_whole_multiple_that_fits():
    leaves = leaves_of_bt(STRAY)
    for voxel_size in (0.1, 0.25):
        with pytest.raises(InputError) as caught:
            check_fit(leaves, Budget(len(STRAY)), voxel_size)
        fits = float(str(caught.value).split("voxel_size=")[1].split()[0])
        check_fit(leaves, Budget(len(STRAY)), fits)
        assert fits / voxel_size == pytest.approx(round(fits / voxel_size))
        with pytest.raises(InputError):
            check_fit(leaves, Budget(len(STRAY)), fits - voxel_size)


def test_a_limit_of_voxels_is_named_as_such():
    assert decode_bt(SITE, max_voxels=313 * 313 * 401, crop=((0, 0, 0), (60, 60, 30))).shape == (313, 313, 1)
    with pytest.raises(InputError, match=r"has more than the limit of 1,000 voxels; .*raise max_voxels"):
        decode_bt(SITE, max_voxels=1000)


def test_flat_indices_bound_what_memory_does_not(monkeypatch):
    monkeypatch.setenv("VOXJAX_MEMORY", "off")
    with pytest.raises(InputError, match="has more than the limit of 2,147,483,647 voxels") as caught:
        decode_bt(STRAY)
    # More memory would not help.
    assert "VOXJAX_MEMORY" not in str(caught.value)


def test_the_memory_of_a_grid_is_that_of_its_arrays_and_of_the_leaves():
    leaves = leaves_of_bt(SITE)
    assert dense_bytes(leaves, (2, 3, 4)) == leaves.num_bytes + 24
    assert canvas_for(leaves, 0.1).shape == leaves.shape
    full = leaves._replace(has_log_odds=True)
    assert dense_bytes(full, (2, 3, 4)) == full.num_bytes + 120


def test_a_voxel_size_far_below_that_of_the_file_is_refused_before_anything_is_made():
    one = oracle.file_of({(33000, 33000, 33000, 16): 2})
    assert decode_bt(one, voxel_size=0.01).shape == (10, 10, 10)
    for size in ("1e-09", "1e-12"):
        with pytest.raises(InputError, match=r"take voxel_size=0\.1 \(--voxel-size 0\.1\), at which it fits"):
            decode_bt(one, voxel_size=float(size))
    with pytest.raises(InputError, match=r"take voxel_size=0\.2 "):
        decode_bt(SITE, voxel_size=1e-6)
