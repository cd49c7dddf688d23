"""Exact clique search on association graphs of buildings: ours beside cliquematch and networkx, where installed.

    python -m bench cliques [--seeds 0 1 2] [--rounds 5] [--no-networkx]

Two sets of points in a building-like box, 82 and 88 of them, of which some are the same points seen twice; all pairs
are associations, so the graph has 7,216 nodes. The box is scaled until the graph has the edges that are asked for.
`plain`: 40 true points, noise 3 cm, distance tolerance 0.15 m, 480,256 edges. `hard`: 12 true points, 0.3 m, 948,064
edges. Building the graph (distances of all pairs of associations) and searching it are timed apart. Peers get the same
graph: networkx as a graph object, cliquematch as its own, both made outside their search time.
"""

import argparse
import importlib.util
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from bench.reports import write_json
from bench.timing import round_count, setting
from voxjax.matching.associations import all_associations
from voxjax.matching.cliques.maximum import maximum_clique
from voxjax.matching.consistency import pairwise_consistency


class GraphClass(NamedTuple):
    """A kind of association graph.

    Attributes:
        num_true: Points that both sets hold.
        noise: Standard deviation of a coordinate of the second sighting [m].
        tolerance: Largest difference of the distances of consistent associations [m].
        num_edges: Number of edges that the graph is scaled to.
    """

    num_true: int
    noise: float
    tolerance: float
    num_edges: int


CLASSES = {"plain": GraphClass(40, 0.03, 0.15, 480_256), "hard": GraphClass(12, 0.03, 0.3, 948_064)}


def draw_points(seed: int, kind: GraphClass, scale: float) -> tuple[np.ndarray, np.ndarray]:
    """Both sets of points [m]; the second in another order and frame."""
    num_a, num_b = 82, 88
    box = np.asarray([20.0, 15.0, 3.0]) * scale
    rng = np.random.default_rng(seed)
    a = rng.uniform(size=(num_a, 3)) * box
    again = a[: kind.num_true] + rng.normal(0.0, kind.noise, (kind.num_true, 3))
    b = np.concatenate([again, rng.uniform(size=(num_b - kind.num_true, 3)) * box])
    yaw = rng.uniform(-np.pi, np.pi)
    # Only distances count, so neither order nor frame may help a search.
    turn = np.asarray([[np.cos(yaw), -np.sin(yaw), 0.0], [np.sin(yaw), np.cos(yaw), 0.0], [0.0, 0.0, 1.0]])
    return a, (b @ turn.T + [3.0, -7.0, 1.0])[rng.permutation(num_b)]


def build(points: tuple[np.ndarray, np.ndarray], kind: GraphClass) -> np.ndarray:
    """The graph as a Boolean matrix."""
    pairs = all_associations(*(np.ones(len(p), bool) for p in points))
    adjacency = pairwise_consistency(*points, pairs, distance_tolerance=kind.tolerance)
    return adjacency[: len(pairs), : len(pairs)]


def make_graph(seed: int, kind: GraphClass) -> tuple[tuple[np.ndarray, np.ndarray], np.ndarray]:
    """Points and graph with the wanted number of edges, to half a per cent: a larger box has fewer."""
    low, high = 0.4, 2.5
    for _ in range(20):
        scale = 0.5 * (low + high)
        points = draw_points(seed, kind, scale)
        adjacency = build(points, kind)
        excess = np.count_nonzero(adjacency) // 2 / kind.num_edges - 1.0
        if abs(excess) < 0.005:
            break
        low, high = (scale, high) if excess > 0 else (low, scale)
    return points, adjacency


def best_of(rounds: int, call: Callable[[], Any]) -> tuple[Any, float, float]:
    """Result, median and smallest seconds of some calls."""
    seconds = []
    for _ in range(rounds):
        start = time.perf_counter()
        result = call()
        seconds.append(time.perf_counter() - start)
    return result, float(np.median(seconds)), min(seconds)


def measure_ours(
    points: tuple[np.ndarray, np.ndarray], kind: GraphClass, seed: int, rounds: int
) -> list[dict]:
    """Rows of voxjax: the clique, and all its ties."""
    adjacency, build_s, _ = best_of(rounds, lambda: build(points, kind))
    found, median, least = best_of(rounds, lambda: maximum_clique(adjacency))
    rows = [_row("voxjax", len(found.members), build_s, median, least, found.completed)]
    found, median, least = best_of(rounds, lambda: maximum_clique(adjacency, all_maximum=True))
    rows.append(
        _row(
            f"voxjax, {len(found.ties)} ties", len(found.members), build_s, median, least, found.has_all_ties
        )
    )
    return rows


def measure_peers(points: tuple[np.ndarray, np.ndarray], kind: GraphClass, with_networkx: bool) -> list[dict]:
    """Rows of the peers that can be imported."""
    adjacency, rows = build(points, kind), []
    if importlib.util.find_spec("cliquematch"):
        import cliquematch

        graphs: Any = cliquematch.Graph
        start = time.perf_counter()
        of_matrix: Any = graphs.from_matrix(np.ascontiguousarray(adjacency))
        build_s = time.perf_counter() - start
        # It keeps its answer in the graph, so that a second call would time nothing.
        members, median, least = best_of(
            1, lambda: of_matrix.get_max_clique(use_heuristic=True, use_dfs=True)
        )
        rows.append(_row("cliquematch", len(members), build_s, median, least, True))
    if with_networkx and importlib.util.find_spec("networkx"):
        import networkx

        start = time.perf_counter()
        theirs = networkx.from_edgelist(np.argwhere(np.triu(adjacency)).tolist())
        build_s = time.perf_counter() - start
        largest: Any = networkx.max_weight_clique  # its annotations know no `None` for equal weights
        found, median, least = best_of(1, lambda: largest(theirs, weight=None))
        rows.append(_row("networkx", found[1], build_s, median, least, True))
    return rows


def _row(solver: str, size: int, build_s: float, median: float, least: float, exact: bool) -> dict:
    """One line of the table."""
    return {
        "solver": solver,
        "clique": size,
        "build_s": build_s,
        "search_s": median,
        "least_s": least,
        "exact": exact,
    }


def main(argv: list[str]) -> int:
    """Print the table, write it as JSON."""
    parser = argparse.ArgumentParser(
        prog="bench cliques", description="Exact clique search on association graphs."
    )
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2])
    parser.add_argument(
        "--rounds", type=round_count, default=5, help="timed calls of voxjax; peers are called once"
    )
    parser.add_argument("--no-networkx", action="store_true", help="it takes seconds a graph")
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "out" / "cliques.json")
    options = parser.parse_args(argv)
    print(setting(), end="\n\n", flush=True)
    missing = [name for name in ("cliquematch", "networkx") if not importlib.util.find_spec(name)]
    if missing:
        print(f"not installed, left out: {', '.join(missing)}\n")
    print("| graph | seed | nodes | edges | solver | clique | build s | search s (median) | least | exact |")
    print("|---|---|---|---|---|---|---|---|---|---|")
    results = []
    for name, kind in CLASSES.items():
        for seed in options.seeds:
            points, adjacency = make_graph(seed, kind)
            nodes, edges = len(adjacency), int(np.count_nonzero(adjacency)) // 2
            rows = measure_ours(points, kind, seed, options.rounds)
            rows += measure_peers(points, kind, not options.no_networkx)
            for row in rows:
                results.append({"graph": name, "seed": seed, "nodes": nodes, "edges": edges, **row})
                print(
                    f"| {name} | {seed} | {nodes} | {edges} | {row['solver']} | {row['clique']} | {row['build_s']:.2f} "
                    f"| {row['search_s']:.3f} | {row['least_s']:.3f} | {'yes' if row['exact'] else 'no'} |",
                    flush=True,
                )
    write_json(options.out, {"setting": setting(), "rows": results})
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
