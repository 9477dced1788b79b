"""Settings of the bridge node."""

from dataclasses import dataclass

from ema_core.quantity import check_quantities, quantity, text


@dataclass(frozen=True)
class BridgeSettings:
    """What a bridge listens to, and how long it waits.

    Raises
    ------
    ValueError
        When a value is impossible.
    """

    mapping_file: str = text("", "mapping of topics to telemetry, a YAML file")
    actuator_file: str = text("", "description of the actuator; empty: the built-in one")
    block_s: float = quantity(0.01, "s", 1e-3, 1.0, "time between two blocks of telemetry")
    learn_s: float = quantity(1.0, "s", 0.1, 60.0, "time in which the rate is found, at the start")
    wait_s: float = quantity(
        0.3, "s", 0.0, 10.0, "how long a position waits at most for what was sent before it"
    )

    def __post_init__(self) -> None:
        check_quantities(self)
