"""Entry point: runs one command and turns what happens into an exit code."""

import gc
import os
import sys
import traceback
from collections.abc import Sequence
from importlib import import_module
from types import ModuleType

from .parser import build_parser

ISSUES = "https://github.com/voxjax/voxjax/issues"


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line.

    Args:
        argv: Arguments without the program's name; None takes those of the process.

    Returns:
        0 done, 1 fault of voxjax, 2 unusable input or arguments, 3 nothing trustworthy to write.
    """
    try:
        args = build_parser().parse_args(argv)
    except SystemExit as stop:  # --help, --version, or wrong arguments that have been explained
        return int(stop.code or 0)
    try:
        return _load(args.command, is_own_process=argv is None).run(args)
    except KeyboardInterrupt:
        print("voxjax: stopped.", file=sys.stderr)
        return 130
    except BrokenPipeError:  # the reader of our output has gone, as in `voxjax info map.bt | head -1`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except Exception as error:
        return _explain(error, debug=args.debug)


def _load(command: str, *, is_own_process: bool) -> ModuleType:
    """Import the module of a command.

    Imports make some 150,000 objects and hardly any garbage; looking for it took a tenth of the time up to the first
    result. In a process of its own what was imported stays until the end, and later searches leave it out.
    """
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        return import_module(f".{command}", __package__)
    finally:
        if is_own_process:
            gc.freeze()
        if was_enabled:
            gc.enable()


def _explain(error: Exception, *, debug: bool) -> int:
    """Say in one line what went wrong, and return the exit code."""
    from .._checks import InputError

    if isinstance(error, InputError):
        print(f"voxjax: {' '.join(str(error).split())}", file=sys.stderr)
        return 2
    if debug:
        traceback.print_exception(error)
    summary = " ".join(f"{type(error).__name__}: {error}".split())[:300]
    advice = f"please report it at {ISSUES}" + ("." if debug else ", with what --debug prints.")
    print(f"voxjax: internal fault ({summary}); {advice}", file=sys.stderr)
    return 1


if __name__ == "__main__":
    sys.exit(main())
