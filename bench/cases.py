"""Cases of the registration benchmark: folders of maps, the same maps re-framed or coarsened, generated pairs.

A case is light; its maps are read or made when it is loaded.
"""

import json
import os
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

import voxjax as vx
from bench.worlds import MapPair, pair_case
from voxjax.io.ply import decode_ply
from voxjax.metrics import pose_error

TURNS = ("any", "upright", "cube")
"""How maps are re-framed: turned anyhow, about their vertical axis alone, or by right angles without resampling."""


@dataclass(frozen=True)
class Case:
    """One pair of maps, and when a pose counts as right.

    Attributes:
        name: Folder of the source and name of the pair; the name of a variant follows after a "~".
        source: "sim", "real", "re-framed", "half" or "generated".
        kind: "pair" (one place), "hotel" (equal rooms) or "none" (different buildings).
        rotation: "yaw", "tilt" or "so3": how the frames of the maps lie to each other.
        degrees: Largest error of the rotation of a right pose.
        metres: Largest error at map b's centroid.
        load: Function that gives the maps and the truth.
        options: Options that were drawn for a generated pair.
    """

    name: str
    source: str
    kind: str
    rotation: str
    degrees: float
    metres: float
    load: Callable[[], MapPair]
    options: dict[str, Any]

    def judge(
        self, poses: Sequence[np.ndarray], T_a_b: np.ndarray | None, centroid: np.ndarray
    ) -> dict[str, Any]:
        """Hold poses, best first, against the truth.

        Args:
            poses: (4, 4) each.
            T_a_b: The truth, or None.
            centroid: Centroid of map b's occupied voxels [m], where errors of position are measured.

        Returns:
            "right" (of the first pose; None without a truth), "rank" of the first right pose from 0, or None,
            "degrees" and "metres" of the first pose.
        """
        if T_a_b is None:
            return {"right": None, "rank": None, "degrees": None, "metres": None}
        errors = [pose_error(pose, T_a_b, centroid) for pose in poses]
        good = [e.degrees <= self.degrees and e.metres <= self.metres for e in errors]
        first = errors[0] if errors else None
        return {
            "right": bool(good and good[0]),
            "rank": good.index(True) if True in good else None,
            "degrees": first.degrees if first else None,
            "metres": first.metres if first else None,
        }


class MapFile(NamedTuple):
    """A map on disk; clouds are voxelised at `voxel_size` [m]."""

    path: Path
    voxel_size: float

    def read(self, move: np.ndarray | None = None) -> vx.VoxelGrid:
        """The map, moved by a rigid (4, 4) transform before it is voxelised again."""
        if self.path.suffix != ".ply":
            grid = vx.read_map(self.path)
            return grid if move is None else grid.transformed(move)
        if move is None:
            return vx.read_map(self.path, voxel_size=self.voxel_size)
        points = np.asarray(decode_ply(self.path.read_bytes()), np.float64)
        return vx.VoxelGrid.from_points(points @ move[:3, :3].T + move[:3, 3], voxel_size=self.voxel_size)


def folder_cases(
    root: Path,
    sources: Sequence[str],
    *,
    num_reframings: int = 0,
    turns: str = "any",
    with_half: bool = False,
    seed: int = 0,
) -> list[Case]:
    """Pairs with a truth file below `root`, and variants of those in its folder "real".

    Args:
        root: Folder of the folders of maps.
        sources: Folders to take.
        num_reframings: Variants of each real pair with both maps turned and shifted at random; each truth's tolerances
            stay.
        turns: How they are turned, one of `TURNS`.
        with_half: Whether to add each real pair at twice the voxel size; each truth's tolerances stay.
        seed: Seed of the random motions.
    """
    cases = []
    for source in sources:
        for path in sorted((root / source).glob("*/truth.json")):
            truth = json.loads(path.read_text())
            if truth["kind"] == "team":
                continue
            files = [_map_file(path.parent, name, truth["resolution"]) for name in "ab"]
            case = _folder_case(f"{source}/{path.parent.name}", source, truth, files)
            cases.append(case)
            if source == "real":
                cases += [_reframed(case, files, number, seed, turns) for number in range(num_reframings)]
                cases += [_half(case)] * with_half
    return cases


def generated_cases(count: int, seed: int) -> list[Case]:
    """The first generated pairs of a seed; see `worlds.pair_case`."""
    pairs = (pair_case(seed, number) for number in range(count))
    return [
        Case(p.name, "generated", p.kind, p.frame, *_tolerances(p.voxel_size), p.make, p.options)
        for p in pairs
    ]


def maps_folder(given: Path | None, *, is_wanted: bool = True) -> Path | None:
    """The folder of test maps: the given one, VOXJAX_MAPS or ../shared/maps.

    Args:
        given: Folder that the user named, or None.
        is_wanted: Whether the benchmark reads maps at all.

    Returns:
        The folder; None where no maps are wanted, or where nobody named a folder and there is none, which is printed.

    Raises:
        vx.InputError: If the folder that the user named does not exist.
    """
    folder = given or Path(os.environ.get("VOXJAX_MAPS", "../shared/maps"))
    if not is_wanted or folder.is_dir():
        return folder if is_wanted else None
    if given is not None:
        raise vx.InputError(f"--maps {given} is no folder; name the folder of test maps.")
    print(f"no folder {folder}: generated pairs only; name test maps with --maps")
    return None


def motion_about(
    points: np.ndarray,
    rng: np.random.Generator,
    *,
    max_shift: float = 15.0,
    turns: str = "any",
    voxel_size: float = 0.0,
) -> np.ndarray:
    """A random (4, 4) motion: a turn about the centroid of points, then a shift.

    Args:
        points: (n, 3) [m].
        rng: Source of the motion.
        max_shift: Largest shift along each axis [m].
        turns: One of `TURNS`.
        voxel_size: Turns of the cube move the centroid by whole voxels of this edge [m], so that nothing is resampled.
    """
    centroid = points.mean(axis=0, dtype=np.float64)
    T = np.eye(4)
    if turns == "cube":
        group = Rotation.create_group("O").as_matrix()
        T[:3, :3] = np.round(group[rng.integers(len(group))])
    elif turns == "upright":
        T[:3, :3] = Rotation.from_euler("z", rng.uniform(0.0, 360.0), degrees=True).as_matrix()
    else:
        T[:3, :3] = Rotation.random(rng=rng).as_matrix()
    T[:3, 3] = centroid + rng.uniform(-max_shift, max_shift, 3) - T[:3, :3] @ centroid
    if turns == "cube":
        T[:3, 3] = np.round(T[:3, 3] / voxel_size) * voxel_size
    return T


def moved_truth(T_a_b: np.ndarray, move_a: np.ndarray, move_b: np.ndarray) -> np.ndarray:
    """The true pose after both maps were moved: `T_a_b` (4, 4) between the moved frames."""
    return move_a @ T_a_b @ np.linalg.inv(move_b)


def rotation_kind(T_a_b: np.ndarray | None) -> str:
    """Return how far a pose leans away from a turn about z: "yaw" up to 1 degree, "tilt" up to 20, else "so3"."""
    if T_a_b is None:
        return "so3"
    lean = np.degrees(np.arccos(np.clip(T_a_b[2, 2], -1.0, 1.0)))
    return "yaw" if lean <= 1.0 else "tilt" if lean <= 20.0 else "so3"


def _map_file(folder: Path, name: str, voxel_size: float) -> MapFile:
    paths = [folder / f"{name}{ending}" for ending in (".bt", ".ply")]
    found = [path for path in paths if path.exists()]
    if not found:
        raise vx.InputError(f"{folder} has a truth.json but neither {name}.bt nor {name}.ply; add the map.")
    return MapFile(found[0], voxel_size)


def _tolerances(voxel_size: float) -> tuple[float, float]:
    """Degrees and metres for maps whose truth files name none."""
    return 3.0, max(0.4, 3 * voxel_size)


def _folder_case(name: str, source: str, truth: dict, files: list[MapFile]) -> Case:
    T_a_b = None if truth.get("T_a_b") is None else np.asarray(truth["T_a_b"], np.float64)
    overlaps = [truth.get("overlap_b_in_a"), truth.get("overlap_a_in_b")]
    overlap = min((value for value in overlaps if value is not None), default=0.0)
    degrees, metres = _tolerances(truth["resolution"])
    return Case(
        name=name,
        source=source,
        kind=truth["kind"],
        rotation=truth.get("mode") or rotation_kind(T_a_b),
        degrees=truth.get("rot_tol_deg", degrees),
        metres=truth.get("trans_tol_m", metres),
        load=lambda: MapPair(files[0].read(), files[1].read(), T_a_b, overlap),
        options={},
    )


def _reframed(case: Case, files: list[MapFile], number: int, seed: int, turns: str) -> Case:
    def load() -> MapPair:
        pair = case.load()
        # The name tells the cases apart whatever others are run with them.
        rng = np.random.default_rng([seed, number, zlib.crc32(case.name.encode())])
        moves = [
            motion_about(grid.occupied_points(), rng, turns=turns, voxel_size=grid.voxel_size)
            for grid in (pair.a, pair.b)
        ]
        if turns == "cube":  # points on the faces of voxels would change sides
            a, b = (grid.transformed(move) for grid, move in zip((pair.a, pair.b), moves, strict=True))
        else:
            a, b = (file.read(move) for file, move in zip(files, moves, strict=True))
        T_a_b = None if pair.T_a_b is None else moved_truth(pair.T_a_b, *moves)
        return MapPair(a, b, T_a_b, pair.overlap)

    name = f"{case.name}~{'frame' if turns == 'any' else turns}_{seed}_{number}"
    rotation = case.rotation if turns == "upright" else "so3"
    return replace(case, name=name, source="re-framed", rotation=rotation, load=load)


def _half(case: Case) -> Case:
    def load() -> MapPair:
        pair = case.load()
        a, b = (grid.with_voxel_size(2 * grid.voxel_size) for grid in (pair.a, pair.b))
        return replace(pair, a=a, b=b)

    return replace(case, name=f"{case.name}~half", source="half", load=load)
