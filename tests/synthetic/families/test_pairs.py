"""Parts of two ways that overlap by as much as is asked for."""

import numpy as np
import pytest

from voxjax.synthetic.families.pairs import any_part, choose_parts, shared
from voxjax.synthetic.families.visitor import Visitor


class Points(Visitor):
    """A robot on a line, each of whose scans is one stretch of points."""

    def __init__(self, length, num_scans):
        self.length, self.num_scans = length, num_scans

    def __len__(self):
        return self.length

    def cloud(self, numbers):
        return np.concatenate([np.linspace((n, 0, 0), (n + 0.95, 0, 0), 20) for n in numbers])


@pytest.mark.parametrize("wanted", [0.1, 0.4, 0.8])
@pytest.mark.parametrize("seed", [0, 1, 2, 3])
def test_parts_share_what_is_asked_for(wanted, seed):
    a, b = Points(90, 20), Points(80, 25)
    first, second = choose_parts(np.random.default_rng(seed), a, b, wanted, 0.01)
    assert len(first) == 20
    assert len(second) == 25
    assert 0 <= min(first.start, second.start)
    assert max(first.stop, second.stop) <= 80
    np.testing.assert_allclose(shared(a.cloud(first), b.cloud(second), 0.01), wanted, atol=0.05)


def test_the_share_is_the_smaller_of_both_ways():
    line = np.linspace((0, 0, 0), (1, 0, 0), 101)
    assert shared(line, line[:26], 1e-3) == 26 / 101


def test_any_part_lies_on_the_way():
    parts = [any_part(np.random.default_rng(seed), Points(10, 4)) for seed in range(30)]
    assert {part.start for part in parts} == set(range(7))
    assert all(len(part) == 4 for part in parts)


class Loop(Points):
    """A robot whose way leads there and back."""

    def cloud(self, numbers):
        places = (min(n, self.length - 1 - n) for n in numbers)
        return np.concatenate([super(Loop, self).cloud(range(n, n + 1)) for n in places])


def test_ways_that_come_back_do_not_trap_the_search():
    for seed in range(8):
        a, b = Loop(100, 20), Loop(100, 20)
        first, second = choose_parts(np.random.default_rng(seed), a, b, 0.15, 0.01)
        np.testing.assert_allclose(shared(a.cloud(first), b.cloud(second), 0.01), 0.15, atol=0.03)
