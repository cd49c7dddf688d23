"""The page of measured figures: its tables are those of the committed results, its links and pictures exist."""

import re

import pytest

from bench import docs


def test_the_tables_of_the_page_are_those_of_the_committed_results():
    page = docs.PAGE.read_text(encoding="utf-8")
    assert docs.fill(page, docs.TABLES) == page, "run: python -m bench docs"


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
    "name", ["README.md", "docs/benchmarks.md", "docs/how-it-works.md", "docs/architecture.md"]
)
def test_links_of_the_pages_lead_to_files(name):
    page = docs.PAGE.parents[1] / name
    links = re.findall(r"\]\((?!https?:)([^)#]+)", page.read_text(encoding="utf-8"))
    for link in links:
        assert (page.parent / link).exists(), link
