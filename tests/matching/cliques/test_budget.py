"""The budget of a search: nodes, and time on a clock that the test turns."""

import pytest

from voxjax.matching.cliques import budget as module
from voxjax.matching.cliques.budget import SearchBudget


def test_nodes_are_counted_and_end_the_search():
    budget = SearchBudget(max_nodes=3)
    assert [budget.spend() for _ in range(4)] == [True, True, True, False]
    assert (budget.num_nodes, budget.stopped_by) == (4, "nodes")
    assert not budget.look()


@pytest.fixture
def clock(monkeypatch):
    """The clock that budgets read; the test sets it."""
    now = [100.0]
    monkeypatch.setattr(module.time, "perf_counter", lambda: now[0])
    return now


def test_time_ends_the_search_at_the_next_look(clock):
    budget = SearchBudget(max_nodes=1000, max_seconds=2.0, _start=100.0)
    clock[0] = 102.5
    spent = 0
    while budget.spend():
        spent += 1
    assert 0 < spent < 200
    assert budget.stopped_by == "time"


def test_without_a_limit_of_time_the_clock_does_not_count(clock):
    budget = SearchBudget(max_nodes=1000, _start=0.0)
    clock[0] = 1e9
    assert all(budget.spend() for _ in range(500))
    assert budget.look()
