"""One kept program: how it is traced, written down as bytes, and run.

The bytes are a header in JSON (the name of the function, whether it was traced with float64, and the structure of its
results) behind its length, and the program in the form of `jax.export`. Nothing in them is executed when they are read:
`jax.export` keeps StableHLO in a flatbuffer. The program itself can do whatever XLA can, hence `private_folders`.
"""

import json
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np

from .calls import Call, jax_options
from .result_trees import plain_structure, structure_of

_LENGTH = 4
"""Bytes of the length of the header, the least significant first."""


class Program(NamedTuple):
    """A program that was kept.

    Attributes:
        jitted: The program as a function of flat arrays.
        shapes: Shapes and dtypes of these arrays.
        results: Structure of the results, as `plain_structure` gives it: a process that loads ahead may not have
            imported their types yet.
        is_double: Whether the program was traced with float64.
    """

    jitted: Any
    shapes: Sequence[jax.ShapeDtypeStruct]
    results: Any
    is_double: bool

    @classmethod
    def of(cls, content: bytes) -> "Program | None":
        """The program that `traced` wrote down; None if this is none, whatever it is."""
        start = _LENGTH + int.from_bytes(content[:_LENGTH], "little")
        try:
            header = json.loads(content[_LENGTH:start])
            name, is_double = str(header["name"]), bool(header["is_double"])
            exported = jax.export.deserialize(bytearray(content[start:]))
        except Exception:  # what reading an arbitrary flatbuffer raises is no list that one could write down
            return None

        def flat(*arrays: Any) -> Any:
            return exported.call(*arrays)

        flat.__name__ = flat.__qualname__ = name  # by which JAX tells what it compiles
        shapes = [jax.ShapeDtypeStruct(aval.shape, aval.dtype) for aval in exported.in_avals]
        return cls(jax.jit(flat), shapes, header.get("results"), is_double)

    def runner(self, call: Call) -> Callable[..., Any] | None:
        """The program as a function of the arrays of a call; None if it takes others, or its results are unknown."""
        # A file under a wrong name must not run on arrays that it was not traced for.
        if [(each.shape, each.dtype) for each in self.shapes] != [(x.shape, x.dtype) for x in call.arrays]:
            return None
        try:
            structure = structure_of(self.results)
        except (ValueError, TypeError):
            return None

        def run(*arrays: Any) -> Any:
            # Calls of exported programs tie results to their device, unlike the functions that they stand for: a
            # kernel that takes such a result would be compiled once more, and refuse arrays of other devices.
            free = [jax.device_put(np.asarray(result)) for result in self.jitted(*arrays)]
            return jax.tree.unflatten(structure, free)

        return run

    def compile(self) -> None:
        """Compile the program's kernel, or load it, so that the next call finds it."""
        # The thread that loads ahead has settings of its own: the program needs those that it was traced with.
        with jax.enable_x64(self.is_double):
            self.jitted.lower(*self.shapes).compile()


def traced(function: Callable[..., Any], call: Call) -> bytes | None:
    """The program of a call of a function as bytes; None if its results cannot be written down."""
    structure = None

    def flat(*arrays: Any) -> list[Any]:
        nonlocal structure
        args, kwargs = call.with_arrays(arrays)
        leaves, structure = jax.tree.flatten(function(*args, **kwargs))
        return leaves

    # Programs are exported for flat arrays: their form knows nothing of classes of voxjax.
    shapes = [jax.ShapeDtypeStruct(array.shape, array.dtype) for array in call.arrays]
    program = jax.export.export(jax.jit(flat))(*shapes).serialize()
    try:
        results = plain_structure(structure)  # exporting has traced the function
    except ValueError:
        return None
    header = {"name": function.__name__, "is_double": jax_options()[0], "results": results}
    written = json.dumps(header).encode()
    return len(written).to_bytes(_LENGTH, "little") + written + bytes(program)
