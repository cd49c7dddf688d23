"""How and how often JAX compiles, for the tests that maps of other sizes, poses or starts share their kernels."""

import collections
import contextlib

import jax

QUICK = {"xla_cpu_use_fusion_emitters": False, "xla_cpu_parallel_codegen_split_count": 1}
"""Options of XLA for large kernels that tests alone compile, such as derivatives of whole solves, and run a few times:
they are compiled in a third of the time. What users run as it is gets the options that they have."""

_compiled: list[str] = []
"""Names of all functions that this process has compiled, or loaded from a cache of kernels."""


def _note(event: str, duration_secs: float, **about: str | int) -> None:
    if event == "/jax/core/compile/backend_compile_duration":
        _compiled.append(str(about.get("fun_name", "")).removeprefix("jit(").removesuffix(")"))


# JAX has no public way to take a listener away, so there is one for all tests of the process.
jax.monitoring.register_event_duration_secs_listener(_note)


@contextlib.contextmanager
def compilations():
    """A counter that holds, once the block has ended, how often each function was compiled in it, by name."""
    count, start = collections.Counter(), len(_compiled)
    yield count
    count.update(_compiled[start:])


@contextlib.contextmanager
def assert_compiles_nothing(*kernels):
    """Fail if any of these jitted functions is compiled inside the block; with none given, if anything is."""
    with compilations() as found:
        yield
    names = [kernel.__name__ for kernel in kernels] or list(found)
    again = {name: found[name] for name in names if found[name]}
    assert not again, f"compiled inside the block: {again}"
