"""The tables of docs/benchmarks.md, from the committed results, and of docs/settings.md, from the code.

    python -m bench docs [--check]

A table stands between a line `<!-- table: NAME -->` and the next `<!-- end: NAME -->`. In docs/benchmarks.md it is what
the benchmark of that name prints with `--table`. What stands outside of these lines is written by hand and stays.

Takes about 2 s, on two cores.
"""

import argparse
import re
import sys
from collections.abc import Callable, Mapping
from pathlib import Path

from bench import kernel_results, kernels, refinement_table, setting_tables

FOLDER = Path(__file__).parents[1] / "docs"

PAGES: dict[str, dict[str, Callable[[], str]]] = {
    "benchmarks.md": {
        "kernels": lambda: kernels.tables(kernel_results.FOLDER),
        "refinement": lambda: refinement_table.markdown(
            refinement_table.read(refinement_table.FOLDER / refinement_table.FILE)
        ),
    },
    "settings.md": {"settings": setting_tables.markdown},
}
"""How to print each table of each page, by name; a benchmark that commits its results gets an entry."""


def fill(page: str, tables: Mapping[str, Callable[[], str]]) -> str:
    """The page with each table printed anew.

    Args:
        page: Markdown with a pair of marks for each table.
        tables: How to print each table, by name.

    Raises:
        ValueError: If the names between marks are not exactly those of `tables`.
    """
    marked = re.findall(r"^<!-- table: (\w+) -->$(?s:.*?)^<!-- end: \1 -->$", page, re.MULTILINE)
    if sorted(marked) != sorted(tables):
        raise ValueError(
            f"the page has marks for the tables {sorted(marked)}, but there are {sorted(tables)}."
        )
    for name, table in tables.items():
        begin, end = f"<!-- table: {name} -->\n", f"\n<!-- end: {name} -->"
        before, rest = page.split(begin)
        page = before + begin + table() + end + rest.split(end, 1)[1]
    return page


def main(argv: list[str]) -> int:
    """Write the pages; with --check only compare, and return 1 where one is not what would be written."""
    parser = argparse.ArgumentParser(
        prog="python -m bench docs", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--check", action="store_true", help="write nothing; exit code 1 if a page is stale")
    args = parser.parse_args(argv)
    num_stale = 0
    for name, tables in PAGES.items():
        page = FOLDER / name
        before = page.read_text(encoding="utf-8")
        after = fill(before, tables)
        if after != before and not args.check:
            page.write_text(after, encoding="utf-8")
        print(f"{name}: {'its tables were not those of the sources' if after != before else 'up to date'}")
        num_stale += after != before
    return int(num_stale > 0 and args.check)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
