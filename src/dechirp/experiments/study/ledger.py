"""Ledger of a study with write access: a block is durable before it is counted.

A study has one writer, which holds `study.lock` next to the file while it lives; the operating
system releases the lock however the process ends.
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
from dechirp.experiments.study.block import Block
from dechirp.experiments.study.environment import keys_with_different_values
from dechirp.experiments.study.ledger_reader import (
    APPLICATION_ID,
    FORMAT_VERSION,
    LEDGER_NAME,
    LedgerReader,
    connect_sqlite_read_only,
    is_ledger_initialised,
    translate_sqlite_errors,
    unusable_path_error,
)

LOCK_NAME = "study.lock"
LEDGER_FILES = (
    LEDGER_NAME,
    LOCK_NAME,
    *(f"{name}-{end}" for name in (LEDGER_NAME, LOCK_NAME) for end in ("wal", "shm", "journal")),
)
"""Names of all files that a ledger may create in the folder of a study."""

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
# Table of studies that keep a data set only.
_ITEMS = """
CREATE TABLE IF NOT EXISTS items (
    point INTEGER NOT NULL, number INTEGER NOT NULL, content BLOB NOT NULL,
    PRIMARY KEY (point, number))
"""

_MAX_MESSAGE_LENGTH = 2000
_MAX_LINE_LENGTH = 100


class Ledger(LedgerReader):
    """Ledger of a study, open for writing by one process at a time."""

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
        self.environment_findings = tuple(findings)
        """That it was begun with other libraries or on another processor."""

    @classmethod
    def create_or_continue(
        cls, out: Path, *, identity: Mapping[str, str], environment: Mapping[str, str]
    ) -> Self:
        """Create the ledger of a study in a folder, or continue an existing one.

        Parameters
        ----------
        out : Path
            Folder; created if it does not exist.
        identity : mapping
            All inputs of the results, as text by name: study file, scenario, version. A different
            identity is refused, with the first lines that differ.
        environment : mapping
            Libraries and processor, see `environment.py`. A different environment is a finding:
            results may differ in their last bits.

        Raises
        ------
        DechirpError
            If the folder belongs to another study or to another program, another process writes to
            it, or it is not writable.
        """
        path = out / LEDGER_NAME
        try:
            out.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise _unwritable_folder_error(out, error.strerror or str(error)) from None
        if path.exists():
            with (
                translate_sqlite_errors(path, "Nothing was changed."),
                closing(connect_sqlite_read_only(path)) as connection,
            ):
                is_ledger_initialised(connection, path)  # a foreign file is left unchanged
        lock = _acquire_folder_lock(out)
        try:
            with translate_sqlite_errors(path, "Nothing was added."):
                connection = sqlite3.connect(path, isolation_level=None, timeout=60)
                try:
                    return cls._initialise_or_check_database(
                        out, connection, lock, dict(identity), dict(environment)
                    )
                except BaseException:
                    connection.close()
                    raise
        except BaseException:
            lock.close()
            raise

    @classmethod
    def _initialise_or_check_database(
        cls,
        out: Path,
        connection: sqlite3.Connection,
        lock: sqlite3.Connection,
        identity: dict[str, str],
        environment: dict[str, str],
    ) -> Self:
        (mode,) = connection.execute("PRAGMA journal_mode = WAL").fetchone()
        if mode != "wal":
            raise unusable_path_error(
                out / LEDGER_NAME,
                value="on a file system without support for the log of SQLite",
                expected="a folder on a local disk",
                fix="name another folder with --out, and copy it afterwards",
            )
        connection.execute("PRAGMA synchronous = FULL")
        ledger = cls(out, connection, lock, ())
        if not connection.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]:
            with ledger._transaction():
                connection.execute(f"PRAGMA application_id = {APPLICATION_ID}")
                for statement in _TABLES.split(";\n"):
                    connection.execute(statement)
                ledger._store_metadata_text("format_version", str(FORMAT_VERSION))
                ledger._store_metadata_text("identity", json.dumps(identity))
                ledger._store_metadata_text("environments", json.dumps([environment]))
            _flush_folder_to_disk(out)
        _check_same_study_identity(ledger.path, ledger.study_identity, identity)
        environments = ledger.environments_of_all_runs
        if environment not in environments:
            with ledger._transaction():
                ledger._store_metadata_text(
                    "environments", json.dumps([*environments, environment])
                )
        if environment != environments[0]:
            ledger.environment_findings = (
                _changed_environment_finding(ledger.path, environments[0], environment),
            )
        return ledger

    def close(self) -> None:
        """Close the file and release the lock."""
        super().close()
        self._lock.close()

    def add_blocks(self, blocks: Iterable[Block]) -> None:
        """Write blocks durably: all of them or, if this raises, none.

        Raises
        ------
        DechirpError
            If the disk is full, or fails. Earlier blocks stay.
        """
        blocks = list(blocks)
        with self._durable_write_transaction():
            self._connection.executemany(
                "INSERT OR IGNORE INTO blocks VALUES (?, ?, ?, ?, ?, ?)",
                (
                    (b.point, b.number, b.first, len(b.sums), b.seconds, _to_float64_bytes(b.sums))
                    for b in blocks
                ),
            )
            self._connection.executemany(
                "INSERT OR IGNORE INTO failures VALUES (?, ?, ?, ?)",
                (
                    (block.point, block.number, item.trial, item.message[:_MAX_MESSAGE_LENGTH])
                    for block in blocks
                    for item in block.failures
                ),
            )
            self._connection.executemany(
                "INSERT OR IGNORE INTO findings VALUES (?, ?, ?, ?, ?, ?)",
                ((block.point, *astuple(item)) for block in blocks for item in block.findings),
            )
            self._connection.executemany(
                "INSERT OR IGNORE INTO theory VALUES (?, ?)",
                ((b.point, _to_float64_bytes(b.theory)) for b in blocks if b.theory is not None),
            )
            items = [(block.point, block.number, block.items) for block in blocks if block.items]
            if items:
                self._connection.execute(_ITEMS)
                self._connection.executemany("INSERT OR IGNORE INTO items VALUES (?, ?, ?)", items)

    def end_point_and_delete_later_blocks(self, point: int, n_blocks: int) -> None:
        """Mark a point as complete after this number of blocks, and delete later blocks.

        Raises
        ------
        DechirpError
            If the disk is full, or fails.
        """
        with self._durable_write_transaction():
            parameters = (point, n_blocks)
            self._connection.execute(
                "DELETE FROM blocks WHERE point = ? AND number >= ?", parameters
            )
            self._connection.execute(
                "DELETE FROM failures WHERE point = ? AND number >= ?", parameters
            )
            if self._has_items_table:
                self._connection.execute(
                    "DELETE FROM items WHERE point = ? AND number >= ?", parameters
                )
            self._connection.execute("INSERT OR REPLACE INTO ended VALUES (?, ?)", parameters)

    def _store_metadata_text(self, key: str, text: str) -> None:
        self._connection.execute("INSERT OR REPLACE INTO meta VALUES (?, ?)", (key, text))

    @contextmanager
    def _durable_write_transaction(self) -> Iterator[None]:
        remainder = "What was done before is kept. Mend it, and call again to go on."
        with translate_sqlite_errors(self.path, remainder), self._transaction():
            yield
        # A deleted file would accept writes that are lost.
        if not self.path.exists() or self.path.stat().st_ino != self._file:
            raise unusable_path_error(
                self.path,
                value="removed or replaced while the study ran",
                expected="the same file until the study ends",
                fix="call again to begin anew; what was done is lost",
            )

    @contextmanager
    def _transaction(self) -> Iterator[None]:
        self._connection.execute("BEGIN IMMEDIATE")
        try:
            yield
            self._connection.execute("COMMIT")
        except BaseException:
            with suppress(sqlite3.Error):  # SQLite has already rolled back on a full disk
                self._connection.execute("ROLLBACK")
            raise


def _to_float64_bytes(numbers: np.ndarray) -> bytes:
    return np.ascontiguousarray(numbers, "<f8").tobytes()


def _acquire_folder_lock(out: Path) -> sqlite3.Connection:
    """Hold the lock of a folder while the returned connection is open.

    The lock is a SQLite transaction on an empty file: SQLite uses the file locks of every
    operating system, which end with the process that holds them.
    """
    path = out / LOCK_NAME
    try:
        lock = sqlite3.connect(path, isolation_level=None, timeout=0)
    except sqlite3.Error as error:
        raise _unwritable_folder_error(out, str(error)) from None
    try:
        lock.execute("BEGIN EXCLUSIVE")
    except sqlite3.DatabaseError as error:
        lock.close()
        if "locked" not in str(error):
            raise _unwritable_folder_error(out, str(error)) from None
        raise unusable_path_error(
            out,
            value="in use by another study that runs now",
            expected="a folder that one process writes to",
            fix="wait for it or end it, or name another folder with --out",
        ) from None
    return lock


def _check_same_study_identity(
    path: Path, saved: dict[str, str], requested: dict[str, str]
) -> None:
    names = keys_with_different_values(saved, requested)
    if not names:
        return
    raise DechirpError(
        *(
            _mistake_in_ledger_file(
                path,
                setting=name,
                value=requested_line,
                expected=f"{saved_line}, as in the existing results",
                fix="name another folder with --out, or remove this one to begin anew",
            )
            for name in names
            for saved_line, requested_line in [
                _first_differing_lines(saved.get(name, ""), requested.get(name, ""))
            ]
        )
    )


def _first_differing_lines(saved: str, requested: str) -> tuple[str, str]:
    """Return the first lines in which two texts differ, shortened for a message."""
    lines = saved.splitlines(), requested.splitlines()
    n_same = 0
    for first, second in zip(*lines, strict=False):
        if first != second:
            break
        n_same += 1
    is_long = max(map(len, lines)) > 1
    suffix = f" (line {n_same + 1})" if is_long else ""
    texts = [
        f"{_truncate_line(text[n_same].strip())}{suffix}" if n_same < len(text) else "missing"
        for text in lines
    ]
    return texts[0], texts[1]


def _truncate_line(line: str) -> str:
    return line if len(line) <= _MAX_LINE_LENGTH else f"{line[: _MAX_LINE_LENGTH - 3]}..."


def _changed_environment_finding(
    path: Path, first: dict[str, str], current: dict[str, str]
) -> Finding:
    changed = keys_with_different_values(first, current)

    def format_changed(environment: dict[str, str]) -> str:
        return ", ".join(f"{name} {environment.get(name, 'unknown')}" for name in changed)

    return Finding(
        level="warning",
        setting=str(path),
        value=f"now {format_changed(current)}, begun with {format_changed(first)}",
        expected="the same libraries and processor for bitwise equal results",
        fix="no action is needed: results are equally valid, but their last bits may differ",
    )


def _unwritable_folder_error(out: Path, reason: str) -> DechirpError:
    return unusable_path_error(
        out,
        value=f"not writable ({reason})",
        expected="a folder that can be written",
        fix="name another with --out",
    )


def _mistake_in_ledger_file(
    path: Path, *, setting: str, value: str, expected: str, fix: str
) -> Mistake:
    return Mistake(file=str(path), setting=setting, value=value, expected=expected, fix=fix)


def _flush_folder_to_disk(out: Path) -> None:
    """Flush the folder entry of a new file, so that its name survives a loss of power as well."""
    if os.name == "posix":
        folder = os.open(out, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)
