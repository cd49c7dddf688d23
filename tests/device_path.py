"""Forces the form that operations have on an accelerator, on whatever the tests run on."""

from collections.abc import Iterator
from contextlib import contextmanager

import jax
import pytest

from voxjax._runtime import placement


@contextmanager
def device_path() -> Iterator[None]:
    """Operations answer as if the default device were no CPU.

    Kernels are traced anew inside, and again afterwards: a trace remembers which form it took.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(placement, "backend", lambda: "accelerator")
        jax.clear_caches()
        try:
            yield
        finally:
            jax.clear_caches()
