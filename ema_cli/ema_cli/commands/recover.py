"""``ema recover``: what is intact of a damaged bag, to a whole one."""

from collections.abc import Callable
from pathlib import Path

import click
from rclpy.qos import QoSProfile

from ema_bags.message_type import message_class
from ema_bags.qos import joint_offer, recorded_qos
from ema_bags.reader import Bag, Recorded, Topic
from ema_bags.schema import decoder, schema_text, to_installed
from ema_bags.telemetry import TELEMETRY_TYPE
from ema_cli.bags.output_path import require_apart
from ema_cli.errors import one_clear_line
from ema_cli.new_bag import new_bag
from ema_cli.processes.stop_request import deferred_signals
from ema_cli.show.progress import progress_bar
from ema_core.wording import counted
from ema_ros.messages import telemetry_from_message


@click.command()
@click.argument("bag", type=click.Path(path_type=Path))
@click.option(
    "-o",
    "--output",
    required=True,
    type=click.Path(path_type=Path),
    help="Bag to write: one file if it ends in .mcap, else a folder.",
)
@click.option("--replace", "overwrite", is_flag=True, help="Replace an existing bag.")
def recover(bag: Path, output: Path, overwrite: bool) -> None:
    """Write what is intact of BAG, left by a recorder that was killed, to a bag with an index.

    A message that is malformed is left out, as are telemetry with columns of different lengths and
    times of 2^63 ns or more.
    """
    with one_clear_line():
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
                    raise click.Abort
                try:
                    message = checks[item.topic](item.message)
                    _require_times(item)
                except ValueError as error:
                    damaged.note_malformed(item, str(error))
                    continue
                whole.write_serialized(item.topic, message, item.log_time_ns, item.publish_time_ns)
                written += 1
    for remark in damaged.remarks:
        click.echo(f"{bag}: {remark}", err=True)
    click.echo(f"{output}: {counted(written, 'message')} on {counted(len(names), 'topic')}")


def _require_times(item: Recorded) -> None:
    """Refuse times that MCAP has room for, and a bag of ROS has not."""
    times = {"log_time": item.log_time_ns, "publish_time": item.publish_time_ns}
    for name, time_ns in times.items():
        if time_ns >= 2**63:
            raise ValueError(f"{name} = {time_ns} ns is outside [0, 2^63) ns")


def _checked(topic: Topic) -> Callable[[bytes], bytes]:
    """Return what makes a message of the installed type of a recorded one; ValueError if none."""
    upgrade = to_installed(*topic.identity)
    decode = decoder(topic.type_name, schema_text(topic.type_name))

    def check(data: bytes) -> bytes:
        checked = upgrade(data) if upgrade else data
        message = decode(checked)
        if topic.type_name == TELEMETRY_TYPE:
            telemetry_from_message(message)
        return checked

    return check


def _offer(name: str, topic: Topic) -> QoSProfile:
    """Return what is noted of a topic that can be written anew."""
    try:
        to_installed(*topic.identity)
        offers = recorded_qos(topic.qos)
    except ValueError as error:
        raise ValueError(f"topic {name}: {error}") from error
    return joint_offer(offers) if offers else QoSProfile(depth=10)
