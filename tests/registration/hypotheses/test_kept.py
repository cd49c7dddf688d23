"""What is kept of a pair: found once, apart for each pair and key, and gone with its maps."""

import gc
import weakref

from small_worlds import draw_map
from voxjax.registration.hypotheses.kept import forget_pair, kept_of_pair
from voxjax.registration.hypotheses.map_features import map_features


def test_each_pair_and_key_is_found_once(pair):
    a, b, _ = pair
    found = []

    def find():
        found.append(len(found))
        return found[-1]

    assert [kept_of_pair(a, b, "one", find) for _ in range(3)] == [0, 0, 0]
    assert kept_of_pair(a, b, "another", find) == 1
    assert kept_of_pair(b, a, "one", find) == 2


def test_nothing_outlives_its_map(pair):
    class Found:
        pass

    other = map_features(draw_map(), max_virtual=1)
    found = weakref.ref(kept_of_pair(pair[0], other, "found", Found))
    gc.collect()
    assert found() is not None
    del other
    gc.collect()
    assert found() is None


def test_a_pair_is_forgotten_and_others_are_not(pair):
    a, b, _ = pair
    forget_pair(a, b)
    found = iter(range(10))
    assert kept_of_pair(a, b, "forgotten", lambda: next(found)) == 0
    assert kept_of_pair(b, a, "forgotten", lambda: next(found)) == 1
    forget_pair(a, b)
    assert kept_of_pair(b, a, "forgotten", lambda: next(found)) == 1
    assert kept_of_pair(a, b, "forgotten", lambda: next(found)) == 2
