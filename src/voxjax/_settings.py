"""Settings of stages: frozen groups of fields that know which values they take.

A stage defines its group beside it, as a subclass of `Settings` with one `setting` a field; `voxjax.pipeline.config`
gathers all groups into `Config`. A value is checked wherever a group is made, from a table or directly.
"""

import dataclasses
import math
import numbers
from typing import Any, ClassVar

from ._checks import InputError


def setting(
    default: bool | int | float,
    *,
    low: int | float | None = None,
    high: int | float | None = None,
    above: int | float | None = None,
) -> Any:
    """A field of a group of settings, with the range of its values beside its default.

    Args:
        default: Value where nobody gives one; its type is the type of the setting. Numbers must be finite.
        low: Least value.
        high: Largest value.
        above: A bound that the value must be larger than.
    """
    return dataclasses.field(default=default, metadata={"low": low, "high": high, "above": above})


@dataclasses.dataclass(frozen=True)
class Settings:
    """Base of all groups: a group that exists holds values that can be used.

    Attributes:
        table: Name of the group in `Config` and in a TOML file.
    """

    table: ClassVar[str] = ""

    def __init_subclass__(cls, *, table: str) -> None:
        """Give a group its name."""
        cls.table = table

    def __post_init__(self) -> None:
        """Check all values.

        Raises:
            InputError: If one has another type than its default or lies outside its range.
        """
        for field in dataclasses.fields(self):
            checked = check_setting(self.table, field, getattr(self, field.name))
            # A frozen field can be set in this way only; it keeps the value as the type of its setting, also where a
            # whole number or one of NumPy was given.
            object.__setattr__(self, field.name, checked)


def check_setting(table: str, field: dataclasses.Field, value: Any) -> Any:
    """Return a value as the type of its setting.

    Args:
        table: Name of the group, for the message.
        field: A field made by `setting`.
        value: What somebody gave.

    Raises:
        InputError: If the type is another one, or the value lies outside the range of the setting.
    """
    expected = type(field.default)
    kinds = {bool: bool, int: numbers.Integral, float: numbers.Real}
    # Python counts True as the number 1; a switch given for a number, or a number for a switch, is a mistake.
    if not isinstance(value, kinds[expected]) or isinstance(value, bool) != (expected is bool):
        rule = f"be of type {expected.__name__}"
    elif expected is bool or _is_inside(field.metadata, value):
        return expected(value)
    else:
        rule = f"be {_range(expected, field.metadata)}"
    raise InputError(
        f"config {table}.{field.name} must {rule}, got {_shown(value)}; leave it out for {field.default!r}."
    )


def _is_inside(bounds: Any, value: Any) -> bool:
    """Whether a number is finite and within its bounds; whole numbers of any size are compared exactly."""
    low, high, above = bounds["low"], bounds["high"], bounds["above"]
    return bool(
        (isinstance(value, numbers.Integral) or math.isfinite(value))
        and (low is None or value >= low)
        and (high is None or value <= high)
        and (above is None or value > above)
    )


def _range(expected: type, bounds: Any) -> str:
    """The range of a setting in words."""
    number = "a whole number" if expected is int else "a finite number"
    least = [f"{bounds['low']:g} or more"] if bounds["low"] is not None else []
    above = [f"above {bounds['above']:g}"] if bounds["above"] is not None else []
    most = [f"at most {bounds['high']:g}"] if bounds["high"] is not None else []
    return ", ".join([number, " and ".join([*least, *above, *most])])


def _shown(value: Any) -> str:
    """A value for a message, however long it is."""
    if isinstance(value, int) and value.bit_length() > 64:
        # Python refuses to write out whole numbers of some thousand digits.
        return f"a whole number of {value.bit_length()} bits"
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
