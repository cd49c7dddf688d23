"""What every command that computes sets up: that kernels compiled in one run serve the next."""

import os
import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from glob import escape
from pathlib import Path

from .._checks import InputError
from .._runtime.compilation_cache import keep_quickly_compiled_kernels, use_compilation_cache
from .._runtime.program_files import KeptProgramWarning
from .streams import warn


@contextmanager
def kept_kernels() -> Iterator[None]:
    """Let JAX keep compiled kernels between runs, unless the user has said where or forbidden it.

    `VOXJAX_CACHE=off` switches it off; JAX's own `JAX_COMPILATION_CACHE_DIR` wins. A cache that cannot be used is no
    reason not to run: a folder that cannot be written is named in one line, and kernels that cannot be read are
    compiled again and their files removed, for JAX would keep them and compile again in every run.
    """
    if os.environ.get("VOXJAX_CACHE") == "off":
        yield
        return
    chosen = os.environ.get("JAX_COMPILATION_CACHE_DIR")
    if chosen and "://" in chosen:  # the address of a store, which JAX also takes
        keep_quickly_compiled_kernels()
        yield
        return
    with _mended() as used:
        try:
            used.append(use_compilation_cache(chosen or None))
        except InputError as error:
            _keep_nothing(error)
        yield


@contextmanager
def granted_memory(gigabytes: float | None) -> Iterator[None]:
    """Let checks of memory take a number of gigabytes for what there is; None leaves that as it is.

    Raises:
        InputError: As from within, but that it says what grants the memory: the variable is overridden.
    """
    before = os.environ.get("VOXJAX_MEMORY")
    if gigabytes is not None:
        os.environ["VOXJAX_MEMORY"] = repr(gigabytes)
    try:
        yield
    except InputError as error:
        if gigabytes is None:
            raise
        granted = "--memory grants that much, give it more if the machine has more"
        raise InputError(str(error).replace("VOXJAX_MEMORY=off skips this check", granted)) from error
    finally:
        if gigabytes is not None:
            os.environ.pop("VOXJAX_MEMORY")
            os.environ.update({} if before is None else {"VOXJAX_MEMORY": before})


def _keep_nothing(error: InputError) -> None:
    """Compile without a cache, also without the one that JAX has from its own variable, and say why."""
    import jax

    jax.config.update("jax_compilation_cache_dir", None)
    # What the library advises its callers stands behind the semicolon; the command has variables instead.
    name = "JAX_COMPILATION_CACHE_DIR" if "JAX_COMPILATION_CACHE_DIR" in os.environ else "XDG_CACHE_HOME"
    warn(f"{str(error).rsplit(';', 1)[0]}; set {name} to another folder, or VOXJAX_CACHE=off.")


@contextmanager
def _mended() -> Iterator[list[Path]]:
    """Act on warnings of the cache, JAX's and ours, instead of showing them; all others are shown.

    Yields:
        A list that takes the folder of the cache once it is known.
    """
    # Warnings are the only way in which JAX tells of entries that it cannot read or write.
    folders: list[Path] = []
    show, is_said = warnings.showwarning, False
    entry_error = "Error {} persistent compilation cache entry for '([^']+)'"
    unreadable_entry = re.compile(entry_error.format("reading"))
    unwritten_entry = re.compile(entry_error.format("writing") + ": (.+)", re.DOTALL)

    def act(
        message: Warning | str, category: type[Warning], filename: str, lineno: int, *rest: object
    ) -> None:
        nonlocal is_said
        unreadable, unwritten = unreadable_entry.match(str(message)), unwritten_entry.match(str(message))
        if unreadable:
            for folder in folders:
                # The name is escaped, because a kernel's name may hold what a pattern means otherwise.
                for entry in folder.glob(f"{escape(unreadable[1])}-*"):
                    entry.unlink(missing_ok=True)
        elif unwritten:
            if not is_said:
                warn(f"compiled kernels cannot be kept in {', '.join(map(str, folders))}: {unwritten[2]}.")
            is_said = True
        elif issubclass(category, KeptProgramWarning):
            warn(str(message))
        else:
            show(message, category, filename, lineno, *rest)  # pyright: ignore[reportArgumentType]

    with warnings.catch_warnings():
        # Python shows a warning once for each place; each of these names another entry.
        warnings.filterwarnings("always", message="Error (reading|writing) persistent compilation cache")
        warnings.filterwarnings("always", category=KeptProgramWarning)
        warnings.showwarning = act
        yield folders
