"""OctoMap's tree formats, node by node, as their definition has them."""

import struct

import numpy as np


def leaves_of_bt(data: bytes) -> dict:
    """{(key x, y, z, depth): 1 free or 2 occupied} of the bytes after the header."""
    words = [word for (word,) in struct.iter_unpack("<H", data)]
    found: dict = {}

    def read(position: int, key: tuple, depth: int) -> int:
        word, position = words[position], position + 1
        for child in range(8):
            code = word >> (2 * child) & 3
            half = 2 ** (15 - depth)
            low = tuple(k + half * (child >> axis & 1) for axis, k in enumerate(key))
            if code == 3:
                position = read(position, low, depth + 1)
            elif code:
                found[(*low, depth + 1)] = code
        return position

    assert read(0, (0, 0, 0), 0) == len(words)
    return found


def leaves_of_ot(data: bytes) -> dict:
    """{(key x, y, z, depth): log-odds} of the bytes after the header, plain nodes."""
    nodes = list(struct.iter_unpack("<fB", data))
    found: dict = {}

    def read(position: int, key: tuple, depth: int) -> int:
        (value, mask), position = nodes[position], position + 1
        if not mask:
            found[(*key, depth)] = value
        for child in range(8):
            if mask >> child & 1:
                half = 2 ** (15 - depth)
                low = tuple(k + half * (child >> axis & 1) for axis, k in enumerate(key))
                position = read(position, low, depth + 1)
        return position

    assert read(0, (0, 0, 0), 0) == len(nodes)
    return found


def voxels(leaves: dict) -> dict:
    """{voxel counted from the frame's origin: value} of all voxels that the leaves fill."""
    filled = {}
    for (x, y, z, depth), value in leaves.items():
        width = 2 ** (16 - depth)
        for offset in np.ndindex(width, width, width):
            filled[tuple(k - 32768 + o for k, o in zip((x, y, z), offset, strict=True))] = value
    return filled


def pruned(filled: dict) -> dict:
    """{(key, depth): value} of the smallest tree with these voxels: eight equal leaves become one."""
    level = {tuple(k + 32768 for k in voxel): value for voxel, value in filled.items()}
    found = {}
    for depth in range(16, 0, -1):
        width = 2 ** (16 - depth)
        parents: dict = {}
        for key, value in level.items():
            parents.setdefault(tuple(k // (2 * width) * 2 * width for k in key), []).append((key, value))
        level = {}
        for parent, children in parents.items():
            if len(children) == 8 and len({value for _, value in children}) == 1:
                level[parent] = children[0][1]
            else:
                found.update({(*key, depth): value for key, value in children})
    assert not level
    return found


def file_of(leaves: dict, resolution: float = 0.1, *, with_log_odds: bool = False) -> bytes:
    """A .bt (or .ot) file with these leaves, {(key x, y, z, depth): state or log-odds}, wherever they lie."""
    root: dict = {}
    for (*key, depth), value in leaves.items():
        path = [sum((k >> (15 - level) & 1) << axis for axis, k in enumerate(key)) for level in range(depth)]
        node = root
        for child in path[:-1]:
            node = node.setdefault(child, {})
        node[path[-1]] = value
    nodes: list[bytes] = []

    def write(node: dict) -> int:
        """Write a node and all below it; the number of these."""
        word = sum((3 if isinstance(value, dict) else value) << (2 * child) for child, value in node.items())
        nodes.append(struct.pack("<H", word))
        below = [write(node[child]) if isinstance(node[child], dict) else 1 for child in sorted(node)]
        return 1 + sum(below)

    def write_full(node: dict | float) -> int:
        is_inner = isinstance(node, dict)
        # The values of inner nodes are passed over by readers.
        mask = sum(1 << child for child in node) if is_inner else 0
        nodes.append(struct.pack("<fB", 0.0 if is_inner else node, mask))
        return 1 + (sum(write_full(node[child]) for child in sorted(node)) if is_inner else 0)

    size = write_full(root) if with_log_odds else write(root)
    first = b"# Octomap OcTree file" if with_log_odds else b"# Octomap OcTree binary file"
    return first + b"\nid OcTree\nsize %d\nres %g\ndata\n" % (size, resolution) + b"".join(nodes)
