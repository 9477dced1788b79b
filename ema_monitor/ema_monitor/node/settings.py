"""Settings of the monitor node beside those of trigger, identification and health."""

from dataclasses import dataclass

from ema_core.quantity import check_quantities, quantity, text


@dataclass(frozen=True)
class Files:
    """Where the monitor finds what it is not told on topics.

    Raises
    ------
    ValueError
        When a value is no text; the message names it.
    """

    calibration_file: str = text(
        "",
        "calibrations; {actuator_id} and {serial_number} in the path stand for those of the "
        "actuator; empty: the shipped calibration of the built-in actuator",
    )
    actuator_file: str = text(
        "", "description of an actuator that does not describe itself on the topic; empty: none"
    )
    history_folder: str = text(
        "$ROS_HOME/ema/history",
        "where the tests of each unit are kept; empty, and in simulated time: in memory only",
    )

    def __post_init__(self) -> None:
        check_quantities(self)


@dataclass(frozen=True)
class Operation:
    """How the monitor goes about its work.

    Raises
    ------
    ValueError
        When a figure is outside its range; the message names it.
    """

    waiting_windows: int = quantity(
        2,
        "-",
        1,
        10_000,
        "windows of an actuator that may wait; one more drops its oldest, not in simulated time",
    )
    expected_period_s: float = quantity(
        10.0, "s", 0.1, 1e7, "time between estimates; health is stale after three without one"
    )
    calibration_timeout_s: float = quantity(
        60.0, "s", 1.0, 1e5, "how long a calibration waits for its next window"
    )

    def __post_init__(self) -> None:
        check_quantities(self)
