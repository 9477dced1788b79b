# SPDX-License-Identifier: Apache-2.0
"""``ema baseline``: list, show, accept, extend and reset the learned baselines of joints."""

import getpass
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import click

from ema_cli.options import network_option
from ema_cli.show.baseline_table import BaselineSummary, details, table
from ema_core.wording import unknown_name
from ema_monitor.baselines.changes import BaselineChange, ChangeKind
from ema_monitor.baselines.progress import BaselineProgress
from ema_monitor.baselines.unit_baseline import (
    UnitBaseline,
    changes_of,
    default_folder,
    stored_units,
)
from ema_ros.actuator_file import load_description

_MONITOR: Final = "/ema/monitor"


def _places(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options that select a monitor or a folder to a command."""
    folder = click.option(
        "--folder",
        type=click.Path(path_type=Path, file_okay=False),
        help=(
            "Folder of baselines to use instead of the running monitor; by default "
            "ema/baselines in ROS_HOME if no monitor runs."
        ),
    )
    monitor = click.option(
        "--monitor", default=_MONITOR, help="Name of the running monitor to ask."
    )
    return folder(monitor(network_option(command)))


def _changing(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the arguments of a change of a baseline to a command."""
    joint = click.argument("joint")
    person = click.option(
        "--person",
        default=getpass.getuser,
        show_default="user name",
        help="Name of the person, stored in the history.",
    )
    note = click.option(
        "--note", default="", help="Reason, such as a repair; stored in the history."
    )
    force = click.option(
        "--force",
        is_flag=True,
        help="Proceed although the joint is in WARN or ERROR, or records depart from each other.",
    )
    return joint(person(note(force(_places(command)))))


@click.group()
def baseline() -> None:
    """List, show, accept, extend and reset the learned baselines of joints.

    A joint without a baseline is LEARNING: its monitor stores records until someone accepts them.
    The command asks the running monitor; if none is running, it reads and writes the folder.
    """


@baseline.command("list")
@_places
def list_baselines(folder: Path | None, monitor: str, network: bool) -> None:
    """List the joints with their state, records and smallest detectable change."""
    with _source(folder, monitor, network=network) as source:
        baselines = source.baselines()
    if baselines:
        click.echo(table(baselines))
    else:
        click.echo(f"no baselines in {source.where}", err=True)


@baseline.command()
@click.argument("joint")
@_places
def show(joint: str, folder: Path | None, monitor: str, network: bool) -> None:
    """Show the progress of a joint, what would improve its baseline, and all changes."""
    with _source(folder, monitor, network=network) as source:
        item = source.find(joint)
        click.echo(details(item, source.changes(item)))


@baseline.command()
@_changing
def accept(**values: Any) -> None:
    """Accept the collected records of JOINT as its baseline."""
    _change(ChangeKind.ACCEPT, **values)


@baseline.command()
@_changing
def extend(**values: Any) -> None:
    """Add the healthy records since the acceptance to the baseline of JOINT."""
    _change(ChangeKind.EXTEND, **values)


@baseline.command()
@_changing
def reset(**values: Any) -> None:
    """Discard baseline and records of JOINT, as after a repair, and learn again."""
    _change(ChangeKind.RESET, **values)


def _change(
    kind: ChangeKind,
    joint: str,
    person: str,
    note: str,
    force: bool,
    folder: Path | None,
    monitor: str,
    network: bool,
) -> None:
    with _source(folder, monitor, network=network) as source:
        item = source.find(joint)
        click.echo(f"{joint}: {source.change(item, kind, person, note, force=force)}")


class _Folder:
    """Baselines in a folder that no monitor uses."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self.where = str(folder)

    def baselines(self) -> list[BaselineSummary]:
        return [self._shown(path) for path in stored_units(self._folder).values()]

    def find(self, joint: str) -> BaselineSummary:
        return self._shown(self._path(joint))

    def changes(self, item: BaselineSummary) -> list[BaselineChange] | None:
        return changes_of(self._folder, item.actuator_id, item.serial_number)

    def change(
        self, item: BaselineSummary, kind: ChangeKind, person: str, note: str, *, force: bool
    ) -> str:
        with self._open(self._path(item.actuator_id)) as unit:
            if kind is ChangeKind.ACCEPT:
                return str(unit.accept(person, note, force=force))
            if kind is ChangeKind.EXTEND:
                return str(unit.extend(person, note, force=force))
            return str(unit.reset(person, note))

    def _path(self, joint: str) -> Path:
        units = stored_units(self._folder)
        if joint not in units:
            raise ValueError(f"{self._folder}: {unknown_name('joint', joint, units)}")
        return units[joint]

    def _open(self, path: Path) -> UnitBaseline:
        return UnitBaseline(self._folder, load_description(path))

    def _shown(self, path: Path) -> BaselineSummary:
        with self._open(path) as unit:
            if unit.is_fit_due:
                unit.fit()
            accepted = unit.accepted_by
            return BaselineSummary(
                *unit.description.unit_key,
                unit.is_accepted,
                unit.progress(),
                unit.calibration.calibration_id if unit.calibration else "",
                accepted.author if accepted else "",
                accepted.time_ns if accepted else 0,
            )


class _Monitor:
    """Baselines of a running monitor."""

    def __init__(self, client: Any, name: str) -> None:
        self._client = client
        self.where = name

    def baselines(self) -> list[BaselineSummary]:
        return [_of_message(status) for status in self._client.statuses()]

    def find(self, joint: str) -> BaselineSummary:
        by_name = {item.actuator_id: item for item in self.baselines()}
        if joint not in by_name:
            raise ValueError(f"{self.where}: {unknown_name('joint', joint, by_name)}")
        return by_name[joint]

    def changes(self, item: BaselineSummary) -> list[BaselineChange] | None:
        # The monitor may use another folder; on this machine it usually uses the default folder.
        return changes_of(default_folder(), item.actuator_id, item.serial_number) or None

    def change(
        self, item: BaselineSummary, kind: ChangeKind, person: str, note: str, *, force: bool
    ) -> str:
        from ema_interfaces.srv import ChangeBaseline

        return self._client.change(
            ChangeBaseline.Request(
                actuator_id=item.actuator_id,
                change=getattr(ChangeBaseline.Request, kind.name),
                person=person,
                note=note,
                force=force,
            )
        )


@contextmanager
def _source(folder: Path | None, monitor: str, *, network: bool) -> Iterator[_Folder | _Monitor]:
    """Yield the running monitor, or a folder if ``folder`` is set or no monitor is running."""
    if folder is not None:
        yield _Folder(folder)
        return
    # ROS is imported only if a monitor may run.
    from ema_cli.processes.baseline_client import BaselineClient
    from ema_cli.processes.reach import set_reach

    set_reach(network)
    with BaselineClient(monitor) as client:
        if client.finds_monitor():
            yield _Monitor(client, monitor)
            return
    yield _Folder(default_folder())


def _of_message(status: Any) -> BaselineSummary:
    from ema_ros.stamps import stamp_from_message

    progress = BaselineProgress(
        status.records,
        status.days,
        status.records_needed,
        status.slowest,
        status.fastest,
        status.forward_share,
        status.detectable_same_day,
        status.detectable_other_day,
        tuple(status.advice),
        status.reason,
    )
    return BaselineSummary(
        status.actuator_id,
        status.serial_number,
        status.state == status.ACCEPTED,
        progress,
        status.calibration_id,
        status.author,
        stamp_from_message(status.accepted),
    )
