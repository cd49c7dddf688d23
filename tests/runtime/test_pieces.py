"""Sums over lists of any length under any number of poses, cut into calls of a kernel."""

import threading

import numpy as np
import pytest

from voxjax._runtime import pieces
from voxjax._runtime import threads as _threads
from voxjax._runtime.pieces import (
    PIECES,
    POSES,
    Run,
    each_piece,
    one_by_one,
    over_pieces,
    over_poses,
    sum_over_pieces,
)


@pytest.fixture(autouse=True)
def two_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (_threads, pieces):
        monkeypatch.setattr(module, "num_cores", lambda: 2)


def poses_of(count: int) -> np.ndarray:
    return np.arange(count * 16, dtype=np.float32).reshape(count, 4, 4)


def moments(values: np.ndarray, poses: np.ndarray, count: np.int32) -> np.ndarray:
    """Sum of the values times the first number of each pose, and of their squares; nothing beyond `count`."""
    assert len(values) in PIECES
    assert poses.shape == (POSES, 4, 4)
    sums = np.stack([values.sum() * poses[:, 0, 0], np.full(POSES, np.square(values).sum())], axis=1)
    sums[count:] = np.nan
    return sums


@pytest.mark.parametrize("length", [1, 128, 129, 5000, 16384, 40000])
@pytest.mark.parametrize("count", [1, 64, 513, 1100])
def test_sums_are_those_of_the_whole_list(length: int, count: int) -> None:
    values = (np.arange(length) % 7).astype(np.float32)
    found = sum_over_pieces(moments, [values], poses_of(count))
    expected = np.stack(
        [values.sum() * poses_of(count)[:, 0, 0], np.full(count, np.square(values).sum())], axis=1
    )
    assert found.dtype == np.float64
    np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_one_piece_under_many_poses_keeps_all_cores_busy() -> None:
    together = threading.Barrier(2, timeout=10)

    def meet(values: np.ndarray, poses: np.ndarray, count: np.int32) -> np.ndarray:
        together.wait()
        return moments(values, poses, count)

    assert len(sum_over_pieces(meet, [np.ones(16384, np.float32)], poses_of(1024))) == 1024


def test_poses_come_back_in_their_order() -> None:
    found = over_poses(lambda poses, _: poses[:, 0, 0], poses_of(1100), least_jobs=5)
    np.testing.assert_array_equal(found, poses_of(1100)[:, 0, 0])


@pytest.mark.parametrize("run", [pieces.spread, one_by_one])
@pytest.mark.parametrize("length", [0, 1, 4, 9])
def test_rows_of_any_number_go_through_one_shape(run: Run, length: int) -> None:
    shapes = []

    def kernel(rows: np.ndarray, others: np.ndarray, count: np.int32) -> dict[str, np.ndarray]:
        shapes.append((rows.shape, others.shape))
        assert (others[count:] == 7).all()
        return {"sum": rows.sum(axis=1) + others, "rows": rows}

    lists = [np.arange(2.0 * length).reshape(length, 2), np.arange(length)]
    found = over_pieces(kernel, lists, size=4, fills=[0, 7], run=run)
    np.testing.assert_array_equal(found["sum"], lists[0].sum(axis=1) + lists[1])
    np.testing.assert_array_equal(found["rows"], lists[0])
    assert set(shapes) == {((4, 2), (4,))}


def test_less_than_a_whole_piece_counts_where_cores_would_idle() -> None:
    counts = each_piece(lambda rows, count: (len(rows), int(count)), [np.arange(5)], size=4, step=2)
    assert counts == [(4, 2), (4, 2), (4, 1)]
