# SPDX-License-Identifier: Apache-2.0
"""``ema recover``: copy the intact part of a damaged bag to a new bag."""

from collections.abc import Callable
from pathlib import Path

import click
from rclpy.qos import QoSProfile

from ema_bags.message_type import message_class
from ema_bags.qos import joint_offer, recorded_qos
from ema_bags.reader import Bag
from ema_bags.recording import Topic
from ema_bags.schema import decoder, schema_text
from ema_bags.telemetry import TELEMETRY_TYPE
from ema_cli.output import BAG_TO_WRITE, new_bag, output_option, require_apart
from ema_cli.processes.stop_request import deferred_signals
from ema_cli.progress import progress_bar
from ema_core.wording import counted
from ema_ros.messages import telemetry_from_message


@click.command()
@click.argument("bag", type=click.Path(path_type=Path))
@output_option(BAG_TO_WRITE)
def recover(bag: Path, output: Path, overwrite: bool) -> None:
    """Copy the intact part of a damaged BAG to a new bag with an index.

    Malformed messages, telemetry with columns of different lengths, and times of 2^63 ns or more
    are skipped.
    """
    require_apart(output, [bag])
    damaged = Bag(bag)
    names = [name for name, topic in damaged.topics.items() if topic.count]
    with (
        deferred_signals() as stop,
        new_bag(output, overwrite=overwrite) as whole,
        progress_bar() as progress,
    ):
        for name in names:
            topic = damaged.topics[name]
            whole.add_topic(name, message_class(topic.type_name), _offer(name, topic))
        checks = {name: _checked(damaged.topics[name]) for name in names}
        total, written = sum(damaged.topics[name].count for name in names), 0
        messages = damaged.raw_messages(names)
        for item in progress.track(messages, total=total, description="recovering"):
            if stop:
                raise ValueError(
                    f"stopped: {written} of {counted(total, 'message')} are in {output}"
                )
            try:
                message = checks[item.topic](item.message)
                for name in ("log_time_ns", "publish_time_ns"):
                    # MCAP permits later times, rosbag2 does not.
                    if (time_ns := getattr(item, name)) >= 2**63:
                        what = name.removesuffix("_ns")
                        raise ValueError(f"{what} = {time_ns} ns is outside [0, 2^63) ns")
            except ValueError as error:
                damaged.malformed.note(item, str(error))
                continue
            whole.write_serialized(item.topic, message, item.log_time_ns, item.publish_time_ns)
            written += 1
    for remark in damaged.remarks:
        click.echo(f"{bag}: {remark}", err=True)
    click.echo(f"{output}: {counted(written, 'message')} on {counted(len(names), 'topic')}")


def _checked(topic: Topic) -> Callable[[bytes], bytes]:
    """Return a function that upgrades a recorded message of a topic and checks it.

    The function raises ValueError for a malformed message.
    """
    upgrade = topic.upgrade()
    decode = decoder(topic.type_name, schema_text(topic.type_name))

    def check(data: bytes) -> bytes:
        checked = upgrade(data) if upgrade else data
        message = decode(checked)
        if topic.type_name == TELEMETRY_TYPE:
            telemetry_from_message(message)
        return checked

    return check


def _offer(name: str, topic: Topic) -> QoSProfile:
    """Return the QoS for writing a topic. Raises ValueError if the topic cannot be written."""
    try:
        topic.upgrade()
        offers = recorded_qos(topic.qos)
    except ValueError as error:
        raise ValueError(f"topic {name}: {error}") from error
    return joint_offer(offers) if offers else QoSProfile(depth=10)
