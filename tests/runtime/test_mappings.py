import jax
import numpy as np
import pytest

from compilations import assert_compiles_nothing, compilations
from voxjax._runtime import mappings as _mappings
from voxjax._runtime.mappings import mappings_in_use, release_kernels_if_crowded

pytestmark = pytest.mark.skipif(mappings_in_use() is None, reason="the system does not count memory mappings")


def test_kernels_stay_while_there_is_room(monkeypatch):
    monkeypatch.setattr(_mappings, "mappings_in_use", lambda: (10, 100))
    dropped = []
    monkeypatch.setattr(jax, "clear_caches", lambda: dropped.append(True))
    assert not release_kernels_if_crowded(max_share=0.5)
    assert not dropped


def test_kernels_go_when_mappings_run_out_and_come_back_when_called():
    double = jax.jit(lambda x: x * 2)
    ones = np.ones(3, np.float32)
    double(ones)
    with assert_compiles_nothing(double):
        double(ones)
    assert release_kernels_if_crowded(max_share=0.0)
    with compilations() as found:
        assert np.asarray(double(ones)).sum() == 6.0
    assert found["<lambda>"] == 1
    release_kernels_if_crowded(max_share=0.0)
    with pytest.raises(AssertionError, match="compiled inside the block"), assert_compiles_nothing(double):
        double(ones)


def test_mappings_are_counted():
    found = mappings_in_use()
    assert found is not None
    assert 50 < found[0] < found[1]
