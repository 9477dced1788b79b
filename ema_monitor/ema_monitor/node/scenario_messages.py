"""Scenarios of future duty from their messages."""

from collections.abc import Sequence
from typing import Any

from ema_monitor.prognosis.duty.scenario import MOST_SCENARIOS, Scenario, check_scenarios


def scenarios_from_messages(messages: Sequence[Any]) -> tuple[Scenario, ...]:
    """Return the scenarios of ``ema_interfaces/msg/DutyScenario`` messages.

    Raises
    ------
    ValueError
        When there are too many, or one is impossible; the message names it, its key and value.
    """
    if len(messages) > MOST_SCENARIOS:
        raise ValueError(f"{len(messages)} scenarios: expected at most {MOST_SCENARIOS}")
    return check_scenarios(tuple(_scenario(*one) for one in enumerate(messages, 1)))


def _scenario(number: int, message: Any) -> Scenario:
    try:
        return Scenario(
            message.name,
            message.duty,
            message.travel_per_hour,
            _shares("loads", message.loads, message.load_shares),
            _shares("winding", message.winding_temperatures, message.winding_shares),
            message.hours_per_cycle,
            message.hours_per_day,
        )
    except ValueError as error:
        raise ValueError(f"scenario {number}: {error}") from error


def _shares(name: str, values: Sequence[float], shares: Sequence[float]) -> dict[float, float]:
    if len(values) != len(shares):
        raise ValueError(f"{name}: {len(shares)} shares of {len(values)} values: expected as many")
    if len(set(values)) < len(values):
        raise ValueError(f"{name} = {list(values)[:10]}: expected each value once")
    return dict(zip(values, shares, strict=True))
