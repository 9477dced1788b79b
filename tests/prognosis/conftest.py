# SPDX-License-Identifier: Apache-2.0
"""Where histories are, and requirements that several files ask and none changes."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from ema_core.parameters import ActuatorParameters
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.requirements.requirements import Requirements


@pytest.fixture(autouse=True)
def _histories_are_closed(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Close the histories that a test leaves open: Python 3.13 warns of such databases."""
    made: list[History] = []
    initialise = History.__init__

    def note(self: History, actuator_id: str, serial_number: str, path: Path | None = None) -> None:
        made.append(self)
        initialise(self, actuator_id, serial_number, path)

    monkeypatch.setattr(History, "__init__", note)
    yield
    for history in made:
        history.close()


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """The file of a history, whose folder is not there yet."""
    return tmp_path / "histories" / "flap.sqlite"


@pytest.fixture(scope="session")
def requirements() -> Requirements:
    """Those of the built-in actuator."""
    return Requirements(ActuatorParameters())
