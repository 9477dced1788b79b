# SPDX-License-Identifier: Apache-2.0
"""Selection of the actuators that a monitor follows: a list, a shard, and a limit."""

from types import SimpleNamespace
from typing import Any, cast

import pytest

from ema_core.levels import OK, WARN
from ema_monitor.node.receive.admission import Admission, Selection, Shard, shard_of
from ema_monitor.node.settings import Operation

NAMES = tuple(f"flap_{number}" for number in range(200))


def admission(
    actuators: tuple[str, ...] = (), shard: Shard | None = None, most: int = 100
) -> Admission:
    operation = SimpleNamespace(value=Operation(most_actuators=most))
    return Admission(Selection(actuators), shard or Shard(), cast(Any, operation))


def test_shard_of_an_actuator_never_changes():
    # Computed from `hashlib.blake2b(name.encode(), digest_size=8)`, as a big-endian number.
    assert [shard_of(name, 4) for name in ("flap", "left", "Klappe links")] == [2, 3, 1]
    assert shard_of("flap", 1) == 0


@pytest.mark.parametrize("count", [2, 4])
def test_every_actuator_is_in_one_shard_and_shards_are_about_equal(count):
    shards = [Shard(index, count) for index in range(count)]
    owners = [[shard.has(name) for shard in shards].index(True) for name in NAMES]
    assert all(sum(shard.has(name) for shard in shards) == 1 for name in NAMES)
    # Binomial: one of 15,000 draws deviates by more than four standard deviations.
    mean = len(NAMES) / count
    sigma = (mean * (1.0 - 1.0 / count)) ** 0.5
    assert all(abs(owners.count(index) - mean) < 4.0 * sigma for index in range(count))


@pytest.mark.parametrize("count", [1, 2, 3, 8])
def test_listed_actuators_are_dealt_out_evenly_regardless_of_their_order(count):
    listed = NAMES[:6]
    shares = [Selection(listed).of(Shard(index, count)) for index in range(count)]
    assert sorted(name for share in shares for name in share) == sorted(listed)
    sizes = [len(share) for share in shares]
    assert max(sizes) - min(sizes) <= 1
    turned = [Selection(listed[::-1]).of(Shard(index, count)) for index in range(count)]
    assert [set(share) for share in turned] == [set(share) for share in shares]


def test_impossible_shards_and_lists_are_refused_by_name():
    with pytest.raises(ValueError, match="index = 4: expected 0 to 3, because"):
        Shard(4, 4)
    with pytest.raises(ValueError, match="count = 0 is outside"):
        Shard(0, 0)
    with pytest.raises(ValueError, match=r"actuators = .*'flap' is repeated"):
        Selection(("flap", "left", "flap"))
    with pytest.raises(ValueError, match=r"actuators\[1\] = ' left'"):
        Selection(("flap", " left"))
    with pytest.raises(ValueError, match="actuators = 'flap': expected a list of strings"):
        Selection("flap")  # type: ignore[arg-type]


def test_listed_actuators_of_other_shards_are_stated_and_others_are_ignored():
    shard = Shard(0, 2)
    made = admission(NAMES[:6], shard)
    mine = list(made.listed)
    theirs = [name for name in NAMES[:6] if name not in mine]
    assert len(mine) == len(theirs)
    words = made.describe_list()
    assert words == (
        f"listed actuators of shard 0 of 2: {', '.join(mine)}; of other shards: {', '.join(theirs)}"
    )
    assert not any(made.ignores(name) for name in mine)
    assert all(made.ignores(name) for name in theirs)
    assert made.ignores(NAMES[6])
    assert "not listed" in made.why_not(NAMES[6])
    assert made.why_not(theirs[0]) == "it belongs to shard 1, this monitor has shard 0 of 2"
    figures = made.figures(mine)
    assert figures["messages of other shards"] == len(theirs)
    assert figures["messages of unlisted actuators"] == 1
    # Neither is an error.
    assert made.status(mine) == (OK, f"{len(mine)} actuators monitored")


def test_unmonitored_actuators_with_measured_causes_are_named_for_a_minute():
    for made in (admission(), admission(("flap",))):
        made.note_measured("flip", 10.0)
        made.note_measured("flap", 40.0)
        made.note_measured("", 40.0)
        text = "measured causes of 'flip', which is not monitored"
        assert made.status(["flap"], 70.0) == (WARN, text)
        assert made.status(["flap"], 70.1) == (OK, "1 actuator monitored")
        made.note_measured("flip", 80.0)
        assert made.status(["flap"], 140.0) == (WARN, text)
        made.forget_measured("flip")
        assert made.status(["flap"], 140.0) == (OK, "1 actuator monitored")


@pytest.mark.parametrize("listed", [(), NAMES[:6]])
def test_no_monitor_warns_of_measured_causes_of_other_shards(listed: tuple[str, ...]):
    for index in range(2):
        shard = Shard(index, 2)
        made = admission(listed, shard)
        mine = [name for name in NAMES[:6] if shard.has(name, listed)]
        assert 0 < len(mine) < 6
        for name in NAMES[:6]:
            made.note_measured(name, 0.0)
        assert made.status(mine) == (OK, f"{len(mine)} actuators monitored")


def test_list_longer_than_the_limit_is_refused():
    made = admission(("a", "b", "c"), most=2)
    with pytest.raises(ValueError, match="actuators lists 3 of shard 0 of 1: expected at most mos"):
        made.check()


def test_actuator_beyond_the_limit_is_refused_once_and_counted():
    made = admission(most=2)
    followed = {"a": 0.0, "b": 0.0}
    assert made.refuse("b", {"a": 0.0}) is None
    printed = [made.refuse("c", followed) for _ in range(3)]
    assert printed == ["not monitored: the limit most_actuators = 2 is reached", "", ""]
    level, message = made.status(followed)
    assert level == WARN
    assert "ignored: 3 messages of actuators beyond the limit, the latest of 'c'" in message
    assert made.figures(followed)["messages of actuators beyond the limit"] == 3
