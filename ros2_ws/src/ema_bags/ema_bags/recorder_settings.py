"""What the recorder is told: where to record, in which files, or snapshots alone."""

from dataclasses import dataclass
from typing import Final

from ema_core.quantity import check_quantities, flag, quantity, text, texts

_LEAST_BAG_BYTES: Final = 100_000


@dataclass(frozen=True)
class RecorderSettings:
    """Where and how to record; fixed while a bag is open. Names as rosbag2 has them."""

    output: str = text(
        "",
        "bag to write: a name ending in .mcap is one file, any other a folder; "
        "empty: ema_<UTC date and time> in the working folder",
    )
    overwrite: bool = flag(False, "replace an existing bag")
    flush_s: float = quantity(
        0.5, "s", 0.01, 60.0, "longest time between writes; a killed recorder loses that much"
    )
    max_bag_size: int = quantity(
        0, "B", 0, 10**15, "size from which on the next file is begun, 100000 at least; 0: never"
    )
    max_bag_duration: float = quantity(
        0.0, "s", 0.0, 1e7, "recorded time after which the next file is begun; 0: never"
    )
    snapshot_duration: float = quantity(
        0.0,
        "s",
        0.0,
        86400.0,
        "how much is kept in memory and written when a level changes, or by ~/snapshot; "
        "0: all is written",
    )
    max_cache_size: int = quantity(
        104857600, "B", 100_000, 10**12, "memory for a snapshot; beyond it the oldest are dropped"
    )
    topics: tuple[str, ...] = texts(
        "topics to record; empty: the namespace, /diagnostics and /clock"
    )

    def __post_init__(self) -> None:
        check_quantities(self)
        if 0 < self.max_bag_size < _LEAST_BAG_BYTES:
            raise ValueError(
                f"max_bag_size = {self.max_bag_size} B: expected 0 or at least {_LEAST_BAG_BYTES} B"
            )
        several = ("max_bag_size", "max_bag_duration", "snapshot_duration")
        chosen = [name for name in several if getattr(self, name)]
        if chosen and self.output.endswith(".mcap"):
            raise ValueError(
                f"output = {self.output!r} is one file: expected a folder, a name that does not "
                f"end in .mcap, as {chosen[0]} = {getattr(self, chosen[0]):g} makes several"
            )
