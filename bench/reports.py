"""Helpers of several benchmarks: results as JSON files and Markdown tables, names given by comma."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from voxjax._runtime.whole_files import write_file


def write_json(path: Path, contents: Any) -> None:
    """Write plain data as a JSON file, whole or not at all; its folder is made, an earlier file is replaced."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_file(path, (json.dumps(contents, indent=1) + "\n").encode(), force=True)


def rounded(value: Any) -> Any:
    """Plain data with numbers of four significant digits: more is noise, and the files stay small."""
    if isinstance(value, dict):
        return {k: rounded(v) for k, v in value.items()}
    if isinstance(value, list):
        return [rounded(v) for v in value]
    return float(f"{value:.4g}") if isinstance(value, float) else value


def markdown_table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table with a line for each row of cells."""
    lines = [f"| {' | '.join(head)} |", "|" + "---|" * len(head)]
    return "\n".join([*lines, *(f"| {' | '.join(cells)} |" for cells in rows)])


def names_in(text: str) -> list[str]:
    """The names in a text that separates them by commas, each once."""
    return list(dict.fromkeys(name.strip() for name in text.split(",") if name.strip()))
