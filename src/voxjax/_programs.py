"""Programs of kernels that outlive the process: what was traced once is not traced again by the next one.

JAX's persistent cache finds a compiled kernel by its program, so a new process traces and lowers each function before
it knows that nothing is left to compile, which takes longer than loading the kernel. Functions under `kept_program`
have their programs written down beside the kernels, in the form of `jax.export`.

A program is found by the function, the structure, shapes and dtypes of its arguments, the versions of the packages that
trace it, and the state of this package's own files. It is used for values on a CPU alone: under a transformation of
JAX, on accelerators, and for arguments whose code this package does not know (a `Term` of the user's), functions are
traced as ever.
"""

import contextlib
import functools
import hashlib
import importlib.metadata
import os
import pickle
import tempfile
import threading
import warnings
from collections.abc import Callable, Hashable, Sequence
from concurrent.futures import Future
from pathlib import Path
from typing import Any, NamedTuple, ParamSpec, TypeVar

import jax
import numpy as np
from jax.core import Tracer

P = ParamSpec("P")
R = TypeVar("R")
T = TypeVar("T")

_TRACED_BY = ("voxjax", "jax", "jaxlib", "numpy", "equinox", "lineax", "optimistix")
_KNOWN = ("builtins", "jax.", "jaxlib.", "numpy", "voxjax.")
"""Modules of types whose code belongs to the key of a program."""
_NUMBERS_AND_NAMES = (bool, int, float, str)
_DIGEST = hashlib.sha256().digest_size
_NAME, _ENDING = 32, ".program"
"""Of a file: length of each of the two digests in its name, and what comes after them."""

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
        return self.structure, tuple(parts), _option("jax_enable_x64")


def _is_plain(array: Any) -> bool:
    """Whether an array is a value on one CPU device, of a dtype that stays as it is."""
    if isinstance(array, Tracer) or jax.dtypes.canonicalize_dtype(array.dtype) != array.dtype:
        return False
    return not isinstance(array, jax.Array) or (
        not array.weak_type and array.sharding.device_set == _default_device()
    )


def _option(name: str) -> Any:
    """A setting of JAX, as this thread has it."""
    return getattr(jax.config, name)


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
    if not _is_known(call.structure) or " at 0x" in str(
        call.structure
    ):  # an object without a name of its own
        return None
    path = folder / f"{_version_digest()}-{_digest_of(function, call)}{_ENDING}"

    def load() -> Callable[..., Any]:
        content = _read(path)
        if content is None:
            content = _traced(function, call)
            _write(path, content)
        else:
            _mark_as_used(path)
        return _runnable(content)[0]

    return _once(path, load) or load()


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
    used = sorted(folder.glob(f"{_version_digest()}-*{_ENDING}"), key=lambda path: path.stat().st_mtime_ns)

    def ready(path: Path) -> Callable[..., Any] | None:
        content = _read(path)
        if content is None:
            return None
        run, jitted, shapes = _runnable(content)
        jitted.lower(*shapes).compile()
        return run

    for path in used[-_MOST_AHEAD:]:
        # Nobody waits for what is left when the program ends, or keeps its programs elsewhere.
        if _folder != folder or not threading.main_thread().is_alive():
            return
        _once(path, functools.partial(ready, path))


def _runnable(content: bytes) -> tuple[Callable[..., Any], Any, Sequence[Any]]:
    """A program as a function of arrays, the jitted part of it, and the shapes that this takes."""
    name, program, example = pickle.loads(content)
    exported, structure = jax.export.deserialize(bytearray(program)), jax.tree.structure(example)

    def run(*arrays: Any) -> Any:
        return exported.call(*arrays)

    run.__name__ = run.__qualname__ = name  # by which JAX tells what it compiles
    jitted = jax.jit(run)
    shapes = [jax.ShapeDtypeStruct(aval.shape, aval.dtype) for aval in exported.in_avals]
    return (lambda *arrays: jax.tree.unflatten(structure, jitted(*arrays))), jitted, shapes


def _traced(function: Callable[..., Any], call: _Call) -> bytes:
    """The name of the function, its program, and a tree of the structure of its results."""
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
    return pickle.dumps((function.__name__, bytes(program), example))


def _digest_of(function: Callable[..., Any], call: _Call) -> str:
    """What tells its program from those of all processes."""
    parts = [
        f"{function.__module__}.{function.__qualname__}",
        str(call.structure),
        *(
            f"{leaf.dtype}{leaf.shape}" if is_array else repr(leaf)
            for leaf, is_array in zip(call.leaves, call.is_array, strict=True)
        ),
        f"{_option('jax_enable_x64')} {_option('jax_default_matmul_precision')}",
    ]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:_NAME]


@functools.cache
def _version_digest() -> str:
    """What traces programs: versions of packages, and sizes and times of this package's files, which are edited."""
    found = [f"{name} {importlib.metadata.version(name)}" for name in _TRACED_BY]
    root = Path(__file__).parent
    for path in sorted(root.rglob("*.py")):
        status = path.stat()
        found.append(f"{path.relative_to(root)} {status.st_size} {status.st_mtime_ns}")
    return hashlib.sha256("\n".join(found).encode()).hexdigest()[:_NAME]


def _is_known(structure: Any) -> bool:
    """Whether all types of a structure have code that `_version_digest` tells apart."""
    data = structure.node_data()
    if data is not None and not f"{data[0].__module__}.".startswith(_KNOWN):
        return False
    return all(_is_known(child) for child in structure.children())


def _read(path: Path) -> bytes | None:
    """Content of a file that was written whole, else None."""
    try:
        content = path.read_bytes()
    except FileNotFoundError:
        return None
    except OSError as error:
        warnings.warn(f"a kept program cannot be read: {error}; it is traced again.", stacklevel=2)
        return None
    is_whole = hashlib.sha256(content[_DIGEST:]).digest() == content[:_DIGEST]
    return content[_DIGEST:] if is_whole else None


def _mark_as_used(path: Path) -> None:
    """Set the time of a file, by which the next process knows what to load first."""
    with contextlib.suppress(OSError):  # a folder that cannot be written serves as well
        os.utime(path)


def _write(path: Path, content: bytes) -> None:
    """Write a file whole or not at all; what cannot be written is traced again by the next process."""
    temporary = None
    try:
        with tempfile.NamedTemporaryFile(dir=path.parent, suffix=".part", delete=False) as file:
            temporary = file.name
            file.write(hashlib.sha256(content).digest() + content)
        os.replace(temporary, path)
    except OSError as error:
        warnings.warn(f"programs cannot be kept in {path.parent}: {error}.", stacklevel=2)
        if temporary is not None:
            Path(temporary).unlink(missing_ok=True)
