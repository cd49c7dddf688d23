"""The contract with users: names, signatures, documentation, README."""

import ast
import importlib
import inspect
import json
import pydoc
import re
import subprocess
import sys
from pathlib import Path

import pytest

import voxjax

ROOT = Path(__file__).parent.parent
SOURCE = ROOT / "src" / "voxjax"
README = (ROOT / "README.md").read_text(encoding="utf-8")
ARCHITECTURE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
HOW_IT_WORKS = (ROOT / "docs" / "how-it-works.md").read_text(encoding="utf-8")
RUNNING = (ROOT / "docs" / "running.md").read_text(encoding="utf-8")

NAMES = [
    "read_map",
    "write_map",
    "VoxelGrid",
    "box_count",
    "classify_voxels",
    "detect_corners",
    "Corners",
    "consistency_graph",
    "maximum_common_subgraph",
    "register",
    "Registration",
    "refine",
    "fuse",
    "merge",
]

POSITIONAL = {
    "read_map": ["path"],
    "write_map": ["path", "grid"],
    "box_count": 1,
    "classify_voxels": 1,
    "detect_corners": 1,
    "consistency_graph": 2,
    "maximum_common_subgraph": 2,
    "register": ["a", "b"],
    "refine": ["a", "b", "T_a_b"],
    "fuse": ["grids", "poses"],
    "merge": ["grids"],
}

OPTIONS = {
    "box_count": {"size"},
    "detect_corners": {"virtual"},
    "maximum_common_subgraph": {"method"},
    "fuse": {"rule"},
    "register": {"preset", "gravity_aligned", "init_guess"},
    "merge": {"preset", "rule", "gravity_aligned"},
}


def _modules():
    """Names of all modules of the package."""
    for path in sorted(SOURCE.rglob("*.py")):
        parts = path.relative_to(SOURCE.parent).with_suffix("").parts
        yield ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def _public(body):
    """Functions and classes without a leading underscore, but for the signatures of overloads."""
    definitions = [node for node in body if isinstance(node, (ast.FunctionDef, ast.ClassDef))]
    is_overload = lambda node: any(
        isinstance(d, ast.Name) and d.id == "overload" for d in node.decorator_list
    )
    return [node for node in definitions if not node.name.startswith("_") and not is_overload(node)]


@pytest.mark.parametrize("name", NAMES)
def test_the_agreed_names_are_there_and_documented(name):
    assert name in voxjax.__all__
    assert name in dir(voxjax)
    assert inspect.getdoc(getattr(voxjax, name))


@pytest.mark.parametrize("name", POSITIONAL)
def test_data_comes_first_and_options_are_keyword_only(name):
    parameters = inspect.signature(getattr(voxjax, name)).parameters.values()
    positional = [p.name for p in parameters if p.kind is not inspect.Parameter.KEYWORD_ONLY]
    expected = POSITIONAL[name]
    assert len(positional) == expected if isinstance(expected, int) else positional == expected
    options = [p for p in parameters if p.kind is inspect.Parameter.KEYWORD_ONLY]
    assert all(p.default is not inspect.Parameter.empty for p in options)
    assert OPTIONS.get(name, set()) <= {p.name for p in options}


def test_packages_are_loaded_when_they_are_first_named():
    code = (
        "import sys, voxjax as vx\n"
        "assert not [name for name in sys.modules if name.startswith('voxjax.') and name != 'voxjax._version']\n"
        "named = [vx.metrics, vx.ops, vx.rigid, vx.io, vx.refinement, vx.pipeline, vx.synthetic, vx.view]\n"
        "assert all(sys.modules[module.__name__] is module for module in named)\n"
        "assert {module.__name__.partition('.')[2] for module in named} <= set(dir(vx))\n"
        "assert vx.Config is vx.pipeline.config.Config\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_unknown_names_are_attribute_errors():
    with pytest.raises(AttributeError, match="no attribute 'mergee'"):
        voxjax.mergee  # noqa: B018


def test_importing_voxjax_imports_neither_jax_nor_numpy():
    code = "import sys, voxjax; sys.exit(sum(name in sys.modules for name in ('jax', 'numpy', 'equinox')))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize("module", list(_modules()))
def test_what_is_public_is_documented_and_annotated(module):
    tree = ast.parse(inspect.getsource(importlib.import_module(module)))
    assert ast.get_docstring(tree), module
    outer = _public(tree.body)
    inner = [node for scope in outer if isinstance(scope, ast.ClassDef) for node in _public(scope.body)]
    for node in [*outer, *inner]:
        assert ast.get_docstring(node), f"{module}.{node.name} has no docstring"
        if isinstance(node, ast.FunctionDef):
            arguments = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
            bare = [a.arg for a in arguments if a.annotation is None and a.arg not in ("self", "cls")]
            assert not bare, f"{module}.{node.name}: no annotation of {bare}"


@pytest.mark.parametrize("face", sorted(SOURCE.rglob("__init__.py")), ids=lambda path: path.parent.name)
def test_what_the_face_of_a_package_names_exists(face):
    package = ".".join(face.parent.relative_to(SOURCE.parent).parts)
    text = ast.get_docstring(ast.parse(face.read_text(encoding="utf-8")))
    assert text, face
    for name in re.findall(r"`([a-zA-Z_][\w.]*)`", text):
        places = [name, f"{package}.{name}", f"{package.rpartition('.')[0]}.{name}", f"voxjax.{name}"]
        assert any(pydoc.locate(place) is not None for place in places), name


def test_files_are_short():
    for path in [*SOURCE.rglob("*.py"), *(ROOT / "tests").rglob("*.py"), *(ROOT / "bench").rglob("*.py")]:
        assert len(path.read_text(encoding="utf-8").splitlines()) <= 400, path


def test_the_package_says_that_it_is_typed():
    assert (SOURCE / "py.typed").is_file()


def test_oracles_import_nothing_of_voxjax():
    for path in (ROOT / "tests" / "oracles").glob("*.py"):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for node in ast.walk(tree):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            assert not any(name.split(".")[0] in ("voxjax", "jax") for name in names), path


def test_the_readme_has_the_two_set_up_commands():
    blocks = re.findall(r"<!-- setup: (\w+) -->\n```sh\n(.*?)```", README, re.DOTALL)
    assert [name for name, _ in blocks] == ["demo", "tests"]
    assert all(len(command.splitlines()) == 1 for _, command in blocks)
    demo, tests = (command.strip() for _, command in blocks)
    assert demo.startswith("python3 -m venv .venv && ")
    assert demo.endswith("voxjax demo")
    assert "pytest" in tests


def test_the_readme_is_short_and_begins_with_the_picture_and_the_commands():
    assert len(README.encode()) <= 8192
    places = [README.index(mark) for mark in ("![", "<!-- setup: demo -->", "<!-- setup: tests -->", "\n## ")]
    assert places == sorted(places)


def test_functions_and_packages_that_the_pages_name_exist():
    names = set(re.findall(r"`voxjax((?:\.\w+)+)`", README + HOW_IT_WORKS))
    assert len(names) > 10
    for name in names:
        found = pydoc.locate(f"voxjax{name}")
        assert callable(found) or inspect.ismodule(found), name


@pytest.mark.parametrize(
    "page", [README, HOW_IT_WORKS, RUNNING], ids=["README.md", "how-it-works.md", "running.md"]
)
def test_the_python_of_the_pages_uses_names_that_exist(page):
    blocks = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    assert blocks
    for block in blocks:
        for node in ast.walk(ast.parse(block)):
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "vx":
                assert node.attr in voxjax.__all__


def test_interfaces_and_files_that_the_architecture_names_exist():
    (block,) = re.findall(r"```python\n(.*?)```", ARCHITECTURE, re.DOTALL)
    names = re.findall(r"\b[a-z_]+(?:\.[a-z_]+)+", re.sub(r"#.*|->.*", "", block))
    assert len(names) > 30
    for name in names:
        assert callable(pydoc.locate(f"voxjax.{name}")), name
    for path in re.findall(r"`((?:\w+/)+\w+\.py)`", ARCHITECTURE):
        assert (SOURCE / path).is_file() or (ROOT / path).is_file(), path


@pytest.mark.parametrize("notebook", sorted((ROOT / "notebooks").glob("*.ipynb")), ids=lambda path: path.stem)
def test_notebooks_keep_what_they_printed_and_drew(notebook):
    cells = [c for c in json.loads(notebook.read_text(encoding="utf-8"))["cells"] if c["cell_type"] == "code"]
    assert [cell["execution_count"] for cell in cells] == list(range(1, len(cells) + 1))
    outputs = [output for cell in cells for output in cell["outputs"]]
    assert sum("image/png" in output.get("data", {}) for output in outputs) >= 2
    for output in outputs:
        assert output["output_type"] != "error"
        assert output.get("name") != "stderr"
        assert not re.search(r"/(home|root|tmp|Users)/", "".join(output.get("text", [])))


def test_the_version_is_that_of_the_changelog():
    changes = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert re.findall(r"^## (\S+)", changes, re.MULTILINE)[0] == voxjax.__version__
    assert f'version = "{voxjax.__version__}"' in (ROOT / "pyproject.toml").read_text(encoding="utf-8")
