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
from typing import Self, TypeVar

import numpy as np

from dechirp.core.errors import DechirpError, Mistake
from dechirp.core.findings import Finding
from dechirp.experiment.study.block import Failure

T = TypeVar("T")

NAME = "study.sqlite"
FORMAT_VERSION = 1
APPLICATION = int.from_bytes(b"FMCW")
"""By which SQLite files of ours are known."""
_TABLES = {"meta", "blocks", "ended", "theory", "failures", "findings"}


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

    @property
    def identity(self) -> dict[str, str]:
        """What the study was said to be when its folder was made."""
        return self._kept("identity", dict)

    @property
    def environments(self) -> list[dict[str, str]]:
        """Libraries and processors that it ran on, the first first."""
        return self._kept("environments", list)

    def done(self) -> np.ndarray:
        """Point and number of every block kept, (n_blocks, 2) int64, in this order."""
        rows = self._connection.execute("SELECT point, number FROM blocks ORDER BY point, number")
        flat = np.fromiter((number for row in rows for number in row), np.int64)
        return flat.reshape(-1, 2)

    def ended(self) -> dict[int, int]:
        """Number of blocks of the points that had enough before their last, by point."""
        return dict(self._connection.execute("SELECT point, n_blocks FROM ended"))

    def sums(self, point: int) -> np.ndarray:
        """Sums of the trials of a point in their order, (n_trials, n_columns) float64.

        A study that was interrupted may lack blocks between others: see `trials`.
        """
        rows = self._connection.execute(
            "SELECT n_trials, sums FROM blocks WHERE point = ? ORDER BY number", (point,)
        )
        return _joined(list(rows))

    def trials(self, point: int) -> np.ndarray:
        """Number of the trial of each row of `sums`, (n_trials,) int64."""
        rows = self._connection.execute(
            "SELECT first, n_trials FROM blocks WHERE point = ? ORDER BY number", (point,)
        )
        numbers = [np.arange(first, first + n, dtype=np.int64) for first, n in rows]
        return np.concatenate([np.empty(0, np.int64), *numbers])

    def all_sums(self) -> Iterator[tuple[int, np.ndarray]]:
        """Point and sums of every point that has any, one at a time, in their order."""
        # In the order of the file, where a point's blocks are near each other.
        rows = self._connection.execute(
            "SELECT point, n_trials, sums FROM blocks ORDER BY point, number"
        )
        for point, of_point in groupby(rows, itemgetter(0)):
            yield point, _joined([row[1:] for row in of_point])

    def theory(self, point: int) -> np.ndarray | None:
        """What theory gives for a point, (n,) float64, see `Layout.theory_of`.

        None before its first block.
        """
        row = self._connection.execute("SELECT numbers FROM theory WHERE point = ?", (point,))
        found = row.fetchone()
        return None if found is None else np.frombuffer(found[0], "<f8").astype(float)

    def n_failures(self) -> int:
        """Trials that raised."""
        return int(self._connection.execute("SELECT count(*) FROM failures").fetchone()[0])

    def failures(self) -> list[tuple[int, Failure]]:
        """Point and failure of all trials that raised, in their order."""
        rows = self._connection.execute(
            "SELECT point, trial, message FROM failures ORDER BY point, trial"
        )
        return [(point, Failure(trial, message)) for point, trial, message in rows]

    def findings(self) -> list[tuple[int, Finding]]:
        """Point and finding of all that was warned of, in the order of the points."""
        rows = self._connection.execute(
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
        yield from self._connection.execute(f"{query} ORDER BY point, number")

    def seconds(self) -> float:
        """Time that all blocks took, added."""
        return float(self._connection.execute("SELECT total(seconds) FROM blocks").fetchone()[0])

    @property
    def _has_items(self) -> bool:
        query = "SELECT count(*) FROM sqlite_master WHERE name = 'items'"
        return bool(self._connection.execute(query).fetchone()[0])

    def _said(self, key: str) -> str:
        row = self._connection.execute("SELECT said FROM meta WHERE key = ?", (key,)).fetchone()
        if row is None:
            raise _damaged(self.path)
        return str(row[0])

    def _kept(self, key: str, kind: type[T]) -> T:
        """A list or mapping that is kept as JSON."""
        try:
            found = json.loads(self._said(key))
        except ValueError:
            found = None
        if not isinstance(found, kind):
            raise _damaged(self.path)
        return found


def _joined(rows: Sequence[tuple[int, bytes]]) -> np.ndarray:
    """Rows of trials of blocks one below the other."""
    n_trials = sum(row[0] for row in rows)
    flat = np.frombuffer(b"".join([row[1] for row in rows]), "<f8")
    return flat.reshape(n_trials, -1) if n_trials else np.empty((0, 0))


def read_only(path: Path) -> sqlite3.Connection:
    """Open a record without writing to its folder."""
    uri = path.resolve().as_uri()
    connection = sqlite3.connect(f"{uri}?mode=ro", uri=True, isolation_level=None, timeout=60)
    try:
        connection.execute("PRAGMA schema_version")
    except sqlite3.OperationalError:
        connection.close()
        if path.with_name(f"{NAME}-wal").exists():
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
    if not names >= _TABLES:
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
        if "malformed" in str(error):
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
