"""`python -m bench NAME ...` runs the benchmark in bench/NAME.py; without a name it lists them."""

import ast
import sys
from importlib import import_module
from pathlib import Path


def benchmarks() -> dict[str, str]:
    """What each benchmark measures, by its name: the files here that have a `main(argv)`, and their first sentence."""
    found = {}
    for path in sorted(Path(__file__).parent.glob("*.py")):
        text = path.read_text(encoding="utf-8")
        if path.stem != "__main__" and "\ndef main(" in text:
            first = (ast.get_docstring(ast.parse(text)) or "").partition("\n\n")[0]
            found[path.stem] = " ".join(first.split())
    return found


def main(argv: list[str]) -> int:
    """Run the benchmark that the first argument names."""
    known = benchmarks()
    if argv and argv[0] in known:
        return int(import_module(f"bench.{argv[0]}").main(argv[1:]) or 0)
    is_asked = argv in ([], ["-h"], ["--help"])
    lines = [f"  {name:<16} {sentence}" for name, sentence in known.items()]
    text = "\n".join(["usage: python -m bench NAME [options]", *lines])
    print(text, file=sys.stdout if is_asked else sys.stderr)
    return 0 if is_asked else 2


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
