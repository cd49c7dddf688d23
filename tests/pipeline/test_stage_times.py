"""Stages are announced and measured."""

import pytest

from voxjax.pipeline.stage_times import Stages


def test_stages_are_announced_in_order_and_measured_under_their_names():
    heard = []
    before = {"read": 1.5}
    stages = Stages(heard.append, before)
    stages.announce("hypotheses")
    with stages.measure("exhaustive search"):
        pass
    with stages.stage("leaders"):
        assert heard == ["hypotheses", "leaders"]
    first = stages.seconds["leaders"]
    with stages.stage("leaders"):
        pass
    assert heard == ["hypotheses", "leaders", "leaders"]
    assert set(stages.seconds) == {"read", "exhaustive search", "leaders"}
    assert stages.seconds["read"] == 1.5
    assert stages.seconds["leaders"] >= first >= 0.0
    assert before == {"read": 1.5}


def test_nobody_need_listen():
    stages = Stages()
    with stages.stage("verdict"):
        pass
    assert set(stages.seconds) == {"verdict"}


def test_what_a_stage_raises_is_not_swallowed():
    with pytest.raises(KeyError), Stages().stage("verdict"):
        raise KeyError("lost")
