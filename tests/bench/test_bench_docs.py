"""The pages with tables: they are those of the committed results and of the code, links and pictures exist."""

import dataclasses
import re
import tomllib

import pytest

from bench import docs
from voxjax.pipeline.config import Config, config_from


@pytest.mark.parametrize("name", docs.PAGES)
def test_the_tables_of_a_page_are_those_of_its_sources(name):
    page = (docs.FOLDER / name).read_text(encoding="utf-8")
    assert docs.fill(page, docs.PAGES[name]) == page, "run: python -m bench docs"


def test_the_page_of_settings_has_a_row_for_each_key_and_its_sample_is_taken():
    page = (docs.FOLDER / "settings.md").read_text(encoding="utf-8")
    sections = dict(re.findall(r"^## `\[(\w+)\]`\n(.*?)(?=^## |\Z)", page, re.MULTILINE | re.DOTALL))
    assert list(sections) == [field.name for field in dataclasses.fields(Config)]
    for name, section in sections.items():
        keys = re.findall(r"^\| `(\w+)` \| [^|]+ \| [^|]+ \| [^|]+ \|$", section, re.MULTILINE)
        assert keys == [field.name for field in dataclasses.fields(getattr(Config(), name))]
    (sample,) = re.findall(r"```toml\n(.*?)```", page, re.DOTALL)
    changed = config_from(tomllib.loads(sample))
    assert changed.source.thorough
    assert changed.verdict.min_confidence == 0.95


def test_only_what_stands_between_the_marks_is_replaced():
    page = "{}<!-- table: one -->\n{}\n<!-- end: one -->\n{}<!-- table: two -->\n{}\n<!-- end: two -->\n{}"
    before = page.format("head\n", "| old |\n| old |", "prose\n", "| old |", "tail\n")
    after = page.format("head\n", "| new |", "prose\n", "2", "tail\n")
    assert docs.fill(before, {"one": lambda: "| new |", "two": lambda: "2"}) == after


@pytest.mark.parametrize(
    "page", ["", "<!-- table: one -->\n<!-- end: two -->\n", "<!-- table: two -->\n<!-- end: two -->\n"]
)
def test_a_page_without_the_marks_of_a_table_is_an_error(page):
    with pytest.raises(ValueError, match="one"):
        docs.fill(page, {"one": lambda: ""})


@pytest.mark.parametrize(
    "name",
    [
        "README.md",
        "docs/benchmarks.md",
        "docs/settings.md",
        "docs/running.md",
        "docs/how-it-works.md",
        "docs/architecture.md",
    ],
)
def test_links_of_the_pages_lead_to_files(name):
    page = docs.FOLDER.parent / name
    links = re.findall(r"\]\((?!https?:)([^)#]+)", page.read_text(encoding="utf-8"))
    for link in links:
        assert (page.parent / link).exists(), link
