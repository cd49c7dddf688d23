"""Programs of kernels that outlive the process: what was traced once is not traced again by the next one.

JAX's persistent cache finds a compiled kernel by its program, so a new process traces and lowers each function before
it knows that nothing is left to compile, which takes longer than loading the kernel. Functions under `kept_program`
have their programs written down beside the kernels, in the form of `jax.export`.

A program is found by the function, the structure, shapes and dtypes of its arguments, the versions of the packages that
trace it, and the state of this package's own files. It is used for values on a CPU alone: under a transformation of
JAX, on accelerators, and for arguments whose code this package does not know (a `Term` of the user's), functions are
traced as ever.
"""

import functools
import hashlib
import pickle
import threading
import warnings
from collections.abc import Callable, Hashable, Sequence
from concurrent.futures import Future
from pathlib import Path
from typing import Any, NamedTuple, ParamSpec, TypeVar

import jax
import numpy as np
from jax.core import Tracer

from .program_files import ENDING, NAME, mark_as_used, read_whole, version_digest, write_whole

P = ParamSpec("P")
R = TypeVar("R")
T = TypeVar("T")

_KNOWN = ("builtins", "jax.", "jaxlib.", "numpy", "voxjax.")
"""Modules of types whose code belongs to the key of a program."""
_NUMBERS_AND_NAMES = (bool, int, float, str)
_MOST_AHEAD = 24
"""Programs that are loaded before they are asked for: those that were used last."""

_folder: Path | None = None
_loads: dict[Path, Future] = {}
_lock = threading.Lock()


def keep_programs(folder: Path | None) -> None:
    """Keep the programs of this process in a folder, made if missing, and use those in it; None: keep none.

    Those that were used last are loaded at once, in the background, with their kernels.
    """
    global _folder
    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
    with _lock:
        _loads.clear()
        _folder = folder
    if folder is not None and any(folder.iterdir()):
        threading.Thread(target=_load_ahead, args=(folder,), name="voxjax programs").start()


class _Call(NamedTuple):
    """A call of a kept function, taken apart.

    Attributes:
        structure: Of its arguments.
        leaves: Of the structure: arrays, and values that are part of the program.
        is_array: Which is which.
    """

    structure: Any
    leaves: list[Any]
    is_array: list[bool]

    @classmethod
    def of(cls, args: tuple, kwargs: dict) -> "_Call":
        """Take arguments apart."""
        leaves, structure = jax.tree.flatten((args, kwargs))
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
        """What tells its program from others in this process; None if a program cannot be kept."""
        parts = []
        for leaf, is_array in zip(self.leaves, self.is_array, strict=True):
            if isinstance(leaf, _NUMBERS_AND_NAMES):
                parts.append((type(leaf), leaf))
            elif is_array and _is_plain(leaf):
                parts.append((leaf.shape, leaf.dtype))
            else:
                return None
        return self.structure, tuple(parts), _options()


def _is_plain(array: Any) -> bool:
    """Whether an array is a value on one CPU device, of a dtype that stays as it is."""
    if isinstance(array, Tracer) or jax.dtypes.canonicalize_dtype(array.dtype) != array.dtype:
        return False
    return not isinstance(array, jax.Array) or (
        not array.weak_type and array.sharding.device_set == _default_device()
    )


def _options() -> tuple[bool, Any]:
    """Settings of JAX that programs depend on, as this thread has them: float64, precision of products."""
    config: Any = jax.config
    return bool(config.jax_enable_x64), config.jax_default_matmul_precision


@functools.cache
def _default_device() -> set[Any]:
    return {jax.devices()[0]}


def kept_program(function: Callable[P, R]) -> Callable[P, R]:
    """A jitted function (`jax.jit`, `equinox.filter_jit`) whose programs are kept, if `keep_programs` was called.

    Leaves of the arguments that are no arrays are part of the program, so numbers that are not static must be arrays.
    """
    programs: dict[Hashable, Callable[..., Any] | None] = {}

    @functools.wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        folder = _folder
        if folder is None or jax.default_backend() != "cpu":
            return function(*args, **kwargs)
        taken = _Call.of(args, kwargs)
        key = taken.key()
        if key is None:
            return function(*args, **kwargs)
        if (folder, key) not in programs:
            programs[folder, key] = _program_of(function, taken, folder)
        program = programs[folder, key]
        return function(*args, **kwargs) if program is None else program(*taken.arrays)

    return call


def _program_of(function: Callable[..., Any], call: _Call, folder: Path) -> Callable[..., Any] | None:
    """The program of a call as a function of its arrays: from the folder, or traced and written there."""
    # Objects that are told by their address have no name that another process knows.
    if not _is_known(call.structure) or " at 0x" in str(call.structure):
        return None
    path = folder / f"{version_digest()}-{_digest_of(function, call)}{ENDING}"

    def load() -> Callable[..., Any]:
        content = read_whole(path)
        if content is None:
            content = _traced(function, call)
            write_whole(path, content)
        return _Program.of(content).run

    found = _once(path, load) or load()
    mark_as_used(path)
    return found


def _once(path: Path, load: Callable[[], T]) -> T:
    """What `load` gives, run by whoever asks first for a path; others wait for it."""
    with _lock:
        future, is_first = _loads.get(path), path not in _loads
        if future is None:
            future = _loads[path] = Future()
    if is_first:
        try:
            future.set_result(load())
        except BaseException as error:
            with _lock:
                _loads.pop(path, None)  # whoever asks again tries again
            future.set_exception(error)
            raise
    return future.result()


def _load_ahead(folder: Path) -> None:
    """Load programs of these versions and their kernels, in the order in which they were used."""
    used = sorted(folder.glob(f"{version_digest()}-*{ENDING}"), key=lambda path: path.stat().st_mtime_ns)

    def ready(path: Path) -> Callable[..., Any] | None:
        content = read_whole(path)
        if content is None:
            return None
        program = _Program.of(content)
        try:
            program.compile()
        except Exception as error:  # whoever asks for it tries again, and is told
            warnings.warn(f"a kept program was not compiled ahead: {error}", stacklevel=2)
            return None
        return program.run

    for path in used[-_MOST_AHEAD:]:
        # Nobody waits for what is left when the program ends, or keeps its programs elsewhere.
        if _folder != folder or not threading.main_thread().is_alive():
            return
        _once(path, functools.partial(ready, path))


class _Program(NamedTuple):
    """A program that was kept.

    Attributes:
        jitted: It, as a function of flat arrays.
        shapes: Of these.
        structure: Of its results.
        is_double: Whether it was traced with float64.
    """

    jitted: Any
    shapes: Sequence[jax.ShapeDtypeStruct]
    structure: Any
    is_double: bool

    @classmethod
    def of(cls, content: bytes) -> "_Program":
        """The program that `_traced` gave."""
        name, is_double, program, example = pickle.loads(content)
        exported = jax.export.deserialize(bytearray(program))

        def flat(*arrays: Any) -> Any:
            return exported.call(*arrays)

        flat.__name__ = flat.__qualname__ = name  # by which JAX tells what it compiles
        shapes = [jax.ShapeDtypeStruct(aval.shape, aval.dtype) for aval in exported.in_avals]
        return cls(jax.jit(flat), shapes, jax.tree.structure(example), is_double)

    def run(self, *arrays: Any) -> Any:
        """Results for arrays."""
        # Calls of exported programs tie results to their device, unlike the functions that they stand for: a kernel
        # that takes such a result would be compiled once more, and refuse arrays of other devices.
        free = [jax.device_put(np.asarray(result)) for result in self.jitted(*arrays)]
        return jax.tree.unflatten(self.structure, free)

    def compile(self) -> None:
        """Compile its kernel, or load it, so that `run` finds it."""
        with jax.enable_x64(self.is_double):
            self.jitted.lower(*self.shapes).compile()


def _traced(function: Callable[..., Any], call: _Call) -> bytes:
    """The name of the function, whether it knows float64, its program, and a tree of the structure of its results."""
    structure = None

    def flat(*arrays: Any) -> list[Any]:
        nonlocal structure
        args, kwargs = call.with_arrays(arrays)
        leaves, structure = jax.tree.flatten(function(*args, **kwargs))
        return leaves

    shapes = [jax.ShapeDtypeStruct(array.shape, array.dtype) for array in call.arrays]
    program = jax.export.export(jax.jit(flat))(*shapes).serialize()
    assert structure is not None  # exporting has traced it
    example = jax.tree.unflatten(structure, range(structure.num_leaves))
    return pickle.dumps((function.__name__, _options()[0], bytes(program), example))


def _digest_of(function: Callable[..., Any], call: _Call) -> str:
    """What tells its program from those of all processes."""
    parts = [
        f"{function.__module__}.{function.__qualname__}",
        str(call.structure),
        *(
            f"{leaf.dtype}{leaf.shape}" if is_array else repr(leaf)
            for leaf, is_array in zip(call.leaves, call.is_array, strict=True)
        ),
        str(_options()),
    ]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:NAME]


def _is_known(structure: Any) -> bool:
    """Whether all types of a structure have code that `version_digest` tells apart."""
    data = structure.node_data()
    if data is not None and not f"{data[0].__module__}.".startswith(_KNOWN):
        return False
    return all(_is_known(child) for child in structure.children())
