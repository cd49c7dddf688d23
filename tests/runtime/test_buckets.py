"""Ladders of lengths, and padding up to them."""

import numpy as np
import pytest

from voxjax._runtime.buckets import bucket_size, pad_rows, wide_bucket_size


@pytest.mark.parametrize(
    ("size", "rungs"),
    [(bucket_size, [64, 96, 128, 192, 256, 384, 512]), (wide_bucket_size, [64, 256, 1024, 4096])],
)
def test_a_count_gets_the_smallest_rung_that_holds_it(size, rungs):
    for count in range(rungs[-1] + 1):
        assert size(count, 64) == next(rung for rung in rungs if rung >= count)


def test_rows_are_kept_and_followed_by_the_fill():
    rows = np.arange(6, dtype=np.int32).reshape(3, 2)
    padded = pad_rows(rows, 5, fill=-1)
    assert padded.dtype == np.int32
    np.testing.assert_array_equal(padded[:3], rows)
    np.testing.assert_array_equal(padded[3:], -1)
    np.testing.assert_array_equal(pad_rows(rows, 4, fill=np.asarray([7, 8]))[3], [7, 8])


@pytest.mark.parametrize("size", [bucket_size, wide_bucket_size])
@pytest.mark.parametrize("smallest", [0, -64])
def test_ladders_that_would_never_climb_are_refused(size, smallest):
    with pytest.raises(ValueError, match=f"smallest must be 1 or more, got {smallest}"):
        size(5, smallest)
