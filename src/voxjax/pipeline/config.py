"""Settings of the stages: one frozen group for each, all defaults in one place, readable from a TOML table."""

import dataclasses
from collections.abc import Mapping
from typing import Any

from .._checks import InputError
from ..registration.judging.settings import LeaderConfig, VerdictConfig


@dataclasses.dataclass(frozen=True)
class MapConfig:
    """How a map is prepared.

    Attributes:
        voxel_size: Working voxel size [m]; 0 takes the coarser map's, and brings maps finer than 0.075 m to about
            0.1 m: the evidence bounds are lengths that belong to the accuracy of maps, not numbers of voxels.
        infer_free_space: Take what surfaces enclose for free in a map that records no free space
            (`maps/inferred_space.py`). Fusion never uses it.
    """

    voxel_size: float = 0.0
    infer_free_space: bool = True


@dataclasses.dataclass(frozen=True)
class SourceConfig:
    """Which hypotheses are proposed, and how many.

    Attributes:
        corners: Poses from single corner frames, observed and virtual.
        subgraph: Poses from the maximum common subgraph of the corners (sections IV.B-C).
        descriptors: Poses from cliques of matched local descriptors.
        exhaustive: Every translation of the rotations that the normals allow.
        distance_tolerance: D of equation (4) [voxel].
        max_corners: Corners of each map that take part in the subgraph.
        max_rotations: Rotations that are searched exhaustively.
        num_peaks: Translations kept for each rotation.
        max_descriptor_poses: Distinct cliques of descriptors.
        thorough: Ask all sources, also where the exhaustive search alone decides.
    """

    corners: bool = True
    subgraph: bool = True
    descriptors: bool = True
    exhaustive: bool = True
    distance_tolerance: float = 2.0
    max_corners: int = 64
    max_rotations: int = 48
    num_peaks: int = 24
    max_descriptor_poses: int = 16
    thorough: bool = False


@dataclasses.dataclass(frozen=True)
class Config:
    """All settings of `voxjax.register`."""

    map: MapConfig = dataclasses.field(default_factory=MapConfig)
    source: SourceConfig = dataclasses.field(default_factory=SourceConfig)
    leader: LeaderConfig = dataclasses.field(default_factory=LeaderConfig)
    verdict: VerdictConfig = dataclasses.field(default_factory=VerdictConfig)


def config_from(settings: "Config | Mapping[str, Any] | None") -> Config:
    """The settings as a `Config`.

    Args:
        settings: None for the defaults, a `Config`, or nested tables such as `{"source": {"descriptors": False}}`
            (what a TOML file gives).

    Raises:
        InputError: If a table or key does not exist, or a value has the wrong type.
    """
    if settings is None:
        return Config()
    if isinstance(settings, Config):
        return settings
    groups = {field.name: field for field in dataclasses.fields(Config)}
    changed = {}
    for name, table in settings.items():
        if name not in groups:
            raise InputError(f"config has no table {name!r}; it has {', '.join(groups)}.")
        if not isinstance(table, Mapping):
            raise InputError(f"config table {name!r} must hold keys and values, got {table!r}.")
        changed[name] = _changed(name, getattr(Config(), name), table)
    return Config(**changed)


def _changed(name: str, group: Any, table: Mapping[str, Any]) -> Any:
    known = {field.name: getattr(group, field.name) for field in dataclasses.fields(group)}
    values = {}
    for key, value in table.items():
        if key not in known:
            raise InputError(f"config table {name!r} has no key {key!r}; it has {', '.join(known)}.")
        expected = type(known[key])
        is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
        if not (isinstance(value, expected) and isinstance(value, bool) == (expected is bool)) and not (
            expected is float and is_number
        ):
            raise InputError(f"config {name}.{key} must be of type {expected.__name__}, got {value!r}.")
        if is_number and value < 0:
            raise InputError(f"config {name}.{key} must not be negative, got {value!r}.")
        values[key] = expected(value)
    return dataclasses.replace(group, **values)
