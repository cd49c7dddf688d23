"""All settings of `voxjax.register`: one frozen group for each stage, readable from a TOML table.

A group stands beside the stage that it is for, with defaults, units, origins and ranges; lower layers know nothing of
`Config`, and only this package turns settings into arguments of stages.
"""

import dataclasses
from collections.abc import Mapping
from typing import Any, TypeVar

from .._checks import InputError, shown
from .._settings import Settings, check_setting, setting
from ..maps.settings import MapConfig
from ..planes.settings import PlaneConfig
from ..registration.causes.settings import CauseConfig
from ..registration.hypotheses.settings import (
    DescriptorConfig,
    EvidenceConfig,
    ExhaustiveConfig,
    FrameConfig,
    RotationConfig,
    SourceConfig,
    SubgraphConfig,
)
from ..registration.judging.settings import LeaderConfig, VerdictConfig
from ..registration.paper.settings import PaperConfig

Group = TypeVar("Group", bound=Settings)


@dataclasses.dataclass(frozen=True)
class PoseConfig(Settings, table="pose"):
    """The last refinement of the best leader.

    Attributes:
        start_distance: Robust scale at which the refinement starts [voxel].
        num_points: Voxels of each map that take part, drawn by leverage.
    """

    start_distance: float = setting(2.0, above=0.0, high=1_000.0)
    num_points: int = setting(4096, low=1, high=10_000_000)


@dataclasses.dataclass(frozen=True)
class Config:
    """All settings of `voxjax.register`.

    Attributes:
        map: How maps are prepared.
        source: Which hypotheses are proposed, and how many.
        rotation: How rotations are found from the normals of two maps.
        exhaustive: How finely all translations are searched.
        plane: How the planes behind the corners of maps are found.
        frame: How single pairs of corners propose poses.
        subgraph: How the maximum common subgraph of the corners is searched.
        descriptor: How matched local descriptors propose poses.
        evidence: How much conflicts weigh beside hits.
        leader: How many hypotheses survive each stage, and by how many points they are compared.
        verdict: When a pose is accepted.
        cause: When a mirrored map and one of another scale are looked for.
        pose: The last refinement.
        paper: The preset "paper", which uses no other group but the weight of conflicts in `evidence`.
    """

    map: MapConfig = dataclasses.field(default_factory=MapConfig)
    source: SourceConfig = dataclasses.field(default_factory=SourceConfig)
    rotation: RotationConfig = dataclasses.field(default_factory=RotationConfig)
    exhaustive: ExhaustiveConfig = dataclasses.field(default_factory=ExhaustiveConfig)
    plane: PlaneConfig = dataclasses.field(default_factory=PlaneConfig)
    frame: FrameConfig = dataclasses.field(default_factory=FrameConfig)
    subgraph: SubgraphConfig = dataclasses.field(default_factory=SubgraphConfig)
    descriptor: DescriptorConfig = dataclasses.field(default_factory=DescriptorConfig)
    evidence: EvidenceConfig = dataclasses.field(default_factory=EvidenceConfig)
    leader: LeaderConfig = dataclasses.field(default_factory=LeaderConfig)
    verdict: VerdictConfig = dataclasses.field(default_factory=VerdictConfig)
    cause: CauseConfig = dataclasses.field(default_factory=CauseConfig)
    pose: PoseConfig = dataclasses.field(default_factory=PoseConfig)
    paper: PaperConfig = dataclasses.field(default_factory=PaperConfig)


def config_from(settings: Config | Mapping[str, Any] | None) -> Config:
    """The settings as a `Config`.

    Args:
        settings: None for the defaults, a `Config`, or nested tables such as `{"source": {"descriptors": False}}`
            (what a TOML file gives).

    Raises:
        InputError: If a table or key does not exist, or a value has the wrong type or lies outside its range.
    """
    if settings is None:
        return Config()
    if isinstance(settings, Config):
        return settings
    if not isinstance(settings, Mapping):
        raise InputError(f"config must be a Config or tables of keys and values, got {shown(settings)}.")
    groups = {field.name: type(getattr(Config(), field.name)) for field in dataclasses.fields(Config)}
    changed = {}
    for name, table in settings.items():
        if name not in groups:
            raise InputError(f"config has no table {shown(name)}; it has {', '.join(groups)}.")
        if not isinstance(table, Mapping):
            raise InputError(f"config table {shown(name)} must hold keys and values, got {shown(table)}.")
        changed[name] = _group_from(groups[name], table)
    return Config(**changed)


def _group_from(kind: type[Group], table: Mapping[str, Any]) -> Group:
    """A group with the values of a table, and defaults for the others."""
    known = {field.name: field for field in dataclasses.fields(kind)}
    for key in table:
        if key not in known:
            raise InputError(
                f"config table {kind.table!r} has no key {shown(key)}; it has {', '.join(known)}."
            )
    # Defaults stand for what a table leaves out, so that a file names only what it changes.
    return kind(**{key: check_setting(kind.table, known[key], value) for key, value in table.items()})
