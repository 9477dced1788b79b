# SPDX-License-Identifier: Apache-2.0
"""``ema attach``: monitor the joints of running robots, or of recordings."""

import json
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final, NamedTuple

import click
from click.core import ParameterSource

from ema_cli.bags.healthy_until import HealthyUntil
from ema_cli.main import ARGUMENTS
from ema_cli.options import REFUSED, UNUSABLE, network_option, values_of_options
from ema_cli.output import require_free
from ema_cli.processes.bringup import namespace_option, node_parameters_option
from ema_cli.processes.stop_request import ENDING, deferred_signals
from ema_cli.progress import progress_bar
from ema_core.acquisition import EFFORT_UNITS
from ema_core.files import complete_file
from ema_core.levels import OK

_LIVE: Final = ("topics", "accept_after", "folder", "namespace", "assignments", "network")


@click.command()
@click.argument("sources", metavar="[RECORDING...]", nargs=-1, type=click.Path(path_type=Path))
@click.option(
    "--healthy",
    metavar="UNTIL",
    callback=lambda _, __, text: None if text is None else _until(text),
    help="End of healthy RECORDINGS: a time (2026-11-03), duration (2h) or number of records (10).",
)
@click.option(
    "--mapping",
    "mapping_file",
    type=click.Path(path_type=Path),
    help="Mapping of the columns of RECORDINGS; by default, they are recognised as by `ema check`.",
)
@click.option(
    "--html",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Page on RECORDINGS to write (.html).",
)
@click.option("--json", "as_json", is_flag=True, help="Print the joints of RECORDINGS as JSON.")
@click.option("--replace", "overwrite", is_flag=True, help="Overwrite the page.")
@click.option(
    "--joint",
    "joints",
    multiple=True,
    metavar="PATTERN",
    help="Joint to monitor, such as elbow or 'left/*' (repeatable).",
)
@click.option(
    "--topic",
    "topics",
    multiple=True,
    metavar="TOPIC",
    help="Joint state topic to read (repeatable).",
)
@click.option(
    "--effort-unit", type=click.Choice(EFFORT_UNITS), help="Unit of the effort, if it is not N.m."
)
@click.option(
    "--accept-after",
    type=click.IntRange(0, 60),
    default=0,
    metavar="RECORDS",
    help="Records after which a baseline is accepted; 0: a person accepts it.",
)
@click.option(
    "--folder",
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder of baselines, history and logs; by default ema in ROS_HOME.",
)
@namespace_option
@node_parameters_option
@network_option
@click.pass_context
def attach(
    context: click.Context,
    sources: tuple[Path, ...],
    healthy: HealthyUntil | None,
    mapping_file: Path | None,
    html: Path | None,
    as_json: bool,
    overwrite: bool,
    joints: tuple[str, ...],
    topics: tuple[str, ...],
    effort_unit: str | None,
    accept_after: int,
    folder: Path | None,
    namespace: str,
    assignments: list[str],
    network: bool,
) -> None:
    """Monitor the joints of robots in the ROS graph until Ctrl-C, or of RECORDINGS.

    Live, all joints of joint state topics are listed and monitored, also joints that appear
    later. A joint is compared with its baseline, the healthy motion that was learned and accepted.
    The next run continues with the same baselines.

    RECORDINGS are bags, tables, LeRobot data sets, or folders of them. Their records up to
    --healthy are learned, and the later ones compared. Exit code 3: a joint is above OK, or is not
    judged.
    """
    if sources:
        if healthy is None:
            raise click.UsageError("--healthy is missing: which of the records are healthy?")
        _refuse_options(context, _LIVE, "is for running robots, without RECORDINGS")
        recorded = _Recorded(sources, healthy, mapping_file, joints, effort_unit, html, overwrite)
        _attach_recordings(recorded, shlex.join(context.meta[ARGUMENTS]), as_json=as_json)
        return
    _refuse_options(context, ("healthy", "mapping_file", "html", "as_json"), "needs RECORDINGS")
    with deferred_signals(*ENDING) as stop:
        # Imported here, because signals must be deferred before slow imports.
        from ema_cli.processes.attach_run import AttachOptions, run_attach

        options = AttachOptions(
            joints, topics, effort_unit, accept_after, folder, namespace, tuple(assignments)
        )
        has_failed = run_attach(options, stop, network=network)
    if has_failed:
        sys.exit(UNUSABLE)


def _until(text: str) -> HealthyUntil:
    with values_of_options():
        return HealthyUntil.of(text)


def _refuse_options(context: click.Context, names: Sequence[str], why: str) -> None:
    """Raise UsageError if the command line has one of the options ``names``."""
    for option in context.command.params:
        source = context.get_parameter_source(option.name or "")
        if option.name in names and source is ParameterSource.COMMANDLINE:
            raise click.UsageError(f"{option.opts[0]} {why}")


class _Recorded(NamedTuple):
    """Arguments of a run with recordings."""

    sources: tuple[Path, ...]
    healthy: HealthyUntil
    mapping_file: Path | None
    joints: tuple[str, ...]
    effort_unit: str | None
    page: Path | None
    overwrite: bool


def _attach_recordings(recorded: _Recorded, command: str, *, as_json: bool) -> None:
    """Compare the joints in recordings, print their state, and exit with 3 unless all are OK."""
    # Imported here, because only recordings need these modules.
    from ema_cli.bags.joint_course import follow_joint
    from ema_cli.bags.robot_files import find_recordings, joints_of
    from ema_cli.show.joint_table import joint_table, mapping_of, warnings_of

    paths, page = find_recordings(recorded.sources), recorded.page
    if page is not None:
        require_free(page, paths, overwrite=recorded.overwrite, endings=(".html", ".htm"))
    courses = []
    with progress_bar() as progress:
        joints = joints_of(paths, recorded.mapping_file, recorded.joints, recorded.effort_unit)
        task = progress.add_task("comparing records", total=len(joints))
        for joint in joints:
            courses.append(follow_joint(joint, recorded.healthy))
            progress.advance(task)
    if as_json:
        click.echo(json.dumps([mapping_of(course) for course in courses], indent=2))
    else:
        click.echo("\n".join(joint_table(courses)))
    for warning in warnings_of(courses):
        click.echo(f"warning: {warning}", err=True)
    if page is not None:
        from ema_cli.report.joints_page import joints_page

        title = ", ".join(path.name for path in recorded.sources)
        with complete_file(page) as partial:
            text = joints_page(title, courses, command)
            partial.write_text(text, encoding="utf-8", errors="backslashreplace")
        click.echo(f"{page}: the page", err=as_json)
    if any(course.level != OK for course in courses):
        sys.exit(REFUSED)
