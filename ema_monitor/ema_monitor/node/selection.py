"""Which actuators a monitor is to follow: a list, and a share of one or of all."""

import hashlib
from collections.abc import Collection
from dataclasses import dataclass

from ema_core.description import check_name
from ema_core.quantity import check_quantities, quantity, texts


def digest_of(actuator_id: str) -> int:
    """Return a number of an actuator's name: the same in every process, on every machine.

    It is the BLAKE2b digest of 8 bytes of the name in UTF-8, as a big-endian number.

    Parameters
    ----------
    actuator_id
        Name of the actuator.
    """
    digest = hashlib.blake2b(actuator_id.encode("utf-8", "surrogatepass"), digest_size=8).digest()
    return int.from_bytes(digest, "big")


def shard_of(actuator_id: str, count: int, listed: Collection[str] = ()) -> int:
    """Return the shard of an actuator, which depends on nothing else.

    It is its number, ``digest_of``, modulo ``count``. Where all are listed they are dealt out in
    the order of their numbers instead, so that shards differ by one at most.

    Parameters
    ----------
    actuator_id
        Name of the actuator.
    count
        How many shards there are.
    listed
        The actuators, if they are listed.
    """
    if actuator_id in listed:
        return sorted(listed, key=lambda name: (digest_of(name), name)).index(actuator_id) % count
    return digest_of(actuator_id) % count


@dataclass(frozen=True)
class Shard:
    """The share of all actuators that one of several monitors follows.

    Raises
    ------
    ValueError
        When a figure is outside its range, or there is no such shard; the message names it.
    """

    index: int = quantity(0, "-", 0, 255, "which share of the actuators is followed, from 0")
    count: int = quantity(1, "-", 1, 256, "number of monitors that share the actuators")

    def __post_init__(self) -> None:
        check_quantities(self)
        if self.index >= self.count:
            raise ValueError(
                f"index = {self.index}: expected at most {self.count - 1}, as count = {self.count} "
                "monitors share the actuators and the first one is 0"
            )

    def has(self, actuator_id: str, listed: Collection[str] = ()) -> bool:
        """Return whether an actuator is of this share, as of ``shard_of``."""
        return self.count == 1 or shard_of(actuator_id, self.count, listed) == self.index

    def __str__(self) -> str:
        return f"shard {self.index} of {self.count}"


@dataclass(frozen=True)
class Selection:
    """The actuators that are followed.

    Raises
    ------
    ValueError
        When a name is impossible or given twice; the message names it.
    """

    actuators: tuple[str, ...] = texts(
        "actuators that are followed, each by its actuator_id; empty: all that are heard"
    )

    def __post_init__(self) -> None:
        check_quantities(self)
        for number, name in enumerate(self.actuators):
            check_name(f"actuators[{number}]", name)
        twice = [name for name in dict.fromkeys(self.actuators) if self.actuators.count(name) > 1]
        if twice:
            raise ValueError(f"actuators = {list(self.actuators)}: {twice[0]!r} is given twice")

    def of(self, shard: Shard) -> tuple[str, ...]:
        """Return those that are listed and of a share."""
        return tuple(name for name in self.actuators if shard.has(name, self.actuators))
