"""`python -m bench NAME ...` runs the benchmark in bench/NAME.py; without a name it lists them."""

import ast
import re
import sys
from importlib import import_module
from pathlib import Path


def benchmarks() -> dict[str, str]:
    """What each benchmark measures, by its name: the files here that have a `main(argv)`, and their first sentence."""
    return {name: " ".join(text.partition("\n\n")[0].split()) for name, text in _docstrings().items()}


def run_times() -> dict[str, str]:
    """How long those benchmarks run that say so, by the sentence "Takes about ..., on two cores." in what they say."""
    found = {}
    for name, text in _docstrings().items():
        match = re.search(r"\bTakes (about .+?), on two cores\.", " ".join(text.split()))
        if match is not None:
            found[name] = match[1]
    return found


def _docstrings() -> dict[str, str]:
    """What each benchmark says of itself, by its name."""
    found = {}
    for path in sorted(Path(__file__).parent.glob("*.py")):
        text = path.read_text(encoding="utf-8")
        if path.stem != "__main__" and "\ndef main(" in text:
            found[path.stem] = ast.get_docstring(ast.parse(text)) or ""
    return found


def main(argv: list[str]) -> int:
    """Run the benchmark that the first argument names."""
    known = benchmarks()
    if argv and argv[0] in known:
        return int(import_module(f"bench.{argv[0]}").main(argv[1:]) or 0)
    is_asked = argv in ([], ["-h"], ["--help"])
    times = run_times()
    lines = [
        f"  {name:<16} {sentence}{f' [{times[name]}]' if name in times else ''}"
        for name, sentence in known.items()
    ]
    ends = "Times in brackets are rough ones, where they are known, of a machine of two cores."
    text = "\n".join(["usage: python -m bench NAME [options]", *lines, ends])
    print(text, file=sys.stdout if is_asked else sys.stderr)
    return 0 if is_asked else 2


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
