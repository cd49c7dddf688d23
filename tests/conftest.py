"""Settings for all tests: no silent promotion of dtypes or ranks, two host devices, one cache of kernels."""

import gc
import os
import signal
import tempfile
from pathlib import Path

import jax
import pytest

from voxjax._runtime.mappings import release_kernels_if_crowded

jax.config.update("jax_num_cpu_devices", 2)
jax.config.update("jax_numpy_dtype_promotion", "strict")
jax.config.update("jax_numpy_rank_promotion", "raise")

# Traces are large graphs of objects that live long: the collector would walk through them again and again.
gc.freeze()
gc.set_threshold(100_000, 20, 100)

# A run in the background ignores Ctrl-C, and so would the commands that tests interrupt.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
    signal.signal(signal.SIGHUP, signal.SIG_DFL)


def _share_kernels():
    """Let all processes of this run share compiled kernels; None where the environment names a folder for them.

    The workers of pytest-xdist and the processes that tests start inherit the variables, so each kernel is compiled
    once a run.
    """
    if "JAX_COMPILATION_CACHE_DIR" in os.environ:
        return None
    folder = tempfile.TemporaryDirectory(prefix="voxjax-tests-", ignore_cleanup_errors=True)
    for option, value in (
        ("jax_compilation_cache_dir", folder.name),
        ("jax_persistent_cache_min_compile_time_secs", 0.05),
    ):
        os.environ[option.upper()] = str(value)
        jax.config.update(option, value)
    return folder


_kernels = _share_kernels()

# JAX finds kernels by the number of devices and by the flags of XLA too: the processes that tests start have those of
# the tests. In one part instead of 32 the code of a kernel is made in less time, and all cores have kernels to make.
os.environ.setdefault("JAX_NUM_CPU_DEVICES", "2")
os.environ.setdefault("XLA_FLAGS", "--xla_cpu_parallel_codegen_split_count=1")


def pytest_unconfigure():
    """The process that made the folder of kernels is the last one that needs it."""
    if _kernels is not None:
        _kernels.cleanup()


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
