"""Structures of results as plain data, so that reading one from a file runs nothing and imports nothing.

Known are tuples, lists, dicts with names as keys, None, and named tuples of voxjax, which are looked up among the
modules that are imported already.
"""

import sys
from typing import Any

import jax


def plain_structure(structure: Any) -> Any:
    """The structure of a tree of arrays as lists and names that JSON knows.

    Args:
        structure: As `jax.tree.structure` gives it.

    Raises:
        ValueError: If it holds a type that is not known here.
    """
    return _plain(jax.tree.unflatten(structure, range(structure.num_leaves)))


def structure_of(plain: Any) -> Any:
    """The structure that `plain_structure` wrote down, as `jax.tree.structure` gives it.

    Raises:
        ValueError: If this is no such thing, or names a type that this process has not imported.
    """
    return jax.tree.structure(_example(plain))


def _plain(tree: Any) -> Any:
    kind = type(tree)
    if tree is None:
        return None
    if kind is int:  # leaves are numbered
        return "array"
    # These types themselves are meant: named tuples are tuples too, and would lose their names.
    if kind in (tuple, list):
        return [kind.__name__, *map(_plain, tree)]
    if kind is dict and all(isinstance(name, str) for name in tree):
        return ["dict", *([name, _plain(value)] for name, value in tree.items())]
    if _named_tuple(kind.__module__, kind.__qualname__) is kind:
        return ["named", kind.__module__, kind.__qualname__, *map(_plain, tree)]
    raise ValueError(f"results of the type {kind.__qualname__} cannot be written down.")


def _example(plain: Any) -> Any:
    """A tree of the structure, with a leaf in each place."""
    # Only what is written here is ever made: a file cannot name a type outside of voxjax.
    match plain:
        case None:
            return None
        case "array":
            return 0
        case ["tuple", *parts]:
            return tuple(map(_example, parts))
        case ["list", *parts]:
            return list(map(_example, parts))
        case ["dict", *pairs]:
            return {str(name): _example(part) for name, part in pairs}
        case ["named", str(module), str(name), *parts]:
            kind = _named_tuple(module, name)
            if kind is not None and len(kind._fields) == len(parts):
                return kind(*map(_example, parts))
    raise ValueError("no known structure of results.")


def _named_tuple(module: str, name: str) -> Any:
    """A named tuple that an imported module of voxjax defines; else None."""
    if module.partition(".")[0] != "voxjax":
        return None
    # Only what stands there: asking a package for a name may import the module that defines it.
    kind = vars(sys.modules[module]).get(name) if module in sys.modules else None
    # A module also holds classes that it only imports: a class counts where it is defined, under its one name.
    is_named = isinstance(kind, type) and issubclass(kind, tuple) and hasattr(kind, "_fields")
    return kind if is_named and kind.__module__ == module else None
