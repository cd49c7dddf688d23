"""The arguments of the command `voxjax`; imports nothing heavy."""

import argparse
import math
import os
import sys
from collections.abc import Sequence
from typing import NoReturn

from .. import __version__
from .._runtime.memory_sizes import gigabytes_of
from .streams import warn

EXIT_CODES = """exit codes:
  0  done; merge: the map was written
  1  a fault of voxjax itself (run again with --debug for the details)
  2  unusable input or arguments; one line says what to do
  3  merge: no trustworthy overlap, or a map fits none of the others; no map was written
  128 and the number of a signal: stopped by Ctrl-C (130), SIGTERM (143) or SIGHUP (129); no file is left half
     written
"""


class _Parser(argparse.ArgumentParser):
    """Says what is wrong with the arguments in one line instead of printing the whole usage."""

    _given: Sequence[str] = ()

    def parse_known_args(self, args=None, namespace=None):
        """Parse as argparse does, and keep the arguments for a hint in `error`; each subcommand gets its own."""
        self._given = list(sys.argv[1:] if args is None else args)
        return super().parse_known_args(self._given, namespace)

    def error(self, message: str) -> NoReturn:
        warn(f"{message}{_hint(message, self._given)} (see: {self.prog} --help)")
        self.exit(2)


def _hint(message: str, given: Sequence[str]) -> str:
    """What the user may have meant, to stand behind one of argparse's messages; often nothing."""
    for option in ("--init-guess", "--crop", "--shift"):
        if message == f"argument {option}: expected one argument":
            return f"; write {option}=... where the first number is negative"
    last = given[-1] if given else ""
    # A file that is not there cannot be an input, and has the place where other commands take their output.
    if message.endswith("required: -o/--output") and os.path.splitext(last)[1] and not os.path.exists(last):
        return f"; did you mean -o {last}?"
    return ""


def parse(argv: Sequence[str] | None) -> argparse.Namespace:
    """The arguments; the chosen command is in `command`.

    Raises:
        SystemExit: If they are wrong, which has been said in one line, or ask for help or the version.
    """
    parser = build_parser()
    args = parser.parse_args(argv)
    for name, value in vars(args).items():
        if value == []:  # what argparse of Python 3.11 and 3.12 makes of `--name=--`
            parser.error(f"argument --{name.replace('_', '-')}: expected a value, got '--'")
    return args


def build_parser() -> argparse.ArgumentParser:
    """Return the parser of all commands."""
    parser = _Parser(
        prog="voxjax",
        description="Fuse 3D occupancy maps of several robots without knowing how they lie to each other.",
        epilog=EXIT_CODES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"voxjax {__version__}")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    _add_merge(commands)
    _add_info(commands)
    _add_convert(commands)
    _add_corners(commands)
    _add_render(commands)
    _add_demo(commands)
    return parser


def _add_command(commands, name: str, summary: str, **options) -> argparse.ArgumentParser:
    """A subcommand with the options that all of them have."""
    command = commands.add_parser(
        name,
        help=summary,
        description=summary,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        **options,
    )
    command.add_argument("--debug", action="store_true", help="show the traceback of a fault")
    return command


def _add_quiet(command: argparse.ArgumentParser) -> None:
    command.add_argument("-q", "--quiet", action="store_true", help="show no progress")


def _add_force(command: argparse.ArgumentParser) -> None:
    command.add_argument("--force", action="store_true", help="overwrite output files that exist")


def _add_reading(command: argparse.ArgumentParser) -> None:
    """How maps are read."""
    command.add_argument(
        "--voxel-size",
        type=positive_number,
        metavar="M",
        help="edge length of a voxel [m], which maps are brought to; if not given, maps keep theirs, and that of "
        "clouds (.ply) is estimated from the spacing of their points and printed",
    )
    command.add_argument(
        "--crop",
        type=box,
        metavar="X0,Y0,Z0,X1,Y1,Z1",
        help="keep what lies in this box [m] of each map's own frame, one box for all maps that are given: cut single "
        "maps before, with convert --crop; --crop=... where the first is negative",
    )
    command.add_argument(
        "--drop-isolated",
        action="store_true",
        help="leave out stray pieces that lie farther from the rest of a map than that is wide",
    )
    command.add_argument(
        "--strict",
        action="store_true",
        help="refuse clouds with NaN, infinite or duplicate points; without it, points that are NaN or infinite are "
        "left out, and their number is printed",
    )


def _add_preset(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--preset",
        choices=("default", "paper"),
        default="default",
        help="'paper' is the published method alone",
    )


def _add_merge(commands) -> None:
    command = _add_command(
        commands, "merge", "Find how the maps lie to each other and fuse them into one.", epilog=EXIT_CODES
    )
    command.add_argument(
        "maps", nargs="+", metavar="MAP", help="two or more maps: .bt, .ot, .npz, .zarr, .ply"
    )
    command.add_argument(
        "-o", "--output", required=True, metavar="OUT", help="the fused map: .bt, .ot, .npz, .zarr, .ply"
    )
    command.add_argument(
        "--report",
        metavar="R.json",
        help="poses, verdicts, numbers and times as JSON; corners that no pair needed are found for it, which can take "
        "as long as the registration",
    )
    command.add_argument("--picture", metavar="P.png", help="all maps and the fused one as a picture")
    command.add_argument(
        "--html", metavar="V.html", help="a page to turn the fused map around in (voxjax[view])"
    )
    _add_reading(command)
    command.add_argument(
        "--gravity-aligned", action="store_true", help="the z axes of all maps point up: only yaw is unknown"
    )
    command.add_argument(
        "--allow-changes",
        action="store_true",
        help="merge maps between which things were moved; another storey of one plan looks like that, too",
    )
    _add_preset(command)
    command.add_argument(
        "--rule",
        choices=("paper", "keep", "log_odds"),
        help="how states are combined; chosen by what the maps hold if not given",
    )
    command.add_argument(
        "--memory",
        type=memory_size,
        metavar="SIZE",
        help="memory that the run may take, such as 2G or 500M, instead of what the machine has left or VOXJAX_MEMORY "
        "says; work that needs more is refused. A fused map in a store (.zarr) is written window by window",
    )
    command.add_argument(
        "--processes",
        type=process_count,
        default=1,
        metavar="N",
        help="with a fused map in a store (.zarr), how many processes share its fusion; worth it for large maps alone",
    )
    command.add_argument(
        "--config", metavar="F.toml", help="settings of the stages; their keys: docs/settings.md"
    )
    command.add_argument(
        "--init-guess",
        metavar="T",
        help="with two maps, a pose to try as well, mapping points of the second into the first: 16 numbers "
        "(4x4, row by row) or 7 (x y z qx qy qz qw), in quotes, or the name of a text file that holds them; "
        "--init-guess=... where the first is negative",
    )
    command.add_argument(
        "--allow-partial", action="store_true", help="write the map also when some of the maps fit none"
    )
    _add_force(command)
    _add_quiet(command)


def _add_info(commands) -> None:
    command = _add_command(commands, "info", "Counts, extents, voxel size, share of each state, memory.")
    command.add_argument("maps", nargs="+", metavar="MAP")
    _add_reading(command)
    command.add_argument("--json", action="store_true", help="as JSON")


def _add_convert(commands) -> None:
    command = _add_command(
        commands, "convert", "Any readable format to any writable one, by the files' endings."
    )
    command.add_argument("input", metavar="IN")
    command.add_argument("output", metavar="OUT")
    command.add_argument(
        "--scale",
        type=positive_number,
        default=1.0,
        metavar="F",
        help="multiply all positions and lengths by F: 0.001 for a map in millimetres, 0.3048 for one in feet. --crop "
        "is in the frame of IN, --voxel-size belongs to OUT",
    )
    command.add_argument(
        "--shift",
        type=three_numbers,
        default=(0.0, 0.0, 0.0),
        metavar="X,Y,Z",
        help="move the map by that much [m], after --scale; --shift=... where the first is negative",
    )
    _add_reading(command)
    _add_force(command)


def _add_corners(commands) -> None:
    command = _add_command(commands, "corners", "The detected corners of a map with their normals, as CSV.")
    command.add_argument("map", metavar="MAP")
    command.add_argument("-o", "--output", required=True, metavar="C.csv")
    command.add_argument(
        "--virtual", action="store_true", help="also corners that are hidden by other things"
    )
    _add_preset(command)
    _add_reading(command)
    _add_force(command)


def _add_render(commands) -> None:
    command = _add_command(commands, "render", "Maps as a picture: isometric and from above.")
    command.add_argument("maps", nargs="+", metavar="MAP")
    command.add_argument("-o", "--output", required=True, metavar="P.png")
    command.add_argument("--keep-ceiling", action="store_true", help="do not cut closed buildings open")
    _add_reading(command)
    _add_force(command)


def _add_demo(commands) -> None:
    command = _add_command(
        commands,
        "demo",
        "A generated building, scanned by three robots, merged, checked against the truth, drawn.",
    )
    command.add_argument(
        "--out", default="demo", metavar="DIR", help="folder for the files (made if missing)"
    )
    command.add_argument("--seed", type=whole_number, default=7, metavar="N", help="which building")
    _add_force(command)
    _add_quiet(command)


def positive_number(text: str) -> float:
    """A finite number above zero."""
    try:
        number = float(text)
    except ValueError:
        number = 0.0
    # Said as what must hold, because nan, which `float` takes, compares false with everything.
    if not 0.0 < number < float("inf"):
        raise argparse.ArgumentTypeError(f"must be a number above 0, got {text!r}")
    return number


def memory_size(text: str) -> float:
    """Gigabytes, of a number with or without a unit."""
    gigabytes = gigabytes_of(text)
    if gigabytes is None:
        raise argparse.ArgumentTypeError(f"must be a size such as 2G or 500M, got {text!r}")
    return gigabytes


def box(text: str) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Six finite numbers with commas between them: the lowest corner of a box, and the highest."""
    try:
        numbers = tuple(float(word) for word in text.split(","))
    except ValueError:
        numbers = ()
    sides = list(zip(numbers[:3], numbers[3:], strict=False))
    # Said as what must hold, as in `positive_number`.
    if len(numbers) != 6 or not all(-math.inf < low < high < math.inf for low, high in sides):
        raise argparse.ArgumentTypeError(
            f"must be six numbers x0,y0,z0,x1,y1,z1 of which the first three lie below the last three, got {text!r}"
        )
    return numbers[:3], numbers[3:]


def three_numbers(text: str) -> tuple[float, ...]:
    """Three finite numbers with commas between them."""
    try:
        numbers = tuple(float(word) for word in text.split(","))
    except ValueError:
        numbers = ()
    if len(numbers) != 3 or not all(math.isfinite(number) for number in numbers):
        raise argparse.ArgumentTypeError(f"must be three numbers x,y,z, got {text!r}")
    return numbers


def process_count(text: str) -> int:
    """A whole number from 1 on."""
    try:
        number = int(text)
    except ValueError:
        number = 0
    if number < 1:
        raise argparse.ArgumentTypeError(f"must be a whole number, 1 or more, got {text!r}")
    return number


def whole_number(text: str) -> int:
    """A whole number from 0 on that fits 64 bits."""
    try:
        number = int(text)
    except ValueError:
        number = -1
    if not 0 <= number < 2**63:
        raise argparse.ArgumentTypeError(f"must be a whole number from 0 to 2**63 - 1, got {text!r}")
    return number
