"""Forces the form that operations have on an accelerator, on whatever the tests run on, and lowers it for a GPU."""

import contextlib
import inspect
import re
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import equinox as eqx
import jax
import pytest
from jax import export
from jax.core import Tracer

from voxjax._runtime import placement

CUSTOM_CALLS = ("__gpu$xla.gpu.triton",)
"""Calls whose format JAX does not promise to keep: of no concern to a kernel that is lowered and forgotten."""


@contextmanager
def device_path() -> Iterator[None]:
    """Operations answer as if the default device were a GPU.

    Kernels are traced anew inside, and again afterwards: a trace remembers which form it took.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(placement, "backend", lambda: "gpu")
        jax.clear_caches()
        try:
            yield
        finally:
            jax.clear_caches()


def lowered_for_cuda(kernel: Callable[..., Any], *shapes: Any) -> str:
    """Text of a kernel's program for CUDA, in the form that it has on a GPU; products keep the digits of float32 there.

    Args:
        kernel: A function of arrays.
        shapes: Its arguments, or `jax.ShapeDtypeStruct`s in place of their arrays.
    """
    checks = [export.DisabledSafetyCheck.custom_call(name) for name in CUSTOM_CALLS]
    with pytest.MonkeyPatch.context() as patch, some_gpu():
        patch.setattr(placement, "backend", lambda: "gpu")
        # A function of its own: JAX remembers the trace of the other form by the function.
        program = export.export(
            jax.jit(lambda *given: kernel(*given)), platforms=("cuda",), disabled_checks=checks
        )
        text = program(*shapes).mlir_module()
    assert not (found := rounded_products(text)), found
    return text


def rounded_products(text: str) -> list[str]:
    """Products of floating matrices that a GPU may round to TF32, which has ten bits, in the text of a program."""
    products = re.findall(r"^.*stablehlo\.(?:dot_general|dot|convolution)\b.*$", text, re.MULTILINE)
    return [
        line.strip()
        for line in products
        if re.search(r"-> tensor<(?:\d+x)*f32>", line) and "HIGHEST, HIGHEST" not in line
    ]


def some_gpu() -> contextlib.AbstractContextManager[Any]:
    """A context in which newer versions of JAX lower for a GPU that is not there."""
    parameters = inspect.signature(jax.sharding.AbstractDevice).parameters
    known = {"device_kind": "NVIDIA H100 80GB HBM3", "num_cores": 132, "platform": "gpu"}
    device = jax.sharding.AbstractDevice(**{k: v for k, v in known.items() if k in parameters})
    mesh = jax.sharding.AbstractMesh((1,), ("x",), abstract_device=device)
    return (
        jax.sharding.use_abstract_mesh(mesh)
        if hasattr(jax.sharding, "use_abstract_mesh")
        else contextlib.nullcontext()
    )


class Recorder:
    """Calls of the package's compiled functions, from host code, while it is in use; each is kept once.

    Attributes:
        calls: For each function and static arguments, the function and its arguments.
    """

    def __init__(self) -> None:
        self.calls: dict[str, tuple[Callable[..., Any], tuple, dict]] = {}

    @contextmanager
    def watching(self) -> Iterator[None]:
        """Record calls of every compiled function that stands at the top of a loaded module of voxjax."""
        with pytest.MonkeyPatch.context() as patch:
            for module in [m for name, m in sys.modules.items() if name.startswith("voxjax.")]:
                for name, value in list(vars(module).items()):
                    if _is_compiled(value):
                        patch.setattr(module, name, self._recorded(value))
            yield

    def _recorded(self, function: Callable[..., Any]) -> Callable[..., Any]:
        def call(*args: Any, **kwargs: Any) -> Any:
            arrays, static = eqx.partition((args, kwargs), eqx.is_array)
            if not any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(arrays)):
                name = f"{function.__module__}.{function.__qualname__} {static}"
                self.calls.setdefault(name, (function, args, kwargs))
            return function(*args, **kwargs)

        return call


def _is_compiled(value: Any) -> bool:
    kinds = {type(jax.jit(lambda: None)), type(eqx.filter_jit(lambda: None))}
    return type(value) in kinds or type(getattr(value, "__wrapped__", None)) in kinds


def call_lowered_for_cuda(function: Callable[..., Any], args: tuple, kwargs: dict) -> str:
    """Text of the program for CUDA of a call with values."""
    arrays, static = eqx.partition((args, kwargs), eqx.is_array)

    def kernel(arrays: Any) -> Any:
        some, named = eqx.combine(arrays, static)
        return eqx.filter(function(*some, **named), eqx.is_array)

    return lowered_for_cuda(kernel, arrays)
