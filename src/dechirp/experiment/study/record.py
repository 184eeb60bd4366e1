"""What a study has done, as it is read: one SQLite file, also while the study runs.

Readers need no lock and disturb nobody; `ledger` adds to it.
"""

import json
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import groupby
from operator import itemgetter
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from dechirp.core.errors import DechirpError, Mistake
from dechirp.core.findings import Finding
from dechirp.experiment.study.block import Failure

NAME = "study.sqlite"
FORMAT_VERSION = 1
APPLICATION = int.from_bytes(b"FMCW")
"""By which SQLite files of ours are known."""


def _counts(*columns: str) -> str:
    return " AND ".join(f"typeof({one}) = 'integer' AND {one} >= 0" for one in columns)


def _texts(*columns: str) -> str:
    return " AND ".join(f"typeof({one}) = 'text'" for one in columns)


# SQLite keeps what it is given in any column: what each row of ours is.
_ROWS = {
    "meta": _texts("key", "said"),
    "blocks": _counts("point", "number", "first", "n_trials")
    + " AND n_trials > 0 AND first < 1 << 53 AND typeof(seconds) = 'real'"
    " AND typeof(sums) = 'blob' AND length(sums) % (8 * n_trials) = 0",
    "ended": _counts("point", "n_blocks"),
    "theory": _counts("point") + " AND typeof(numbers) = 'blob' AND length(numbers) % 8 = 0",
    "failures": _counts("point", "number", "trial") + " AND " + _texts("message"),
    "findings": _counts("point")
    + " AND level IN ('note', 'warning', 'error') AND "
    + _texts("level", "setting", "got", "need", "fix"),
}


class Record:
    """What is kept of a study, to be read, also while it runs.

    A context manager: it closes the file.
    """

    def __init__(self, out: Path, connection: sqlite3.Connection) -> None:
        self.path = out / NAME
        self._connection = connection

    @classmethod
    def read(cls, out: Path) -> Self:
        """Open the record of a study in a folder.

        Raises
        ------
        DechirpError
            If there is none, or it cannot be read.
        """
        path = out / NAME
        if not path.is_file():
            raise refused(
                path,
                got="not there",
                need="the record of a study",
                fix="Name the folder that `dechirp study` wrote.",
            )
        with told(path, "Nothing was changed."):
            connection = read_only(path)
            try:
                if not is_ours(connection, path):
                    raise refused(
                        path,
                        got="empty",
                        need="the record of a study",
                        fix="Run the study first.",
                    )
            except BaseException:
                connection.close()
                raise
        return cls(out, connection)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the file; what was added is on disk already."""
        self._connection.close()

    def must_have(self, *, n_columns: int, n_laws: int = 0) -> None:
        """Raise `DechirpError` if there is a trial of other sums, or a point of other theory.

        Parameters
        ----------
        n_columns : int
            Numbers of a trial in `sums`.
        n_laws : int, optional
            Numbers of a point in `theory`.
        """
        other = "SELECT 1 FROM blocks WHERE length(sums) != 8 * n_trials * ?"
        theory = "SELECT 1 FROM theory WHERE length(numbers) != 8 * ?"
        for _ in self._rows(f"{other} UNION ALL {theory} LIMIT 1", n_columns, n_laws):
            raise _damaged(self.path)

    @property
    def identity(self) -> dict[str, str]:
        """What the study was said to be when its folder was made."""
        found = self._kept("identity")
        if not _is_words(found):
            raise _damaged(self.path)
        return found

    @property
    def environments(self) -> list[dict[str, str]]:
        """Libraries and processors that it ran on, the first first."""
        found = self._kept("environments")
        if not isinstance(found, list) or not found or not all(map(_is_words, found)):
            raise _damaged(self.path)
        return found

    def done(self) -> np.ndarray:
        """Point and number of every block kept, (n_blocks, 2) int64, in this order."""
        rows = self._rows("SELECT point, number FROM blocks ORDER BY point, number")
        flat = np.fromiter((number for row in rows for number in row), np.int64)
        return flat.reshape(-1, 2)

    def ended(self) -> dict[int, int]:
        """Number of blocks of the points that had enough before their last, by point."""
        return dict(self._rows("SELECT point, n_blocks FROM ended"))

    def sums(self, point: int) -> np.ndarray:
        """Sums of the trials of a point in their order, (n_trials, n_columns) float64.

        A study that was interrupted may lack blocks between others: see `trials`.
        """
        rows = self._rows(
            "SELECT n_trials, sums FROM blocks WHERE point = ? ORDER BY number", point
        )
        return self._joined(list(rows))

    def trials(self, point: int) -> np.ndarray:
        """Number of the trial of each row of `sums`, (n_trials,) int64."""
        rows = self._rows(
            "SELECT first, n_trials FROM blocks WHERE point = ? ORDER BY number", point
        )
        numbers = [np.arange(first, first + n, dtype=np.int64) for first, n in rows]
        return np.concatenate([np.empty(0, np.int64), *numbers])

    def all_sums(self) -> Iterator[tuple[int, np.ndarray]]:
        """Point and sums of every point that has any, one at a time, in their order."""
        # In the order of the file, where a point's blocks are near each other.
        rows = self._rows("SELECT point, n_trials, sums FROM blocks ORDER BY point, number")
        for point, of_point in groupby(rows, itemgetter(0)):
            yield point, self._joined([row[1:] for row in of_point])

    def theory(self, point: int) -> np.ndarray | None:
        """What theory gives for a point, (n,) float64, see `Layout.theory_of`.

        None before its first block.
        """
        for (numbers,) in self._rows("SELECT numbers FROM theory WHERE point = ?", point):
            return np.frombuffer(numbers, "<f8").astype(float)
        return None

    def n_failures(self) -> int:
        """Trials that raised."""
        return int(self._number("SELECT count(*) FROM failures"))

    def failures(self) -> list[tuple[int, Failure]]:
        """Point and failure of all trials that raised, in their order."""
        rows = self._rows("SELECT point, trial, message FROM failures ORDER BY point, trial")
        return [(point, Failure(trial, message)) for point, trial, message in rows]

    def findings(self) -> list[tuple[int, Finding]]:
        """Point and finding of all that was warned of, in the order of the points."""
        rows = self._rows(
            "SELECT point, level, setting, got, need, fix FROM findings ORDER BY point, rowid"
        )
        return [
            (point, Finding(level=level, setting=setting, got=got, need=need, fix=fix))
            for point, level, setting, got, need, fix in rows
        ]

    def items(self, *, number: int | None = None) -> Iterator[tuple[int, int, bytes]]:
        """Point, number and what a data set keeps of each block, in this order.

        `number`: of blocks of that number alone.
        """
        if not self._has_items:
            return
        query = "SELECT point, number, content FROM items"
        if number is not None:
            query += f" WHERE number = {int(number)}"
        yield from self._rows(f"{query} ORDER BY point, number")

    def seconds(self) -> float:
        """Time that all blocks took, added."""
        return float(self._number("SELECT total(seconds) FROM blocks"))

    @property
    def _has_items(self) -> bool:
        query = "SELECT count(*) FROM sqlite_master WHERE name = 'items'"
        return bool(self._number(query))

    def _said(self, key: str) -> str:
        for (said,) in self._rows("SELECT said FROM meta WHERE key = ?", key):
            return str(said)
        raise _damaged(self.path)

    def _kept(self, key: str) -> Any:
        """What is kept as JSON."""
        try:
            return json.loads(self._said(key))
        except (ValueError, RecursionError):
            raise _damaged(self.path) from None

    def _joined(self, rows: Sequence[tuple[int, bytes]]) -> np.ndarray:
        """Rows of trials of blocks one below the other."""
        if len({len(sums) // n_trials for n_trials, sums in rows}) > 1:
            raise _damaged(self.path)
        n_trials = sum(n_trials for n_trials, _ in rows)
        flat = np.frombuffer(b"".join([sums for _, sums in rows]), "<f8")
        return flat.reshape(n_trials, -1) if n_trials else np.empty((0, 0))

    def _number(self, query: str) -> float:
        ((number,),) = self._rows(query)
        return float(number)

    def _rows(self, query: str, *given: object) -> Iterator[tuple[Any, ...]]:
        """Answer a query, a row at a time."""
        with told(self.path, "Nothing was changed."):
            # `yield from` would close the rows too, which fails once the file is closed.
            for row in self._connection.execute(query, given):  # noqa: UP028
                yield row


def _is_words(found: object) -> bool:
    return isinstance(found, dict) and all(isinstance(one, str) for one in found.values())


def read_only(path: Path) -> sqlite3.Connection:
    """Open a record without writing to its folder."""
    uri = path.resolve().as_uri()
    connection = sqlite3.connect(f"{uri}?mode=ro", uri=True, isolation_level=None, timeout=60)
    try:
        connection.execute("PRAGMA schema_version")
    except sqlite3.DatabaseError as error:
        connection.close()
        has_log = path.with_name(f"{NAME}-wal").exists()
        if has_log or not isinstance(error, sqlite3.OperationalError):
            raise
        # A finished study in a folder that cannot be written, where SQLite's index of the log
        # has no place.
        return sqlite3.connect(f"{uri}?immutable=1", uri=True, isolation_level=None)
    return connection


def is_ours(connection: sqlite3.Connection, path: Path) -> bool:
    """Whether there is a record, not only an empty file; raise if it is something else."""
    (application,) = connection.execute("PRAGMA application_id").fetchone()
    n_tables = connection.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]
    if application != APPLICATION and n_tables:
        raise _not_ours(path, "a database of something else")
    if not n_tables:  # killed before its tables were made: the next writer makes them
        return False
    names = {name for (name,) in connection.execute("SELECT name FROM sqlite_master")}
    if not names >= set(_ROWS):
        raise _damaged(path)
    query = "SELECT said FROM meta WHERE key = 'format_version'"
    row = connection.execute(query).fetchone()
    if row is None:
        raise _damaged(path)
    found = row[0]
    if str(found) != str(FORMAT_VERSION):
        raise refused(
            path,
            got=f"in format {found}",
            need=f"in format {FORMAT_VERSION}, which this version of dechirp writes",
            fix="Go on with the version that began it, or name another folder with --out.",
        )
    others = (f"SELECT 1 FROM {table} WHERE NOT ({row})" for table, row in _ROWS.items())
    if connection.execute(f"{' UNION ALL '.join(others)} LIMIT 1").fetchone():
        raise _damaged(path)
    return True


@contextmanager
def told(path: Path, kept: str) -> Iterator[None]:
    """Say of what SQLite raises where it was, and what is left."""
    try:
        yield
    except UnicodeDecodeError:
        raise _damaged(path) from None
    except sqlite3.Error as error:
        if "not a database" in str(error):
            raise _not_ours(path, "no database") from None
        if "malformed" in str(error) or "no such" in str(error):
            raise _damaged(path) from None
        is_full = "full" in str(error)
        raise refused(
            path.parent,
            got="on a full disk" if is_full else f"not usable ({error})",
            need="a folder with room" if is_full else "one that can be read and written",
            fix=kept,
        ) from None


def _damaged(path: Path) -> DechirpError:
    fix = "Bring back a copy, or name another folder with --out."
    return refused(path, got="damaged", need="whole", fix=fix)


def _not_ours(path: Path, got: str) -> DechirpError:
    return refused(
        path,
        got=got,
        need="the record of a study, or absent",
        fix="Name another folder with --out.",
    )


def refused(path: Path, *, got: str, need: str, fix: str) -> DechirpError:
    """Make the error of a folder or file that cannot be used."""
    return DechirpError(Mistake(setting=f"--out: {path}", got=got, need=need, fix=fix))
