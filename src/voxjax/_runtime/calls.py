"""A call of a kept function, taken apart into what its program depends on and the arrays that the program is given."""

import functools
import hashlib
from collections.abc import Callable, Hashable, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np
from jax.core import Tracer


class Call(NamedTuple):
    """A call of a kept function, taken apart.

    Attributes:
        structure: Structure of the call's arguments.
        leaves: Leaves of that structure: arrays, and values that are part of the program.
        is_array: For each leaf, whether it is an array.
    """

    structure: Any
    leaves: list[Any]
    is_array: list[bool]

    @classmethod
    def of(cls, args: tuple, kwargs: dict) -> "Call":
        """Take arguments apart."""
        leaves, structure = jax.tree.flatten((args, kwargs))
        # NumPy's numbers count as arrays: another value of theirs is no other program.
        return cls(structure, leaves, [isinstance(x, (jax.Array, np.ndarray, np.generic)) for x in leaves])

    @property
    def arrays(self) -> list[Any]:
        """The leaves that are arrays."""
        return [leaf for leaf, is_array in zip(self.leaves, self.is_array, strict=True) if is_array]

    def with_arrays(self, arrays: Sequence[Any]) -> tuple[tuple, dict]:
        """Arguments with other arrays."""
        rest = iter(arrays)
        leaves = [
            next(rest) if is_array else leaf
            for leaf, is_array in zip(self.leaves, self.is_array, strict=True)
        ]
        return jax.tree.unflatten(self.structure, leaves)

    def key(self) -> Hashable:
        """What tells the call's program from others in this process; None if a program cannot be kept."""
        parts = []
        for leaf, is_array in zip(self.leaves, self.is_array, strict=True):
            # Numbers and texts of Python become constants of the program, so their values belong to its key.
            if isinstance(leaf, (bool, int, float, str)):
                # The type and the digits belong to it: 1, 1.0 and True are equal, 0.0 and -0.0 too, but make different
                # programs.
                parts.append((type(leaf), repr(leaf)))
            elif is_array and _is_plain(leaf):
                parts.append((leaf.shape, leaf.dtype))
            else:
                return None
        # Options of JAX may hold for one thread, or for one block of code, so that each call asks for them.
        return self.structure, tuple(parts), jax_options()

    def digest(self, function: Callable[..., Any]) -> str | None:
        """What tells the program of this call of a function from those of all processes; None where nothing can."""
        # Objects that are told by their address have no name that another process knows.
        # A class of the user's may change without any file of this package's changing.
        if not _is_known(self.structure) or " at 0x" in str(self.structure):
            return None
        parts = [
            f"{function.__module__}.{function.__qualname__}",
            str(self.structure),
            *(
                f"{leaf.dtype}{leaf.shape}" if is_array else repr(leaf)
                for leaf, is_array in zip(self.leaves, self.is_array, strict=True)
            ),
            # Packages and files of voxjax are in the name of the file, see `program_files.version_digest`.
            str(jax_options()),
        ]
        return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def jax_options() -> tuple[bool, Any]:
    """Settings of JAX that programs depend on, as this thread has them: float64, precision of products."""
    config: Any = jax.config
    return bool(config.jax_enable_x64), config.jax_default_matmul_precision


def _is_plain(array: Any) -> bool:
    """Whether an array is a value on one CPU device, of a dtype that stays as it is."""
    # A program takes values: what is traced has none, and JAX would make float32 of float64.
    if isinstance(array, Tracer) or jax.dtypes.canonicalize_dtype(array.dtype) != array.dtype:
        return False
    # Weak types and other devices make other programs than shape and dtype say.
    return not isinstance(array, jax.Array) or (
        not array.weak_type and array.sharding.device_set == _default_device()
    )


@functools.cache
def _default_device() -> set[Any]:
    return {jax.devices()[0]}


def _is_known(structure: Any) -> bool:
    """Whether all types of a structure have code that `version_digest` tells apart."""
    known = ("builtins", "jax.", "jaxlib.", "numpy", "voxjax.")
    data = structure.node_data()
    # The dot behind the name keeps a module such as `voxjax_extra` from passing for one of voxjax.
    if data is not None and not f"{data[0].__module__}.".startswith(known):
        return False
    return all(_is_known(child) for child in structure.children())
