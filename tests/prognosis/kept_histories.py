"""Histories of a few tests, in files."""

from pathlib import Path

from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.history_entry import Entry

from .made_tests import made_test

UNIT = ("flap", "SIM-0001")


def entry(number: int) -> Entry:
    return Entry(made_test(number, friction=min(0.01 * number, 0.9)), 10.0 * number, number + 1)


def kept(path: Path, n: int = 3) -> bytes:
    """A history of n tests in a file; returns what the file holds."""
    history = History(*UNIT, path)
    for number in range(n):
        history.append(entry(number))
    history.close()
    return path.read_bytes()


def hours(path: Path, unit: tuple[str, str] = UNIT) -> tuple[list[float], str]:
    history = History(*unit, path)
    history.close()
    return [item.hours for item in history.entries], history.problem
