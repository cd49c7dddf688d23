"""Work that is spread over the cores."""

import threading
import time

import pytest

from voxjax import _threads
from voxjax._threads import spread


@pytest.fixture
def three_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_threads, "num_cores", lambda: 3)


@pytest.mark.usefixtures("three_cores")
def test_results_keep_the_order_of_the_items() -> None:
    def slow_at_first(item: int) -> int:
        time.sleep(0.01 if item == 0 else 0.0)
        return item * item

    assert spread(slow_at_first, iter(range(20))) == [item * item for item in range(20)]
    assert spread(slow_at_first, []) == []


@pytest.mark.usefixtures("three_cores")
def test_all_cores_work_and_the_caller_is_one_of_them() -> None:
    together = threading.Barrier(3, timeout=10)

    def meet(_: int) -> int:
        together.wait()
        return threading.get_ident()

    threads = set(spread(meet, range(3)))
    assert len(threads) == 3
    assert threading.get_ident() in threads


@pytest.mark.usefixtures("three_cores")
def test_the_first_error_is_raised_after_all_items_were_tried() -> None:
    tried = []

    def fail_twice(item: int) -> None:
        tried.append(item)
        if item in (2, 5):
            raise ValueError(f"item {item}")

    with pytest.raises(ValueError, match="item 2"):
        spread(fail_twice, range(8))
    assert sorted(tried) == list(range(8))


@pytest.mark.usefixtures("three_cores")
def test_pieces_of_a_piece_stay_in_its_thread() -> None:
    def inner(_: int) -> int:
        return threading.get_ident()

    def outer(_: int) -> bool:
        return set(spread(inner, range(4))) == {threading.get_ident()}

    assert all(spread(outer, range(6)))
    # The caller's thread is free again: its next call is spread anew.
    assert all(spread(outer, range(6)))


@pytest.mark.usefixtures("three_cores")
def test_an_interrupt_of_the_caller_leaves_what_has_not_begun() -> None:
    caller = threading.get_ident()
    begun = []

    def interrupted(item: int) -> None:
        begun.append(item)
        if threading.get_ident() == caller:
            raise KeyboardInterrupt
        time.sleep(0.01)

    with pytest.raises(KeyboardInterrupt):
        spread(interrupted, range(1000))
    assert len(begun) < 1000
