"""The tables of docs/settings.md: every key of `Config` with its default, its range and what it does."""

import dataclasses
import inspect
import re

from voxjax._settings import Settings
from voxjax.pipeline.config import Config


def markdown() -> str:
    """A heading, what the group is for, and a table of its keys, for each group of `Config`."""
    return "\n\n".join(_section(getattr(Config(), field.name)) for field in dataclasses.fields(Config))


def _section(group: Settings) -> str:
    """One group; its sentences are those of its docstring."""
    about, _, attributes = (inspect.getdoc(group) or "").partition("\nAttributes:\n")
    entries = re.findall(r"^    (\w+): (.*(?:\n {8,}.*)*)", attributes, re.MULTILINE)
    said = {key: " ".join(sentence.split()) for key, sentence in entries}
    rows = [
        f"| `{field.name}` | {_value(getattr(group, field.name))} | {_range(field)} | {said[field.name]} |"
        for field in dataclasses.fields(group)
    ]
    head = [
        f"## `[{group.table}]`",
        "",
        about.strip(),
        "",
        "| key | default | range | meaning |",
        "|---|---|---|---|",
    ]
    return "\n".join([*head, *rows])


def _value(value: bool | int | float) -> str:
    """A value as TOML writes it."""
    return str(value).lower() if isinstance(value, bool) else f"{value:_}"


def _range(field: dataclasses.Field) -> str:
    """Values that a key takes; its ends have the type of the key."""
    if isinstance(field.default, bool):
        return "true, false"
    low, high, above = (field.metadata[name] for name in ("low", "high", "above"))
    least = f"above {_value(above)}," if low is None else _value(low)
    return f"{least} to {_value(high)}"
