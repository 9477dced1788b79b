"""The summary of an archive's fleet as JSON, for the page."""

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Final

from ema_dashboard.documents import Made

_LIMIT_S: Final = 5.0
_MOST: Final = 100
_NUMBERS: Final = frozenset(map(str, range(1, _MOST + 1)))
_MOST_KEPT: Final = 8


class FleetDocument:
    """Answers with the summary of a fleet: of each state of its tables it is made once.

    Parameters
    ----------
    archive
        Folder of the archive; empty when there is none.
    """

    def __init__(self, archive: str) -> None:
        self._archive = Path(archive).expanduser() if archive else None
        self._made: dict[object, bytes] = {}

    def __call__(self, query: Mapping[str, str], _: str) -> Made:
        """Return the summary, or the reason why there is none; ``most`` in the query limits it."""
        try:
            return _json(self._content(query.get("most", str(_MOST))))
        except (OSError, ValueError) as error:
            return _json(json.dumps({"reason": str(error)}).encode(), 503)

    def _content(self, most: str) -> bytes:
        if self._archive is None:
            return json.dumps({"archive": None}).encode()
        if most not in _NUMBERS:
            raise ValueError(f"most = {most[:20]!r}: expected 1 to {_MOST}")
        # What is needed for it takes a second to import.
        from ema_archive.fleet import fleet_summary, state_of_tables

        key = state_of_tables(self._archive), int(most)
        if key not in self._made:
            summary = asdict(fleet_summary(self._archive, int(most), _LIMIT_S))
            content = {"archive": self._archive.name, **summary}
            if len(self._made) >= _MOST_KEPT:
                self._made.clear()
            self._made[key] = json.dumps(content, allow_nan=False).encode()
        return self._made[key]


def _json(content: bytes, status: int = 200) -> Made:
    return Made(content, "application/json", status)
