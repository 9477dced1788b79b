# SPDX-License-Identifier: Apache-2.0
"""Alerts: level changes posted as JSON to an address."""

import asyncio
import logging
import math
from concurrent.futures import Future
from datetime import UTC, datetime
from typing import Any, Final

from aiohttp import ClientError, ClientSession, ClientTimeout

from ema_core.levels import LEVEL_NAMES, OK, STALE
from ema_interfaces.msg import Health
from ema_ros.stamps import stamp_from_message

WAITS_S: Final = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0)
"""Delays between attempts to post an alert [s]; after the last attempt the alert is lost."""

MOST_WAITING: Final = 100
"""Largest number of waiting alerts; if it is exceeded, the oldest alert is lost."""

_MOST_ACTUATORS: Final = 1000
_TEMPORARY: Final = (408, 429)  # temporary refusals: timeout, too many requests
_ANSWER_S: Final = 10.0


class Alerts:
    """Posts level changes one at a time, in an event loop of another thread.

    The first level of an actuator is an alert if it is WARN or ERROR.

    Attributes
    ----------
    sent, lost
        Numbers of accepted and lost alerts.
    failure
        Why the latest attempt failed; empty if it succeeded.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop, address: str, page: str) -> None:
        self.sent = self.lost = 0
        self.failure = ""
        self._loop = loop
        self._address = address
        self._page = page
        self._levels: dict[tuple[str, str], int] = {}
        self._queue: asyncio.Queue[dict[str, Any]] = asyncio.Queue(MOST_WAITING)
        self._task: Future[None] = asyncio.run_coroutine_threadsafe(self._post_all(), loop)

    def note(self, namespace: str, health: Health) -> None:
        """Post an alert if the level of a published health has changed."""
        key = namespace, health.actuator_id
        before = self._levels.pop(key, None)
        self._levels[key] = health.level
        if len(self._levels) > _MOST_ACTUATORS:
            del self._levels[next(iter(self._levels))]
        if before is None and health.level in (OK, STALE):
            return
        if before != health.level:
            alert = _content(namespace, health, before) | {"page": self._page}
            self._loop.call_soon_threadsafe(self._add, alert)

    def close(self) -> None:
        """Stop posting."""
        self._task.cancel()

    def _add(self, alert: dict[str, Any]) -> None:
        if self._queue.full():
            self._queue.get_nowait()
            self.lost += 1
        self._queue.put_nowait(alert)

    async def _post_all(self) -> None:
        async with ClientSession(timeout=ClientTimeout(_ANSWER_S)) as session:
            while True:
                alert = await self._queue.get()
                if await self._is_taken(session, alert):
                    self.sent += 1
                else:
                    self.lost += 1
                    text = f"{alert['actuator_id']}: alert {alert['level']} lost"
                    logging.getLogger("ema_dashboard").error(f"{text}: {self.failure}")

    async def _is_taken(self, session: ClientSession, alert: dict[str, Any]) -> bool:
        """Post an alert until it is accepted or rejected, at most seven times.

        Return whether it was accepted.
        """
        for wait_s in (*WAITS_S, 0.0):
            status = await self._post(session, alert)
            if not self.failure:
                return True
            if 400 <= status < 500 and status not in _TEMPORARY:
                return False
            await asyncio.sleep(wait_s)
        return False

    async def _post(self, session: ClientSession, alert: dict[str, Any]) -> int:
        """Post an alert once and set ``failure``. Return the HTTP status; 0 without a response."""
        try:
            # A redirected POST would become a GET without content.
            async with session.post(self._address, json=alert, allow_redirects=False) as answer:
                self.failure = "" if 200 <= answer.status < 300 else f"status {answer.status}"
                return answer.status
        except (ClientError, OSError) as error:  # a timeout is an OSError
            self.failure = type(error).__name__  # without the address, which may be secret
            return 0


def _content(namespace: str, health: Health, before: int | None) -> dict[str, Any]:
    at_s = stamp_from_message(health.tested) * 1e-9
    hours = health.rul.hours_50 if health.rul.known else math.nan
    figures = {"health_index": health.health_index, "rul_50": hours}
    return {
        "namespace": namespace,
        "actuator_id": health.actuator_id,
        "serial_number": health.serial_number,
        "level": LEVEL_NAMES[health.level],
        "before": None if before is None else LEVEL_NAMES[before],
        "tested": datetime.fromtimestamp(at_s, UTC).isoformat(),
        "reason": health.reason if health.level == STALE else health.cause,
        "removal": health.removal,
        **{name: value if math.isfinite(value) else None for name, value in figures.items()},
    }
