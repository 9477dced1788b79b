"""The files of an archive's tables: which there are, and which are not as they were written."""

from collections.abc import Iterable
from pathlib import Path

from ema_archive.database import Database, transaction
from ema_archive.partitions import place_of, quoted
from ema_archive.sources import content_digest
from ema_core.wording import counted


class FileRecords(Database):
    """Notes each file of the tables by size and digest; what is damaged is made anew."""

    def note_files(self, paths: Iterable[Path]) -> None:
        """Note files as they were just written, or that they are not there."""
        rows, gone = [], []
        for path in paths:
            name = str(path.relative_to(self.archive))
            if path.exists():
                stat = path.stat()
                rows.append((name, stat.st_size, stat.st_mtime_ns, content_digest(path)))
            else:
                gone.append((name,))
        with transaction(self._db):
            self._db.executemany("INSERT OR REPLACE INTO file VALUES (?, ?, ?, ?)", rows)
            self._db.executemany("DELETE FROM file WHERE path = ?", gone)

    def damaged_files(self) -> list[Path]:
        """Return the files that are missing, or not as they were written."""
        rows = self._db.execute("SELECT path, size, changed_ns, sha256 FROM file ORDER BY path")
        found = ((self.archive / name, *noted) for name, *noted in rows)
        return [path for path, *noted in found if not _is_as_noted(path, *noted)]

    def mend(self) -> list[str]:
        """Have what is damaged made anew; return what was found, and what cannot be, in words."""
        damaged = self.damaged_files()
        if not damaged:
            return []
        parts = self._db.execute("SELECT url, unit, months FROM part").fetchall()
        due, units = set[str](), set[str]()
        for path in damaged:
            table, unit, month = place_of(path.relative_to(self.archive))
            path.unlink(missing_ok=True)
            units |= {name for _, name, _ in parts if quoted(name) == unit}
            if table != "health":
                due |= {
                    url
                    for url, name, months in parts
                    if quoted(name) == unit and month in months.split()
                }
        with transaction(self._db):
            self._db.executemany(
                "UPDATE bag SET state = 'interrupted' WHERE url = ?", [(url,) for url in due]
            )
            self._db.executemany(
                "UPDATE unit SET is_due = 1, made_by = '' WHERE unit = ?",
                [(unit,) for unit in units],
            )
        self.note_files(damaged)
        words = [f"{counted(len(damaged), 'file')} of the tables missing or damaged: made anew"]
        gone = [
            url
            for url in sorted(due)
            if self._count(f"bag WHERE url = ? AND NOT {self.there}", (url,))
        ]
        if gone:
            words.append(
                f"{counted(len(gone), 'bag')} of these tables no longer there, such as {gone[0]}: "
                "bring them back and scan, or their windows are lost"
            )
        return words


def _is_as_noted(path: Path, size: int, changed_ns: int, sha256: str) -> bool:
    try:
        stat = path.stat()
    except OSError:
        return False
    if stat.st_size != size:
        return False
    # One that was copied is as it was.
    return stat.st_mtime_ns == changed_ns or content_digest(path) == sha256
