"""The record of a study, to be added to: a block is durable before it is counted.

A study has one writer, which holds `study.lock` beside the file for as long as it lives; the
system lets go of it whatever ends the process.
"""

import json
import os
import sqlite3
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import astuple
from pathlib import Path
from typing import Self

import numpy as np

from dechirp.core.errors import DechirpError, Mistake
from dechirp.core.findings import Finding
from dechirp.experiment.study.block import Block
from dechirp.experiment.study.environment import differences
from dechirp.experiment.study.record import (
    APPLICATION,
    FORMAT_VERSION,
    NAME,
    Record,
    is_ours,
    read_only,
    refused,
    told,
)

LOCK = "study.lock"
FILES = (
    NAME,
    LOCK,
    *(f"{name}-{end}" for name in (NAME, LOCK) for end in ("wal", "shm", "journal")),
)
"""What may lie in the folder of a study because of this."""

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
        self._file = self.path.stat().st_ino
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
            with told(path, "Nothing was changed."), closing(read_only(path)) as connection:
                is_ours(connection, path)  # a file of somebody else is not touched
        lock = _locked(out)
        try:
            with told(path, "Nothing was added."):
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
            raise refused(
                out / NAME,
                got="on a file system that SQLite cannot keep a log on",
                need="on a local disk",
                fix="Name another folder with --out, and copy it afterwards.",
            )
        connection.execute("PRAGMA synchronous = FULL")
        ledger = cls(out, connection, lock, ())
        if not connection.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]:
            with ledger._transaction():
                connection.execute(f"PRAGMA application_id = {APPLICATION}")
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
        with told(self.path, kept), self._transaction():
            yield
        # A file that was removed takes what is added, and nobody ever reads it.
        if not self.path.exists() or self.path.stat().st_ino != self._file:
            raise refused(
                self.path,
                got="removed or replaced while the study ran",
                need="left alone until it ends",
                fix="Call again to begin anew; what was done is lost.",
            )

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


def _as_bytes(numbers: np.ndarray) -> bytes:
    return np.ascontiguousarray(numbers, "<f8").tobytes()


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
        raise refused(
            out,
            got="in use by another study that runs now",
            need="a folder that one process writes to",
            fix="Wait for it or end it, or name another folder with --out.",
        ) from None
    return lock


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


def _unwritable(out: Path, why: str) -> DechirpError:
    return refused(
        out,
        got=f"not writable ({why})",
        need="a folder that can be written",
        fix="Name another with --out.",
    )


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
