import pytest

from voxjax import InputError
from voxjax.io import MAX_VOXELS
from voxjax.io import budget as module
from voxjax.io.budget import Budget


@pytest.fixture(autouse=True)
def _eight_gigabytes(monkeypatch):
    monkeypatch.delenv("VOXJAX_MEMORY", raising=False)
    monkeypatch.setattr(module, "available_memory", lambda: 8_000_000_000)


def test_a_file_may_take_memory_in_proportion_to_its_size():
    small, large = Budget(100), Budget(1_000_000)
    small.check(1 << 29, "the map")
    large.check(2048 * 1_000_000, "the map")
    with pytest.raises(
        InputError, match=r"the map needs about 1 GB of memory, and a file of 100 bytes may take 0\.537"
    ):
        small.check(1e9, "the map")


def test_no_file_may_take_more_than_is_available():
    with pytest.raises(InputError, match="8 GB are available"):
        Budget(10**9).check(9e9, "the tree")


def test_the_environment_overrides_both(monkeypatch):
    monkeypatch.setenv("VOXJAX_MEMORY", "0.1")
    with pytest.raises(InputError, match=r"VOXJAX_MEMORY allows 0\.1 GB"):
        Budget(10**9).check(2e8, "the map")
    monkeypatch.setenv("VOXJAX_MEMORY", "off")
    Budget(1).check(1e12, "the map")


def test_grids_are_refused_by_their_voxels_and_by_their_bytes():
    budget = Budget(100)
    budget.check_grid((1024, 1024, 512), 1)
    with pytest.raises(InputError, match=r"the map of 1024 x 1024 x 512 voxels needs about 2\.68 GB"):
        budget.check_grid((1024, 1024, 512), 5)
    with pytest.raises(InputError, match="more than the limit of 2,147,483,647"):
        budget.check_grid((2048, 2048, 512), 1)
    with pytest.raises(InputError, match="more than the limit"):
        budget.check_grid((MAX_VOXELS + 1, 0, 3), 1)


def test_whoever_names_the_number_of_voxels_gets_them_from_any_file():
    Budget(100, 2 * MAX_VOXELS).check_grid((2048, 1024, 1024), 1)
    with pytest.raises(InputError, match="more than the limit of 50"):
        Budget(100, 50).check_grid((4, 4, 4), 1)
    with pytest.raises(InputError, match="8 GB are available"):
        Budget(100, 10**10).check_grid((2100, 2000, 2000), 1)
