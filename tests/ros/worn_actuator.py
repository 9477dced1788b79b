# SPDX-License-Identifier: Apache-2.0
"""An actuator whose friction grows, and requests to its monitor."""

import math
from collections.abc import Iterator
from copy import deepcopy
from itertools import count, islice
from typing import Any

from builtin_interfaces.msg import Time

from ema_core.faults import fault_vector
from ema_core.telemetry import Telemetry
from ema_interfaces.msg import Health, Usage
from ema_interfaces.srv import PredictRemainingLife
from ema_ros import topics
from ema_ros.stamps import stamp_to_message
from ema_sim.actuator import SimulatedActuator

from .monitor_session import CYCLE, MonitorSession

SERVICE = "/ema/monitor/predict_remaining_life"
HOURS = 10.0


def friction(number: int) -> float:
    """Return the friction in a test; it reaches the limit of 0.5 in test 32."""
    return 0.05 * math.expm1(0.0075 * HOURS * number)


def _wearing() -> Iterator[Telemetry]:
    actuator = SimulatedActuator()
    for number in count():
        actuator.faults = fault_vector({"friction": friction(number)})
        yield actuator.advance(CYCLE.samples)


_cycles, _made = _wearing(), list[Telemetry]()


def worn_cycles(n: int) -> list[Telemetry]:
    """Return n test cycles of an actuator with growing friction, one block each."""
    _made.extend(islice(_cycles, max(n - len(_made), 0)))
    return _made[:n]


def live(session: MonitorSession, cycles: list[Telemetry]) -> list[Health]:
    """Send test cycles one by one. Return the health after each test."""
    before = len(session.healths())
    for number, block in enumerate(cycles, 1):
        session.feed([block])
        session.until(lambda number=number: len(session.healths()) >= before + number)
    return session.healths()[before:]


def plain(message: Any) -> Any:
    """Return a message as a text with all digits, in which NaN is equal to itself.

    Author and times of reception, which differ from run to run, are cleared.
    """
    message = deepcopy(message)
    if isinstance(message, Health):
        message.received = message.good_until = Time()
        message.author = ""
    return str(message)


def replaced(message: Health) -> Health:
    """Return the message without events, which are published only once."""
    message.events = []
    return message


def predict(session: MonitorSession, duty: float, actuator_id: str = "") -> Any:
    request = PredictRemainingLife.Request(actuator_id=actuator_id, duty=duty)
    return session.call(PredictRemainingLife, SERVICE, request)


def use(session: MonitorSession, hours: float, stamp_ns: int, cycles: int = 0) -> None:
    message = Usage(actuator_id="flap", flight_hours=hours, cycles=cycles)
    message.header.stamp = stamp_to_message(stamp_ns)
    session.send(topics.USAGE, message)
