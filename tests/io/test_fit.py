import numpy as np
import pytest

from oracles import octree as oracle
from voxjax import InputError
from voxjax.io.budget import Budget
from voxjax.io.fit import check_fit
from voxjax.io.octomap import decode_bt
from voxjax.io.octomap_leaves import leaves_of_bt

# Voxels far from each other, so that each has a block of its own; and one at the other end of what a file can hold.
_STEPS = np.ndindex(36, 36, 36)
GROUND = {(20000 + 8 * i, 20000 + 8 * j, 20000 + 8 * k, 16): 2 for i, j, k in _STEPS}
SITE = oracle.file_of(GROUND)
STRAY = oracle.file_of(GROUND | {(3, 65000, 65000, 16): 2})


@pytest.fixture(autouse=True)
def _little_memory(monkeypatch):
    monkeypatch.setenv("VOXJAX_MEMORY", "0.03")


def test_a_map_of_many_blocks_says_at_which_voxel_size_it_fits():
    with pytest.raises(InputError) as caught:
        decode_bt(SITE)
    told = str(caught.value)
    assert "the map of 281 x 281 x 281 voxels of 0.1 m (46,656 occupied in the file) needs about 0.06" in told
    assert "VOXJAX_MEMORY allows 0.03 GB" in told
    assert "take voxel_size=0.2 (--voxel-size 0.2), at which it fits" in told
    assert "crop= (--crop)" in told
    assert "isolated" not in told
    assert decode_bt(SITE, voxel_size=0.2).num_occupied == 36**3


def test_the_box_is_no_reason_to_refuse_a_map(monkeypatch):
    monkeypatch.setenv("VOXJAX_MEMORY", "0.2")
    far = {(i, 20000 + 9 * i, 33000, 16): 2 for i in range(1000)} | {(0, 20000, 36000, 16): 1}
    grid = decode_bt(oracle.file_of(far))
    assert grid.shape == (1000, 8992, 3001)
    assert (grid.num_occupied, grid.num_free) == (1000, 1)


def test_isolated_pieces_are_named_where_they_alone_make_the_map_too_large(monkeypatch):
    monkeypatch.setenv("VOXJAX_MEMORY", "0.2")
    with pytest.raises(
        InputError,
        match=r"has more than 2,147,483,647 blocks of 8 x 8 x 8 voxels; leave out its isolated pieces \(1 voxel up to "
        r".* m .*box is 281 x 281 x 281, or take voxel_size=",
    ) as caught:
        decode_bt(STRAY)
    # More memory would not help.
    assert "VOXJAX_MEMORY" not in str(caught.value)
    assert decode_bt(STRAY, drop_isolated=True).shape == (281, 281, 281)


def test_the_voxel_size_that_is_told_is_the_smallest_whole_multiple_that_fits():
    leaves = leaves_of_bt(SITE)
    for voxel_size in (0.1, 0.11):
        with pytest.raises(InputError) as caught:
            check_fit(leaves, Budget(len(SITE)), voxel_size)
        fits = float(str(caught.value).split("voxel_size=")[1].split()[0])
        check_fit(leaves, Budget(len(SITE)), fits)
        assert fits / voxel_size == pytest.approx(round(fits / voxel_size))
        with pytest.raises(InputError):
            check_fit(leaves, Budget(len(SITE)), fits - voxel_size)


def test_leaves_that_are_too_many_by_themselves_fit_at_no_voxel_size():
    with pytest.raises(InputError, match="more than the limit of 10 voxels; take voxel_size=") as caught:
        decode_bt(SITE, max_voxels=10)
    leaves = leaves_of_bt(SITE)
    leaves.levels[-1] = leaves.levels[-1].where(np.zeros(10**6, np.int64))
    with pytest.raises(InputError) as caught:
        check_fit(leaves, Budget(len(SITE)), 0.1)
    assert "take voxel_size" not in str(caught.value)


def test_a_limit_of_voxels_is_named_as_such():
    cut = ((-1300.0, -1300.0, -1300.0), (-1270.0, -1270.0, -1270.0))
    assert decode_bt(SITE, max_voxels=281**3, crop=cut).shape == (65, 65, 65)
    with pytest.raises(InputError, match=r"has more than the limit of 1,000 voxels; .*raise max_voxels"):
        decode_bt(SITE, max_voxels=1000)


def test_a_voxel_size_far_below_that_of_the_file_is_refused_before_anything_is_made():
    one = oracle.file_of({(33000, 33000, 33000, 16): 2})
    assert decode_bt(one, voxel_size=0.01).shape == (10, 10, 10)
    for size in ("1e-09", "1e-12"):
        with pytest.raises(InputError, match=r"take voxel_size=0\.1 \(--voxel-size 0\.1\), at which it fits"):
            decode_bt(one, voxel_size=float(size))
    with pytest.raises(InputError, match=r"take voxel_size=0\.2 "):
        decode_bt(SITE, voxel_size=1e-6)
