"""`python -m bench NAME ...` runs the benchmark in bench/NAME.py; without a name it lists them."""

import sys
from importlib import import_module
from pathlib import Path

_NOT_BENCHMARKS = {"__init__", "__main__", "timing", "worlds"}


def names() -> list[str]:
    """Names of the benchmarks: the files here that have a `main(argv)`."""
    files = sorted(Path(__file__).parent.glob("*.py"))
    return [f.stem for f in files if f.stem not in _NOT_BENCHMARKS and "\ndef main(" in f.read_text()]


def main(argv: list[str]) -> int:
    """Run the benchmark that the first argument names."""
    if not argv or argv[0] not in names():
        print(f"usage: python -m bench NAME [options]\nbenchmarks: {', '.join(names())}", file=sys.stderr)
        return 0 if argv in ([], ["-h"], ["--help"]) else 2
    return int(import_module(f"bench.{argv[0]}").main(argv[1:]) or 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
