"""Entry point: runs one command and turns what happens into an exit code."""

import errno
import traceback
from collections.abc import Sequence
from importlib import import_module

from .parser import parse
from .process import (
    Stopped,
    garbage_collection_put_off,
    leave_on_interrupt,
    open_closed_descriptors,
    signals_raise,
)
from .streams import lasting_streams, warn, warnings_as_sentences


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line.

    Args:
        argv: Arguments without the program's name; None takes those of the process, which is then voxjax's own: its
            signals are handled.

    Returns:
        0 done, 1 fault of voxjax, 2 unusable input or arguments, 3 nothing trustworthy to write; 128 and the number
        of the signal that stopped it.
    """
    # Whoever calls `main` with arguments has signals and descriptors of their own, which stay as they are.
    is_own_process = argv is None
    if is_own_process:
        leave_on_interrupt()
        open_closed_descriptors()
    with lasting_streams() as output, warnings_as_sentences():
        code = _exit_code(argv, is_own_process=is_own_process)
        # What is still buffered may fail to be written, and must do so before the exit code is decided.
        output.flush()
        # A reader that has gone has read enough, as in `voxjax info map.bt | head -1`.
        if code == 0 and output.failure is not None and not isinstance(output.failure, BrokenPipeError):
            warn(
                f"the standard output cannot be written: {output.failure.strerror}; lead it to another place."
            )
            return 2
        return code


def _exit_code(argv: Sequence[str] | None, *, is_own_process: bool) -> int:
    """Parse the arguments and run the command."""
    try:
        # Arguments come first and alone: help and mistakes are answered before NumPy or JAX is imported.
        args = parse(argv)
    except SystemExit as stop:  # --help, --version, or wrong arguments that have been explained
        return int(stop.code or 0)
    try:
        with garbage_collection_put_off(for_good=is_own_process):
            command = import_module(f".{args.command}", __package__)
        if not is_own_process:
            return command.run(args)
        with signals_raise():
            return command.run(args)
    # The code is 128 and the number of SIGINT, which is what shells expect.
    except KeyboardInterrupt:
        warn("stopped.")
        return 130
    except Stopped as stop:
        warn(f"stopped by {stop}.")
        return stop.exit_code
    except Exception as error:
        return _explained(error, is_debug=args.debug)


def _explained(error: Exception, *, is_debug: bool) -> int:
    """Say in one line what went wrong, and return the exit code."""
    from .._checks import InputError  # imports NumPy, which help must not wait for

    if isinstance(error, InputError):
        warn(str(error))
        return 2
    if _is_out_of_memory(error):
        warn("the memory does not suffice; give a larger --voxel-size, smaller maps or more memory.")
        return 2
    if is_debug:
        traceback.print_exception(error)
    summary = " ".join(f"{type(error).__name__}: {error}".split())[:300]
    advice = "." if is_debug else ", with what --debug prints."
    warn(f"internal fault ({summary}); please report it at https://github.com/voxjax/voxjax/issues{advice}")
    return 1


def _is_out_of_memory(error: Exception) -> bool:
    """Whether an allocation failed: Python's, the operating system's, or XLA's."""
    if isinstance(error, MemoryError) or (isinstance(error, OSError) and error.errno == errno.ENOMEM):
        return True
    # XLA says it by its text alone, under one of two codes: of its own allocator, or of a kernel that allocates.
    text = str(error)
    is_of_xla = type(error).__name__ in ("JaxRuntimeError", "XlaRuntimeError")
    return text.startswith("RESOURCE_EXHAUSTED") or (is_of_xla and "out of memory" in text.lower())
