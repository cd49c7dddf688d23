"""Compiled kernels that outlive the process: JAX's persistent compilation cache, in a folder of the user."""

import os
import tempfile
import warnings
from pathlib import Path

from .._checks import InputError
from .private_folders import private_folder, remove_foreign_files
from .program_files import KeptProgramWarning

PROGRAMS = "programs"
"""Name of the folder, in that of the kernels, of the programs by which kernels are found (`programs`)."""


def default_cache_folder() -> Path:
    """Where the command line keeps compiled kernels: `voxjax/xla` in the user's cache folder.

    A relative `XDG_CACHE_HOME` is no folder of the user but one below wherever a process happens to run, perhaps a
    stranger's; the XDG specification says to ignore it, and a warning says so.

    Raises:
        InputError: If the user has neither a home nor `XDG_CACHE_HOME`.
    """
    base = os.environ.get("XDG_CACHE_HOME")
    # A variable that is set but empty counts as not set, as the specification has it.
    if base and not Path(base).is_absolute():
        warnings.warn(
            f"XDG_CACHE_HOME is the relative path {base!r}, which is ignored; compiled kernels are kept in ~/.cache.",
            KeptProgramWarning,
            stacklevel=2,
        )
        base = None
    try:
        return (Path(base) if base else Path.home() / ".cache") / "voxjax" / "xla"
    except RuntimeError as error:
        raise InputError("compiled kernels cannot be kept: the user has no home; name a folder.") from error


def keep_quickly_compiled_kernels() -> None:
    """Let JAX's cache keep kernels however fast they compiled, unless the environment sets thresholds.

    Most compile in less than JAX's threshold of one second, and together they take many.
    """
    import jax

    # With 0 JAX may set a least size of its own for some file systems; -1 keeps entries of any size.
    for name, value in (("min_compile_time_secs", 0.0), ("min_entry_size_bytes", -1)):
        if f"JAX_PERSISTENT_CACHE_{name.upper()}" not in os.environ:
            jax.config.update(f"jax_persistent_cache_{name}", value)


def use_compilation_cache(folder: str | os.PathLike | None = None) -> Path:
    """Keep all kernels that this process compiles and the programs that it traces, and load what earlier ones kept.

    The library keeps nothing unless this is called; the command line calls it. JAX asks for kernels by their programs,
    the version, the device and the features of the processor, so what has changed is compiled anew. It compiles anew,
    too, what it finds damaged, with a warning. Call it before the first kernel runs.

    Args:
        folder: Made if missing. None is the folder of the command line: `$XDG_CACHE_HOME/voxjax/xla`, or
            `~/.cache/voxjax/xla`. Whoever can write there can run code here: made so that only the user may enter
            it, and not used where others can write it.

    Returns:
        The folder.

    Raises:
        InputError: If the folder cannot be made or written, belongs to someone else, or can be written by others.
    """
    import jax

    # It imports JAX, which whoever only asks for the folder need not wait for.
    from .programs import keep_programs

    path = default_cache_folder() if folder is None else Path(folder)
    try:
        for part in (path, path / PROGRAMS):
            private_folder(part)
        # Only writing shows that a disk is full or read-only.
        with tempfile.TemporaryFile(dir=path):
            pass
    except OSError as error:
        raise InputError(
            f"compiled kernels cannot be kept in {path}: {error.strerror}; name another folder."
        ) from error
    # JAX runs what it finds there without asking whose it is, so that is asked before it looks.
    if count := remove_foreign_files(path, "-cache"):
        warnings.warn(
            f"{count} kernels in {path} were links, belonged to someone else or could be written by others; they are "
            "removed and compiled again.",
            KeptProgramWarning,
            stacklevel=2,
        )
    jax.config.update("jax_compilation_cache_dir", str(path))
    keep_quickly_compiled_kernels()
    keep_programs(path / PROGRAMS)  # last, as it loads kernels
    return path
