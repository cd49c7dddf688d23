"""Programs of kernels that outlive the process: what was traced once is not traced again by the next one.

JAX's persistent cache finds a compiled kernel by its program, so a new process traces and lowers each function before
it knows that nothing is left to compile, which takes longer than loading the kernel. Functions under `kept_program`
have their programs written down beside the kernels, in the form of `jax.export`.

A program is found by the function, the structure, shapes and dtypes of its arguments, the versions of the packages that
trace it, and the state of this package's own files (`calls`). It is used for values on a CPU alone: under a
transformation of JAX, on accelerators, and for arguments whose code this package does not know (a `Term` of the
user's), functions are traced as ever. `program` has the form of a program, `loading` who loads it and when.
"""

import functools
from collections.abc import Callable, Hashable
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

from .calls import Call
from .forks import refuse_after_fork
from .loading import Loader
from .placement import backend
from .private_folders import private_folder
from .program import Program, traced
from .program_files import mark_as_used, program_path, read_whole, write_whole

P = ParamSpec("P")
R = TypeVar("R")

_loader: Loader | None = None


def keep_programs(folder: Path | None) -> None:
    """Keep the programs of this process in a folder, made if missing, and use those in it; None: keep none.

    Those that were used last are loaded at once, in the background, with their kernels.

    Raises:
        InputError: If somebody else can write the folder.
    """
    global _loader
    if _loader is not None:
        _loader.end()
    _loader = None if folder is None else Loader(private_folder(folder))
    if _loader is not None:
        _loader.start()


def kept_program(function: Callable[P, R]) -> Callable[P, R]:
    """A jitted function (`jax.jit`, `equinox.filter_jit`) whose programs are kept, if `keep_programs` was called.

    Leaves of the arguments that are no arrays are part of the program, so numbers that are not static must be arrays.
    """
    programs: dict[Hashable, Callable[..., Any] | None] = {}

    @functools.wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        refuse_after_fork()
        # One reading of the global serves the whole call: another thread may set it meanwhile.
        loader = _loader
        if loader is None or backend() != "cpu":
            return function(*args, **kwargs)
        taken = Call.of(args, kwargs)
        key = taken.key()
        if key is None:
            return function(*args, **kwargs)
        # Two threads may come here for one key: `Loader.once` has the program loaded by one of them.
        if (loader.folder, key) not in programs:
            # None is kept as well, so that what cannot be written down is tried once only.
            programs[loader.folder, key] = _program_of(function, taken, loader)
        program = programs[loader.folder, key]
        return function(*args, **kwargs) if program is None else program(*taken.arrays)

    return call


def _program_of(function: Callable[..., Any], call: Call, loader: Loader) -> Callable[..., Any] | None:
    """The program of a call as a function of its arrays: from the folder, or traced and written there."""
    digest = call.digest(function)
    if digest is None:
        return None
    path = program_path(loader.folder, digest)

    def load() -> Program | None:
        content = read_whole(path)
        program = None if content is None else Program.of(content)
        # A file that is damaged, or whose results have types of another kind, is traced and written anew.
        if program is None or program.runner(call) is None:
            content = traced(function, call)
            if content is None:
                return None
            write_whole(path, content)
            program = Program.of(content)
        return program

    found = loader.once(path, load)
    runner = None if found is None else found.runner(call)
    if runner is None:  # what was loaded ahead was none, or not for this call
        found = load()
        runner = None if found is None else found.runner(call)
    mark_as_used(path)
    return runner
