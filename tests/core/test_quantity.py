"""Fields of settings: what is impossible is refused by name, value, unit and range."""

import math
from dataclasses import dataclass, field, fields, replace
from typing import Any, cast

import numpy as np
import pytest

from ema_core.quantity import check_quantities, flag, quantity, text


@dataclass(frozen=True)
class Oven:
    temperature: float = quantity(180.0, "degC", 20.0, 300.0, "temperature inside")
    trays: int = quantity(2, "-", 0, 4, "trays in use")
    mode: str = text("fan", "where the heat comes from", ("fan", "grill"))
    label: str = text("", "what is in it")
    notes: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        check_quantities(self)


def test_defaults_are_possible_and_fields_carry_what_documents_them():
    oven = Oven()
    assert (oven.temperature, oven.trays, oven.mode, oven.label) == (180.0, 2, "fan", "")
    metadata = {item.name: dict(item.metadata) for item in fields(Oven)}
    assert metadata["temperature"] == {
        "unit": "degC",
        "range": (20.0, 300.0),
        "description": "temperature inside",
        "usual": None,
        "shown": None,
    }
    assert metadata["mode"]["choices"] == ("fan", "grill")
    assert metadata["notes"] == {}


@pytest.mark.parametrize("value", [20, 20.0, np.float32(20.0), np.int64(20)])
def test_number_gets_the_type_of_its_default(value: Any):
    oven = Oven(temperature=value, trays=float(value) / 5)  # type: ignore[arg-type]
    assert type(oven.temperature) is float
    assert type(oven.trays) is int
    assert (oven.temperature, oven.trays) == (20.0, 4)


@pytest.mark.parametrize(
    ("values", "texts"),
    [
        ({"temperature": 300.1}, ["temperature = 300.1 degC", "[20, 300] degC", "inside"]),
        ({"temperature": math.nextafter(20.0, 0.0)}, ["temperature", "outside", "[20, 300] degC"]),
        ({"temperature": math.nan}, ["temperature = nan", "finite number in [20, 300] degC"]),
        ({"temperature": math.inf}, ["temperature = inf", "finite"]),
        ({"temperature": "hot"}, ["temperature = 'hot'", "finite number"]),
        ({"temperature": None}, ["temperature = None", "finite number"]),
        ({"temperature": 10**400}, ["temperature", "finite number"]),
        ({"trays": True}, ["trays = True", "finite number"]),
        ({"trays": 2.5}, ["trays = 2.5", "whole number"]),
        ({"trays": -1}, ["trays = -1", "[0, 4]"]),
        ({"mode": "steam"}, ["mode = 'steam'", "fan, grill"]),
        ({"mode": ""}, ["mode = ''", "fan, grill"]),
        ({"label": 3}, ["label = 3", "text"]),
    ],
)
def test_impossible_value_is_refused_by_name_value_unit_and_range(
    values: dict[str, Any], texts: list[str]
):
    with pytest.raises(ValueError, match="=") as refused:
        Oven(**values)
    assert all(item in str(refused.value) for item in texts), refused.value
    with pytest.raises(ValueError, match="="):
        replace(Oven(), **values)


@dataclass(frozen=True)
class Switch:
    on: bool = flag(False, "whether it is on")

    def __post_init__(self) -> None:
        check_quantities(self)


def test_flag_is_true_or_false_and_nothing_else():
    assert Switch().on is False
    assert Switch(True).on is True
    for value in (1, "yes", None):
        with pytest.raises(ValueError, match=r"on = .*: expected true or false"):
            Switch(cast(bool, value))
