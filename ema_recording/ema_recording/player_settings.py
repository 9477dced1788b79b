"""What the player is told: which part of which bag to play, and how."""

from dataclasses import dataclass

from ema_core.quantity import check_quantities, flag, quantity, text


@dataclass(frozen=True)
class PlayerSettings:
    """What to play, and how fast. Names as rosbag2 has them."""

    bag: str = text("", "bag to play: a file or a folder")
    rate: float = quantity(1.0, "-", 0.01, 100.0, "playback rate")
    start_offset: float = quantity(0.0, "s", 0.0, 1e9, "where to begin, from the bag's start")
    playback_duration: float = quantity(
        0.0, "s", 0.0, 1e9, "how much of the bag to play; 0: to its end"
    )
    loop: bool = flag(False, "begin again at the end")
    start_paused: bool = flag(False, "wait at the beginning to be resumed")
    actuator_only: bool = flag(
        False, "play the topics of the actuator only, for a monitor to diagnose"
    )
    wait_s: float = quantity(
        5.0, "s", 0.0, 3600.0, "timeout for a subscriber of each telemetry topic"
    )
    clock_rate_hz: float = quantity(100.0, "Hz", 1.0, 1000.0, "rate of /clock")
    stay: bool = flag(False, "stay at the end of the bag, for a seek, instead of ending")

    def __post_init__(self) -> None:
        check_quantities(self)
