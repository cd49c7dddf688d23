import pytest

import voxjax as vx
from voxjax.pipeline.config import Config, config_from


def test_nothing_gives_the_defaults_and_a_config_is_kept():
    assert config_from(None) == Config()
    changed = Config()
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
        ({"source": {"corners": 1}}, "must be of type bool"),
        ({"source": {"num_peaks": True}}, "must be of type int"),
        ({"verdict": {"min_confidence": "high"}}, "must be of type float"),
        ({"verdict": {"min_confidence": -0.1}}, "must not be negative"),
        ({"source": 3}, "must hold keys and values"),
    ],
)
def test_wrong_settings_are_refused(settings, message):
    with pytest.raises(vx.InputError, match=message):
        config_from(settings)
