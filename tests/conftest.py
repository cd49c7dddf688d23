"""Strict settings for all tests: no silent promotion of dtypes or ranks, two host devices."""

import os
from pathlib import Path

import jax
import pytest

from voxjax._runtime.mappings import release_kernels_if_crowded

jax.config.update("jax_num_cpu_devices", 2)
jax.config.update("jax_numpy_dtype_promotion", "strict")
jax.config.update("jax_numpy_rank_promotion", "raise")


@pytest.fixture(autouse=True, scope="module")
def _room_for_kernels():
    """One process compiles the kernels of many test modules."""
    release_kernels_if_crowded()


@pytest.fixture
def key():
    return jax.random.key(0)


@pytest.fixture
def maps_folder():
    """The folder of test maps; tests that use it are marked `real_maps`."""
    return Path(os.environ["VOXJAX_MAPS"])


def pytest_collection_modifyitems(items):
    """Skip, with the reason, what this machine lacks."""
    maps = os.environ.get("VOXJAX_MAPS")
    reason = None
    if not maps:
        reason = "VOXJAX_MAPS does not name a folder of test maps"
    elif not Path(maps).is_dir():
        reason = f"VOXJAX_MAPS={maps} is no folder"
    for item in items:
        if reason and "real_maps" in item.keywords:
            item.add_marker(pytest.mark.skip(reason=reason))
        if "gpu" in item.keywords and jax.default_backend() != "gpu":
            item.add_marker(pytest.mark.skip(reason="needs a GPU"))
