"""Rules of the house: where a file's test stands, what a package's face says, how long functions are."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
SOURCE = ROOT / "src" / "voxjax"
FILES = sorted(SOURCE.rglob("*.py"))

WITHOUT_BEHAVIOUR = {"__init__", "__main__", "_types", "_results", "_version", "settings"}
"""Names of files that hold re-exports, an entry point, names alone, or defaults (`tests/test_settings.py`)."""

MAX_ARGUMENTS, MAX_LINES = 13, 117


def _name(path):
    return path.relative_to(SOURCE).as_posix()


def _functions(path):
    """All functions and methods of a file."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    return [node for node in ast.walk(tree) if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef))]


def _tests_of(path):
    """Where the test of a file may stand: in the folder of its room, or in one above it."""
    rooms = [part.lstrip("_") for part in path.relative_to(SOURCE).parts[:-1]]
    test = f"test_{path.stem.lstrip('_')}.py"
    return [
        ROOT.joinpath("tests", *rooms[:depth], test) for depth in range(min(1, len(rooms)), len(rooms) + 1)
    ]


def test_each_file_has_a_test_that_bears_its_name():
    untested = {
        _name(path)
        for path in FILES
        if path.stem not in WITHOUT_BEHAVIOUR and not any(test.is_file() for test in _tests_of(path))
    }
    assert not untested


@pytest.mark.parametrize("path", [path for path in FILES if path.name == "__init__.py"], ids=_name)
def test_a_package_s_face_says_in_three_sentences_what_is_in_it(path):
    said = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
    assert len(re.findall(r"[.!?](?=\s|$)", said)) >= 3, said


def test_the_formatter_is_never_switched_off():
    marked = [
        _name(path) for path in FILES if re.search(r"#\s*fmt:\s*(skip|off)", path.read_text(encoding="utf-8"))
    ]
    assert not marked


def test_an_import_inside_a_function_says_why():
    """Such imports hide the order of the layers, unless a comment on the line or above it names the reason."""
    silent = []
    for path in FILES:
        lines = path.read_text(encoding="utf-8").splitlines()
        for function in _functions(path):
            for node in ast.walk(function):
                if (
                    isinstance(node, ast.ImportFrom)
                    and node.level
                    and "#" not in "".join(lines[node.lineno - 2 : node.end_lineno])
                ):
                    silent.append(f"{_name(path)}:{node.lineno}")
    assert not silent


def test_functions_are_short_and_take_few_arguments():
    for path in FILES:
        for node in _functions(path):
            given = node.args
            count = len([*given.posonlyargs, *given.args, *given.kwonlyargs])
            assert count <= MAX_ARGUMENTS, f"{_name(path)}: {node.name} takes {count} arguments"
            assert node.end_lineno is not None
            length = node.end_lineno - node.lineno + 1
            assert length <= MAX_LINES, f"{_name(path)}: {node.name} has {length} lines"
