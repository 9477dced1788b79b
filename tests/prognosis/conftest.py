"""Where histories are, and requirements that several files ask and none changes."""

from pathlib import Path

import pytest

from ema_core.parameters import ActuatorParameters
from ema_monitor.prognosis.requirements.requirements import Requirements


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """The file of a history, whose folder is not there yet."""
    return tmp_path / "histories" / "flap.sqlite"


@pytest.fixture(scope="session")
def requirements() -> Requirements:
    """Those of the built-in actuator."""
    return Requirements(ActuatorParameters())
