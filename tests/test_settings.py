"""Groups of settings check what they hold."""

import dataclasses

import numpy as np
import pytest

import voxjax as vx
from voxjax._settings import Settings, check_setting, setting


@dataclasses.dataclass(frozen=True)
class Group(Settings, table="group"):
    is_on: bool = setting(True)
    count: int = setting(3, low=1, high=10)
    length: float = setting(0.5, above=0.0, high=2.0)


FIELDS = {field.name: field for field in dataclasses.fields(Group)}


@pytest.mark.parametrize(
    ("name", "value", "expected"),
    [
        ("count", np.int64(10), 10),
        ("length", 2, 2.0),
        ("length", np.float32(0.25), 0.25),
        ("is_on", False, False),
    ],
)
def test_numbers_of_other_kinds_take_the_type_of_the_setting(name, value, expected):
    found = check_setting("group", FIELDS[name], value)
    assert found == expected
    assert type(found) is type(expected)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("count", 0),
        ("count", 11),
        pytest.param("count", 10**5000, id="count-huge"),
        ("count", 2.0),
        ("count", True),
        ("length", 0.0),
        ("length", -1e300),
        ("length", float("inf")),
        ("length", float("nan")),
        pytest.param("length", "long" * 100, id="length-text"),
        ("length", None),
        ("is_on", 1),
    ],
)
def test_a_refusal_is_one_sentence_with_key_rule_value_and_what_to_do(name, value):
    with pytest.raises(vx.InputError) as caught:
        check_setting("group", FIELDS[name], value)
    message = str(caught.value)
    assert message.startswith(f"config group.{name} must be ")
    assert ", got " in message
    assert message.endswith(f"; leave it out for {FIELDS[name].default!r}.")
    assert len(message) < 250


def test_a_group_cannot_be_made_or_changed_to_hold_what_cannot_be_used():
    assert Group(count=10).count == 10
    with pytest.raises(vx.InputError, match=r"group\.count"):
        Group(count=11)
    with pytest.raises(vx.InputError, match=r"group\.length"):
        dataclasses.replace(Group(), length=0.0)
