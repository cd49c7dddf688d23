"""Pairs of maps of many kinds of places, with what is wrong with them: other places, mirrored, scaled, changed.

    python -m bench families --draw FOLDER [--seed 0] [--role same] [--clouds] [--family NAME ...]
        [--overview PNG]

Families are those of `voxjax.synthetic.families`. The command writes one sheet a
family: both maps from above and from the side, in the frame of the first, and prints what the pairs are.

Takes about a minute, on two cores.
"""

import argparse
import sys
import time
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bench.family_sheets import draw_overview, draw_sheet
from bench.plots import prepare_plots
from bench.reports import markdown_table
from bench.timing import setting
from bench.worlds import FRAMES, MapPair
from voxjax import InputError, VoxelGrid
from voxjax.synthetic import measure_overlap
from voxjax.synthetic.families import FAMILIES, simulate_family

ROLES: tuple[str, ...] = ("same", "changed", "elsewhere", "mirrored", "scaled", "storey")
"""What a pair is: two maps of one place, with furniture moved in between; or without a true pose: of two places, the
second map mirrored, scaled, or of another storey."""


@dataclass(frozen=True)
class FamilyPair(MapPair):
    """Two maps, what is known of them, and how they came about.

    Attributes:
        family: Name of the family.
        role: One of `ROLES`.
        frame: How the maps' frames lie: "yaw", "tilt" or "so3".
        factor: By how much map b is too large, 1 but for scaled pairs.
    """

    family: str = ""
    role: str = ""
    frame: str = ""
    factor: float = 1.0


def roles_of(family: str) -> tuple[str, ...]:
    """The roles that a family has: storeys of one plan are one of them."""
    return ROLES if family == "storeys" else ROLES[:-1]


def family_pair(family: str, role: str, seed: int, *, has_free_space: bool = True) -> FamilyPair:
    """A labelled pair.

    Of four seeds in a row, pairs of one place overlap by 0.05 to 0.1, by 0.1 to 0.2, and two by 0.2 to 0.8; the others
    by 0.2 to 0.8. Frames take turns more slowly.

    Args:
        family: One of `FAMILIES`.
        role: One of `roles_of(family)`.
        seed: Same seed, same pair; the mirrored and the scaled pair of a seed are made of one pair of one place.
        has_free_space: Whether the maps know free space; without, they are made as clouds.

    Raises:
        InputError: If there is no such family, or if it has no such role.
    """
    if family not in FAMILIES:
        raise InputError(f"family must be one of {', '.join(FAMILIES)}, got {family!r}.")
    if role not in roles_of(family):
        raise InputError(f"role must be one of {', '.join(roles_of(family))} for {family}, got {role!r}.")
    rng = np.random.default_rng([zlib.crc32(family.encode()), seed, 10])
    frame = FRAMES[seed // 4 % len(FRAMES)]
    bins = ((0.05, 0.09), (0.1, 0.2), (0.2, 0.8), (0.2, 0.8))
    low, high = bins[seed % 4 if role == "same" else 3]
    if role == "storey":
        # What little of two storeys meets may have no furniture, and nothing tells them apart then.
        low, high = 0.5, 0.9
    found = simulate_family(
        family,
        seed,
        overlap=float(rng.uniform(low, high)),
        changed={"changed": float(rng.uniform(0.3, 0.8)), "storey": 1.0}.get(role, 0.0),
        elsewhere=role == "elsewhere",
        frame=frame,
        has_free_space=has_free_space,
    )
    a, b = found.grids
    if role == "same" or role == "changed":
        assert found.T_a_b is not None
        overlap = min(measure_overlap(a, b, found.T_a_b), measure_overlap(b, a, np.linalg.inv(found.T_a_b)))
        return FamilyPair(a, b, found.T_a_b, overlap, family, role, frame)
    factor = _draw_factor(rng) if role == "scaled" else 1.0
    if role == "mirrored":
        b = mirrored(b, int(rng.integers(3)))
    elif role == "scaled":
        b = VoxelGrid(b.states, np.asarray(b.origin) * factor, b.voxel_size * factor, b.log_odds)
    return FamilyPair(a, b, None, 0.0, family, role, frame, factor)


def mirrored(grid: VoxelGrid, axis: int) -> VoxelGrid:
    """The map with one axis turned round in its box, as a left-handed export gives it."""
    log_odds = None if grid.log_odds is None else np.flip(np.asarray(grid.log_odds), axis)
    return VoxelGrid(np.flip(np.asarray(grid.states), axis), grid.origin, grid.voxel_size, log_odds)


def _draw_factor(rng: np.random.Generator) -> float:
    """A factor of size: one of six is 2 % off, the others 5 to 10 %."""
    off = 0.02 if rng.random() < 1 / 6 else float(rng.uniform(0.05, 0.1))
    return 1.0 + off * float(rng.choice((-1.0, 1.0)))


def _parse(argv: list[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m bench families", description=__doc__)
    parser.add_argument("--draw", type=Path, required=True, help="folder for the sheets")
    parser.add_argument("--seed", type=int, nargs="+", default=[0], help="seeds; each gives a sheet")
    parser.add_argument("--role", choices=ROLES, default="same")
    parser.add_argument("--clouds", action="store_true", help="maps without free space")
    parser.add_argument("--overview", type=Path, help="picture of one pair a family, of the first seed")
    parser.add_argument("--family", nargs="+", choices=FAMILIES, default=FAMILIES)
    return parser.parse_args(argv)


def main(argv: list[str]) -> int:
    """Draw pairs."""
    args = _parse(argv)
    prepare_plots()
    args.draw.mkdir(parents=True, exist_ok=True)
    print(setting())
    rows, first = [], {}
    for family in args.family:
        for seed in args.seed:
            if args.role not in roles_of(family):
                continue
            start = time.process_time()
            pair = family_pair(family, args.role, seed, has_free_space=not args.clouds)
            took = time.process_time() - start
            draw_sheet(pair, args.draw / f"{family}_{args.role}_{seed}.png")
            rows.append(_row(pair, seed, took))
            first.setdefault(family, pair)
    if args.overview is not None:
        draw_overview(first, args.overview)
    head = ("family", "seed", "frame", "voxel [m]", "occupied", "shape", "overlap", "cpu [s]")
    print(markdown_table(head, rows))
    return 0


def _row(pair: FamilyPair, seed: int, seconds: float) -> list[str]:
    """What a pair is, and how long it took to make."""
    a, b = pair.a, pair.b
    return [
        pair.family,
        str(seed),
        pair.frame,
        f"{a.voxel_size:.3g} / {b.voxel_size:.3g}",
        f"{a.num_occupied} / {b.num_occupied}",
        f"{a.shape} / {b.shape}",
        f"{pair.overlap:.2f}",
        f"{seconds:.2f}",
    ]


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
