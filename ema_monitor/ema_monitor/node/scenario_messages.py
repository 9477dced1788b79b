"""Scenarios of future duty as messages, and the lives under them."""

from collections.abc import Sequence
from typing import Any

from ema_interfaces.msg import ScenarioLife
from ema_monitor.node.messages import life_to_message
from ema_monitor.prognosis.duty.scenario import MOST_SCENARIOS, Scenario, check_scenarios
from ema_monitor.prognosis.outlook import Outlook


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


def scenario_to_message(scenario: Scenario, outlook: Outlook) -> ScenarioLife:
    """Return the life under a scenario as a message."""
    life, removal = outlook.rul, outlook.removal
    days = [hours / removal.hours_a_day for hours in (life.hours_05, life.hours_50, life.hours_95)]
    return ScenarioLife(
        name=scenario.name,
        rul=life_to_message(life, outlook),
        days_05=days[0],
        days_50=days[1],
        days_95=days[2],
        dominant_fault=outlook.dominant if life.known else "",
        removal_hours=float(removal.hours),
        removal_cycles=float(removal.cycles),
        removal_days=float(removal.days),
        assumption=outlook.assumption,
    )
