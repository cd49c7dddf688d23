"""The settings of all stages: what tables change, and what is refused."""

import dataclasses
import inspect

import pytest

import voxjax as vx
from voxjax.pipeline.config import Config, PoseConfig, config_from
from voxjax.registration.judging.settings import LeaderConfig, VerdictConfig

GROUPS = {field.name: type(getattr(Config(), field.name)) for field in dataclasses.fields(Config)}


def test_nothing_gives_the_defaults_and_a_config_is_kept():
    assert config_from(None) == Config()
    assert config_from({}) == Config()
    changed = Config(leader=LeaderConfig(num_leaders=3))
    assert config_from(changed) is changed


def test_tables_change_only_what_they_name():
    config = config_from({"source": {"descriptors": False}, "map": {"voxel_size": 1}})
    assert config.source.descriptors is False
    assert config.source.exhaustive is True
    assert config.map.voxel_size == 1.0
    assert isinstance(config.map.voxel_size, float)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"sources": {}}, "no table 'sources'"),
        ({"source": {"corner": True}}, "no key 'corner'"),
        ({"source": {"corners": 1}}, "source.corners must be of type bool, got 1; leave it out for True"),
        ({"source": {"num_peaks": True}}, "must be of type int"),
        ({"source": {"num_peaks": 3.0}}, "must be of type int"),
        ({"verdict": {"min_confidence": "high"}}, "must be of type float"),
        ({"verdict": {"min_confidence": [0.5] * 999}}, r"got \[0.5.*\.\.\.; leave"),
        ({"verdict": {"min_confidence": -0.1}}, "must be a finite number, 0 or more and at most 1, got -0.1"),
        (
            {"verdict": {"min_confidence": 5}},
            "verdict.min_confidence must be .* at most 1, got 5; leave it out",
        ),
        ({"verdict": {"min_confidence": float("nan")}}, "must be a finite number, .*got nan"),
        ({"map": {"voxel_size": float("inf")}}, "must be a finite number, .*got inf"),
        ({"map": {"voxel_size": 10**400}}, "got a whole number of 1329 bits"),
        ({"leader": {"num_leaders": 0}}, "must be a whole number, 1 or more .*got 0; leave it out for 12"),
        ({"source": {"max_rotations": 0}}, "must be a whole number, 1 or more .*got 0"),
        ({"source": {"max_rotations": 10**5000}}, "got a whole number of 16610 bits"),
        ({"source": {"distance_tolerance": 0.0}}, "must be a finite number, above 0 .*got 0.0"),
        ({"source": 3}, "must hold keys and values"),
    ],
)
def test_wrong_settings_are_refused(settings, message):
    with pytest.raises(vx.InputError, match=message):
        config_from(settings)


@pytest.mark.parametrize(
    ("group", "values"),
    [
        (VerdictConfig, {"min_confidence": 5.0}),
        (VerdictConfig, {"max_none": float("nan")}),
        (LeaderConfig, {"num_leaders": 0}),
        (PoseConfig, {"start_distance": float("inf")}),
    ],
)
def test_groups_made_directly_are_checked_too(group, values):
    (key,) = values
    with pytest.raises(vx.InputError, match=f"{group.table}.{key} must be"):
        group(**values)


@pytest.mark.parametrize("name", GROUPS)
def test_every_setting_is_described_has_a_range_and_a_default_inside(name):
    group = GROUPS[name]
    assert group.table == name
    described = inspect.getdoc(group) or ""
    for field in dataclasses.fields(group):
        assert f"    {field.name}: " in described, f"{name}.{field.name} has no line in the docstring"
        low, high, above = (field.metadata[key] for key in ("low", "high", "above"))
        if type(field.default) is bool:
            assert (low, high, above) == (None, None, None)
        else:
            assert high is not None
            assert (low is None) != (above is None)
    assert group() == group(**{field.name: field.default for field in dataclasses.fields(group)})


@pytest.mark.parametrize("name", GROUPS)
def test_the_ends_of_a_range_can_be_used_and_nothing_beyond(name):
    for field in dataclasses.fields(GROUPS[name]):
        if type(field.default) is bool:
            continue
        high = field.metadata["high"]
        assert getattr(getattr(config_from({name: {field.name: high}}), name), field.name) == high
        least = field.metadata["low"] if field.metadata["low"] is not None else field.metadata["above"]
        below = least - 1 if type(field.default) is int else least - 0.5
        for value in (high + 1, below):
            with pytest.raises(vx.InputError, match=f"{name}.{field.name} must be"):
                config_from({name: {field.name: value}})
