# SPDX-License-Identifier: Apache-2.0
"""``ema check``: recognise the columns of joints, and report what can be judged from them."""

import json
import sys
from pathlib import Path
from typing import Final

import click

from ema_bags.inputs.examination import Examination
from ema_bags.inputs.examine import UNKNOWN_JOINT, examine
from ema_bags.inputs.mapping import load_mapping
from ema_cli.options import REFUSED, network_option
from ema_cli.output import output_option, require_free
from ema_cli.show.examination_report import as_record, mapping_lines, report_lines
from ema_core.description import ActuatorDescription
from ema_ros.actuator_file import load_description

_SECONDS: Final = 10.0


@click.command()
@click.argument("sources", nargs=-1, required=True, metavar="SOURCE...")
@click.option(
    "--mapping",
    "mapping_file",
    type=click.Path(path_type=Path),
    help="Check this mapping instead of recognising the columns.",
)
@click.option(
    "--actuator",
    "actuator_file",
    type=click.Path(path_type=Path),
    help="Actuator file (YAML); by default a joint without a data sheet.",
)
@click.option("--joint", "joints", multiple=True, help="Joint to examine (repeatable).")
@click.option(
    "--seconds",
    type=click.FloatRange(min=0.1),
    default=_SECONDS,
    help="Time to listen to a topic [s]; Ctrl-C ends it earlier.",
)
@click.option("--mapping-only", is_flag=True, help="Print only the mapping.")
@click.option("--json", "as_json", is_flag=True, help="Print a list with one object per SOURCE.")
@output_option("YAML file to write the mapping to", required=False, dir_okay=False)
@network_option
def check(
    sources: tuple[str, ...],
    mapping_file: Path | None,
    actuator_file: Path | None,
    joints: tuple[str, ...],
    seconds: float,
    mapping_only: bool,
    as_json: bool,
    overwrite: bool,
    output: Path | None,
    network: bool,
) -> None:
    """Recognise the columns of each joint in SOURCE, and report defects.

    A SOURCE is a table (CSV, Parquet, .npz), a bag, the folder of a LeRobot data set, or a topic
    of a running robot such as /joint_states. The report also lists the quantities that can be
    judged, and ends with the mapping for `ema import`. Exit code 3: the friction of a joint cannot
    be judged, or an error prevents the import.
    """
    if output is not None:
        files = [Path(source) for source in sources if not _is_topic(source)]
        require_free(output, files, overwrite=overwrite)
    if mapping_only and as_json:
        raise click.UsageError("expected either --mapping-only or --json")
    mapping = load_mapping(mapping_file) if mapping_file else None
    description = load_description(actuator_file) if actuator_file else UNKNOWN_JOINT
    if topics := [source for source in sources if _is_topic(source)]:
        if mapping is not None:
            raise click.UsageError("--mapping is for files: topics have no columns")
        examinations = [_listened(topics, description, joints, seconds, network=network)]
    else:
        examinations = []
    examinations += [
        examine(Path(source), description, mapping=mapping, joints=joints)
        for source in sources
        if not _is_topic(source)
    ]
    if as_json:
        click.echo(json.dumps([as_record(item) for item in examinations], indent=2))
    for number, examination in enumerate(examinations if not as_json else ()):
        lines = mapping_lines(examination)
        if not mapping_only:
            lines = [*[""] * (number > 0), *report_lines(examination), "", *lines]
        click.echo("\n".join(lines))
    if output is not None:
        text = "\n".join(mapping_lines(examinations[0])) + "\n"
        output.write_text(text, encoding="utf-8")
        click.echo(f"{output}: the mapping", err=True)
    if not all(joint.is_sound for item in examinations for joint in item.joints):
        sys.exit(REFUSED)


def _is_topic(source: str) -> bool:
    """Return whether a source is a topic, and not the absolute path of an existing file."""
    return source.startswith("/") and not Path(source).exists()


def _listened(
    topics: list[str],
    description: ActuatorDescription,
    joints: tuple[str, ...],
    seconds: float,
    *,
    network: bool,
) -> Examination:
    """Collect messages of a running robot from topics and examine them."""
    from ema_bags.inputs.examine import examine_topics
    from ema_cli.processes.joint_listener import collect
    from ema_cli.processes.reach import set_reach

    set_reach(network)
    names = ", ".join(topics)

    def announce() -> None:
        click.echo(f"listening to {names} for {seconds:g} s; Ctrl-C ends it", err=True)

    collected = collect(topics, seconds, announce)
    return examine_topics(collected, names, description, joints=joints)
