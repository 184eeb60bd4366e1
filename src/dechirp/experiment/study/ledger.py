"""What a study has done, in one SQLite file: a block is durable before it is counted.

A study has one writer, which holds `study.lock` beside the file for as long as it lives; the
system lets go of it whatever ends the process. Readers need no lock and disturb nobody.
"""

import json
import os
import sqlite3
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import astuple
from itertools import groupby
from operator import itemgetter
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np

from dechirp.core.errors import DechirpError, Mistake
from dechirp.core.findings import Finding
from dechirp.experiment.study.block import Block, Failure
from dechirp.experiment.study.environment import differences

NAME = "study.sqlite"
LOCK = "study.lock"
FILES = (
    NAME,
    LOCK,
    *(f"{name}-{end}" for name in (NAME, LOCK) for end in ("wal", "shm", "journal")),
)
"""What may lie in the folder of a study because of this."""
FORMAT_VERSION = 1
_APPLICATION = int.from_bytes(b"FMCW")

# Sums are little-endian float64, a row a trial; their columns are the same in all blocks.
_TABLES = """
CREATE TABLE meta (key TEXT PRIMARY KEY, said TEXT NOT NULL) WITHOUT ROWID;
CREATE TABLE blocks (
    point INTEGER NOT NULL, number INTEGER NOT NULL, first INTEGER NOT NULL,
    n_trials INTEGER NOT NULL, seconds REAL NOT NULL, sums BLOB NOT NULL,
    PRIMARY KEY (point, number));
CREATE TABLE failures (
    point INTEGER NOT NULL, number INTEGER NOT NULL, trial INTEGER NOT NULL,
    message TEXT NOT NULL, PRIMARY KEY (point, trial)) WITHOUT ROWID;
CREATE TABLE findings (
    point INTEGER NOT NULL, level TEXT NOT NULL, setting TEXT NOT NULL, got TEXT NOT NULL,
    need TEXT NOT NULL, fix TEXT NOT NULL, UNIQUE (point, level, setting, got, need, fix));
CREATE TABLE theory (point INTEGER PRIMARY KEY, numbers BLOB NOT NULL);
CREATE TABLE ended (point INTEGER PRIMARY KEY, n_blocks INTEGER NOT NULL);
"""
# Only studies that keep a data set have it.
_ITEMS = """
CREATE TABLE IF NOT EXISTS items (
    point INTEGER NOT NULL, number INTEGER NOT NULL, content BLOB NOT NULL,
    PRIMARY KEY (point, number))
"""

_LONGEST_MESSAGE = 2000
_LONGEST_SHOWN = 100


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
            raise _refused(
                path,
                got="not there",
                need="the record of a study",
                fix="Name the folder that `dechirp study` wrote.",
            )
        with _told(path, "Nothing was changed."):
            connection = _read_only(path)
            try:
                if not _is_ours(connection, path):
                    raise _refused(
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
        return dict(json.loads(self._said("identity")))

    @property
    def environments(self) -> list[dict[str, str]]:
        """Libraries and processors that it ran on, the first first."""
        return list(json.loads(self._said("environments")))

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
        return str(row[0])


class Ledger(Record):
    """The record of a study, to be added to: by one process at a time."""

    def __init__(
        self,
        out: Path,
        connection: sqlite3.Connection,
        lock: sqlite3.Connection,
        findings: Sequence[Finding],
    ) -> None:
        super().__init__(out, connection)
        self._lock = lock
        self.doubts = tuple(findings)
        """That it was begun with other libraries or on another processor."""

    @classmethod
    def open(
        cls, out: Path, *, identity: Mapping[str, str], environment: Mapping[str, str]
    ) -> Self:
        """Begin the record of a study in a folder, or go on with it.

        Parameters
        ----------
        out : Path
            Made if it is not there.
        identity : mapping
            What the results depend on, as text by name: study file, scenario, version. Another
            one is refused, with the first lines that differ.
        environment : mapping
            Libraries and processor, see `environment.py`. Another one is a finding: results may
            differ in their last bits.

        Raises
        ------
        DechirpError
            If the folder is another study's or somebody else's, another process writes to it, or
            it cannot be written.
        """
        path = out / NAME
        try:
            out.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise _unwritable(out, error.strerror or str(error)) from None
        if path.exists():
            with _told(path, "Nothing was changed."), closing(_read_only(path)) as connection:
                _is_ours(connection, path)  # a file of somebody else is not touched
        lock = _locked(out)
        try:
            with _told(path, "Nothing was added."):
                connection = sqlite3.connect(path, isolation_level=None, timeout=60)
                try:
                    return cls._begun(out, connection, lock, dict(identity), dict(environment))
                except BaseException:
                    connection.close()
                    raise
        except BaseException:
            lock.close()
            raise

    @classmethod
    def _begun(
        cls,
        out: Path,
        connection: sqlite3.Connection,
        lock: sqlite3.Connection,
        identity: dict[str, str],
        environment: dict[str, str],
    ) -> Self:
        (mode,) = connection.execute("PRAGMA journal_mode = WAL").fetchone()
        if mode != "wal":
            raise _refused(
                out / NAME,
                got="on a file system that SQLite cannot keep a log on",
                need="on a local disk",
                fix="Name another folder with --out, and copy it afterwards.",
            )
        connection.execute("PRAGMA synchronous = FULL")
        ledger = cls(out, connection, lock, ())
        if not connection.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]:
            with ledger._transaction():
                connection.execute(f"PRAGMA application_id = {_APPLICATION}")
                for statement in _TABLES.split(";\n"):
                    connection.execute(statement)
                ledger._say("format_version", str(FORMAT_VERSION))
                ledger._say("identity", json.dumps(identity))
                ledger._say("environments", json.dumps([environment]))
            _make_names_durable(out)
        _must_be_same(ledger.path, ledger.identity, identity)
        before = ledger.environments
        if environment not in before:
            with ledger._transaction():
                ledger._say("environments", json.dumps([*before, environment]))
        if environment != before[0]:
            ledger.doubts = (_doubt(ledger.path, before[0], environment),)
        return ledger

    def close(self) -> None:
        """Close the file and let the next process write."""
        super().close()
        self._lock.close()

    def add(self, blocks: Iterable[Block]) -> None:
        """Keep blocks: all of them, or, if this raises, none. They are on disk on return.

        Raises
        ------
        DechirpError
            If the disk is full, or fails. What was kept before stays.
        """
        blocks = list(blocks)
        with self._adding():
            self._connection.executemany(
                "INSERT OR IGNORE INTO blocks VALUES (?, ?, ?, ?, ?, ?)",
                (
                    (b.point, b.number, b.first, len(b.sums), b.seconds, _as_bytes(b.sums))
                    for b in blocks
                ),
            )
            self._connection.executemany(
                "INSERT OR IGNORE INTO failures VALUES (?, ?, ?, ?)",
                (
                    (block.point, block.number, one.trial, one.message[:_LONGEST_MESSAGE])
                    for block in blocks
                    for one in block.failures
                ),
            )
            self._connection.executemany(
                "INSERT OR IGNORE INTO findings VALUES (?, ?, ?, ?, ?, ?)",
                ((block.point, *astuple(one)) for block in blocks for one in block.findings),
            )
            self._connection.executemany(
                "INSERT OR IGNORE INTO theory VALUES (?, ?)",
                ((b.point, _as_bytes(b.theory)) for b in blocks if b.theory is not None),
            )
            items = [(block.point, block.number, block.items) for block in blocks if block.items]
            if items:
                self._connection.execute(_ITEMS)
                self._connection.executemany("INSERT OR IGNORE INTO items VALUES (?, ?, ?)", items)

    def end(self, point: int, n_blocks: int) -> None:
        """Say that a point has enough after so many blocks, and drop those past it.

        Raises
        ------
        DechirpError
            If the disk is full, or fails.
        """
        with self._adding():
            past = (point, n_blocks)
            self._connection.execute("DELETE FROM blocks WHERE point = ? AND number >= ?", past)
            self._connection.execute("DELETE FROM failures WHERE point = ? AND number >= ?", past)
            if self._has_items:
                self._connection.execute("DELETE FROM items WHERE point = ? AND number >= ?", past)
            self._connection.execute("INSERT OR REPLACE INTO ended VALUES (?, ?)", past)

    def _say(self, key: str, said: str) -> None:
        self._connection.execute("INSERT OR REPLACE INTO meta VALUES (?, ?)", (key, said))

    @contextmanager
    def _adding(self) -> Iterator[None]:
        kept = "What was done before is kept. Mend it, and call again to go on."
        with _told(self.path, kept), self._transaction():
            yield

    @contextmanager
    def _transaction(self) -> Iterator[None]:
        self._connection.execute("BEGIN IMMEDIATE")
        try:
            yield
            self._connection.execute("COMMIT")
        except BaseException:
            with suppress(sqlite3.Error):  # a full disk has rolled it back already
                self._connection.execute("ROLLBACK")
            raise


def _joined(rows: Sequence[tuple[int, bytes]]) -> np.ndarray:
    """Rows of trials of blocks one below the other."""
    n_trials = sum(row[0] for row in rows)
    flat = np.frombuffer(b"".join([row[1] for row in rows]), "<f8")
    return flat.reshape(n_trials, -1) if n_trials else np.empty((0, 0))


def _as_bytes(numbers: np.ndarray) -> bytes:
    return np.ascontiguousarray(numbers, "<f8").tobytes()


def _read_only(path: Path) -> sqlite3.Connection:
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


def _locked(out: Path) -> sqlite3.Connection:
    """Hold the lock of a folder, for as long as the connection is open.

    A transaction of SQLite on an empty file: its locks are the system's on every system, and
    go with the process that holds them.
    """
    path = out / LOCK
    try:
        lock = sqlite3.connect(path, isolation_level=None, timeout=0)
    except sqlite3.Error as error:
        raise _unwritable(out, str(error)) from None
    try:
        lock.execute("BEGIN EXCLUSIVE")
    except sqlite3.DatabaseError as error:
        lock.close()
        if "locked" not in str(error):
            raise _unwritable(out, str(error)) from None
        raise _refused(
            out,
            got="in use by another study that runs now",
            need="a folder that one process writes to",
            fix="Wait for it or end it, or name another folder with --out.",
        ) from None
    return lock


def _is_ours(connection: sqlite3.Connection, path: Path) -> bool:
    """Whether there is a record, not only an empty file; raise if it is something else."""
    (application,) = connection.execute("PRAGMA application_id").fetchone()
    n_tables = connection.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]
    if application != _APPLICATION and n_tables:
        raise _not_ours(path, "a database of something else")
    if not n_tables:  # killed before its tables were made: the next writer makes them
        return False
    query = "SELECT said FROM meta WHERE key = 'format_version'"
    (found,) = connection.execute(query).fetchone()
    if int(found) != FORMAT_VERSION:
        raise _refused(
            path,
            got=f"in format {found}",
            need=f"in format {FORMAT_VERSION}, which this version of dechirp writes",
            fix="Go on with the version that began it, or name another folder with --out.",
        )
    return True


def _must_be_same(path: Path, kept: dict[str, str], asked: dict[str, str]) -> None:
    names = differences(kept, asked)
    if not names:
        return
    raise DechirpError(
        *(
            _mistake(
                path,
                setting=name,
                got=asked_line,
                need=f"{kept_line}, as in the results that are there",
                fix="Name another folder with --out, or remove this one to begin anew.",
            )
            for name in names
            for kept_line, asked_line in [
                _first_difference(kept.get(name, ""), asked.get(name, ""))
            ]
        )
    )


def _first_difference(kept: str, asked: str) -> tuple[str, str]:
    """First lines of two texts that differ, each as it is shown."""
    lines = kept.splitlines(), asked.splitlines()
    n_same = 0
    for first, second in zip(*lines, strict=False):
        if first != second:
            break
        n_same += 1
    is_long = max(map(len, lines)) > 1
    place = f" (line {n_same + 1})" if is_long else ""
    shown = [
        f"{_cut(text[n_same].strip())}{place}" if n_same < len(text) else "absent" for text in lines
    ]
    return shown[0], shown[1]


def _cut(line: str) -> str:
    return line if len(line) <= _LONGEST_SHOWN else f"{line[: _LONGEST_SHOWN - 3]}..."


def _doubt(path: Path, first: dict[str, str], now: dict[str, str]) -> Finding:
    changed = differences(first, now)

    def shown(environment: dict[str, str]) -> str:
        return ", ".join(f"{name} {environment.get(name, 'unknown')}" for name in changed)

    return Finding(
        level="warning",
        setting=str(path),
        got=f"now {shown(now)}, begun with {shown(first)}",
        need="the same libraries and processor for results that are equal to the bit",
        fix="They are as right; last bits may differ, and a trial at a threshold with them.",
    )


@contextmanager
def _told(path: Path, kept: str) -> Iterator[None]:
    """Say of what SQLite raises where it was, and what is left."""
    try:
        yield
    except sqlite3.Error as error:
        if "not a database" in str(error):
            raise _not_ours(path, "no database") from None
        if "malformed" in str(error):
            raise _refused(
                path,
                got="damaged",
                need="whole",
                fix="Bring back a copy, or name another folder with --out.",
            ) from None
        is_full = "full" in str(error)
        raise _refused(
            path.parent,
            got="on a full disk" if is_full else f"not usable ({error})",
            need="a folder with room" if is_full else "one that can be read and written",
            fix=kept,
        ) from None


def _not_ours(path: Path, got: str) -> DechirpError:
    return _refused(
        path,
        got=got,
        need="the record of a study, or absent",
        fix="Name another folder with --out.",
    )


def _unwritable(out: Path, why: str) -> DechirpError:
    return _refused(
        out,
        got=f"not writable ({why})",
        need="a folder that can be written",
        fix="Name another with --out.",
    )


def _refused(path: Path, *, got: str, need: str, fix: str) -> DechirpError:
    return DechirpError(Mistake(setting=f"--out: {path}", got=got, need=need, fix=fix))


def _mistake(path: Path, *, setting: str, got: str, need: str, fix: str) -> Mistake:
    return Mistake(file=str(path), setting=setting, got=got, need=need, fix=fix)


def _make_names_durable(out: Path) -> None:
    """Let a new file survive a loss of power: not only its content, its name too."""
    if os.name == "posix":
        folder = os.open(out, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)
