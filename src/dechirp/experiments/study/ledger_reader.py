"""Read access to the ledger of a study: one SQLite file, readable while the study runs.

Readers need no lock; `ledger` adds write access.
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
from dechirp.experiments.study.block import Failure

LEDGER_NAME = "study.sqlite"
FORMAT_VERSION = 1
APPLICATION_ID = int.from_bytes(b"FMCW")
"""SQLite application id that marks our ledgers."""


def _sql_nonnegative_integer_condition(*columns: str) -> str:
    return " AND ".join(f"typeof({column}) = 'integer' AND {column} >= 0" for column in columns)


def _sql_text_condition(*columns: str) -> str:
    return " AND ".join(f"typeof({column}) = 'text'" for column in columns)


# SQLite columns accept values of any type: conditions that each valid row meets.
_ROW_CONDITIONS = {
    "meta": _sql_text_condition("key", "said"),
    "blocks": _sql_nonnegative_integer_condition("point", "number", "first", "n_trials")
    + " AND n_trials > 0 AND first < 1 << 53 AND typeof(seconds) = 'real'"
    " AND typeof(sums) = 'blob' AND length(sums) % (8 * n_trials) = 0",
    "ended": _sql_nonnegative_integer_condition("point", "n_blocks"),
    "theory": _sql_nonnegative_integer_condition("point")
    + " AND typeof(numbers) = 'blob' AND length(numbers) % 8 = 0",
    "failures": _sql_nonnegative_integer_condition("point", "number", "trial")
    + " AND "
    + _sql_text_condition("message"),
    "findings": _sql_nonnegative_integer_condition("point")
    + " AND level IN ('note', 'warning', 'error') AND "
    + _sql_text_condition("level", "setting", "got", "need", "fix"),
}


class LedgerReader:
    """Contents of a ledger, readable while the study runs.

    A context manager that closes the file.
    """

    def __init__(self, out: Path, connection: sqlite3.Connection) -> None:
        self.path = out / LEDGER_NAME
        self._connection = connection

    @classmethod
    def open_read_only(cls, out: Path) -> Self:
        """Open the ledger in a folder read-only.

        Raises
        ------
        DechirpError
            If there is none, or it cannot be read.
        """
        path = out / LEDGER_NAME
        if not path.is_file():
            raise unusable_path_error(
                path,
                value="missing",
                expected="the record of a study",
                fix="name the folder that `dechirp study` wrote",
            )
        with translate_sqlite_errors(path, "Nothing was changed."):
            connection = connect_sqlite_read_only(path)
            try:
                if not is_ledger_initialised(connection, path):
                    raise unusable_path_error(
                        path,
                        value="empty",
                        expected="the record of a study",
                        fix="run the study first",
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
        """Close the file; all added blocks are already on disk."""
        self._connection.close()

    def check_sizes_of_sums_and_theory(
        self, *, n_columns: int, n_theoretical_values: int = 0
    ) -> None:
        """Raise `DechirpError` if a trial has other sums than expected, or a point other theory.

        Parameters
        ----------
        n_columns : int
            Numbers of a trial in `trial_sums_of_point`.
        n_theoretical_values : int, optional
            Numbers of a point in `theoretical_values_of_point`.
        """
        other = "SELECT 1 FROM blocks WHERE length(sums) != 8 * n_trials * ?"
        theory = "SELECT 1 FROM theory WHERE length(numbers) != 8 * ?"
        for _ in self._query_rows(
            f"{other} UNION ALL {theory} LIMIT 1", n_columns, n_theoretical_values
        ):
            raise _damaged_ledger_error(self.path)

    @property
    def study_identity(self) -> dict[str, str]:
        """Identity of the study with which the ledger was created."""
        identity = self._read_metadata_json("identity")
        if not _is_text_mapping(identity):
            raise _damaged_ledger_error(self.path)
        return identity

    @property
    def environments_of_all_runs(self) -> list[dict[str, str]]:
        """Libraries and processors on which the study ran, in order."""
        environments = self._read_metadata_json("environments")
        if (
            not isinstance(environments, list)
            or not environments
            or not all(map(_is_text_mapping, environments))
        ):
            raise _damaged_ledger_error(self.path)
        return environments

    def saved_point_and_block_numbers(self) -> np.ndarray:
        """Return point and number of every saved block, (n_blocks, 2) int64, sorted."""
        rows = self._query_rows("SELECT point, number FROM blocks ORDER BY point, number")
        flat = np.fromiter((number for row in rows for number in row), np.int64)
        return flat.reshape(-1, 2)

    def n_blocks_of_points_ended_early(self) -> dict[int, int]:
        """Return the number of blocks of the points that ended before their last, by point."""
        return dict(self._query_rows("SELECT point, n_blocks FROM ended"))

    def trial_sums_of_point(self, point: int) -> np.ndarray:
        """Return the sums of the trials of a point in order, (n_trials, n_columns) float64.

        A study that was interrupted may have gaps between blocks: see `trial_numbers_of_point`.
        """
        rows = self._query_rows(
            "SELECT n_trials, sums FROM blocks WHERE point = ? ORDER BY number", point
        )
        return self._stack_sums_of_blocks(list(rows))

    def trial_numbers_of_point(self, point: int) -> np.ndarray:
        """Return the trial number of each row of `trial_sums_of_point`, (n_trials,) int64."""
        rows = self._query_rows(
            "SELECT first, n_trials FROM blocks WHERE point = ? ORDER BY number", point
        )
        numbers = [np.arange(first, first + n, dtype=np.int64) for first, n in rows]
        return np.concatenate([np.empty(0, np.int64), *numbers])

    def iter_trial_sums_by_point(self) -> Iterator[tuple[int, np.ndarray]]:
        """Yield point and sums of every point that has trials, in order."""
        # In the order of the file, in which the blocks of a point are adjacent.
        rows = self._query_rows("SELECT point, n_trials, sums FROM blocks ORDER BY point, number")
        for point, point_rows in groupby(rows, itemgetter(0)):
            yield point, self._stack_sums_of_blocks([row[1:] for row in point_rows])

    def theoretical_values_of_point(self, point: int) -> np.ndarray | None:
        """Return the theoretical values of a point, (n,) float64.

        See `ScoreColumnLayout.theoretical_score_value`. None before its first block.
        """
        for (numbers,) in self._query_rows("SELECT numbers FROM theory WHERE point = ?", point):
            return np.frombuffer(numbers, "<f8").astype(float)
        return None

    def count_failed_trials(self) -> int:
        """Return the number of trials that raised."""
        return int(self._query_single_number("SELECT count(*) FROM failures"))

    def failed_trials_with_points(self) -> list[tuple[int, Failure]]:
        """Return point and failure of all trials that raised, in order."""
        rows = self._query_rows("SELECT point, trial, message FROM failures ORDER BY point, trial")
        return [(point, Failure(trial, message)) for point, trial, message in rows]

    def findings_with_points(self) -> list[tuple[int, Finding]]:
        """Return point and finding of all warnings, in the order of the points."""
        rows = self._query_rows(
            "SELECT point, level, setting, got, need, fix FROM findings ORDER BY point, rowid"
        )
        return [
            (point, Finding(level=level, setting=setting, value=got, expected=need, fix=fix))
            for point, level, setting, got, need, fix in rows
        ]

    def iter_packed_items(
        self, *, block_number: int | None = None
    ) -> Iterator[tuple[int, int, bytes]]:
        """Yield point, number and packed data set items of each block, in order.

        `block_number` selects the blocks of that number.
        """
        if not self._has_items_table:
            return
        query = "SELECT point, number, content FROM items"
        if block_number is not None:
            query += f" WHERE number = {int(block_number)}"
        yield from self._query_rows(f"{query} ORDER BY point, number")

    def total_computing_seconds(self) -> float:
        """Return the summed computing time of all blocks."""
        return float(self._query_single_number("SELECT total(seconds) FROM blocks"))

    @property
    def _has_items_table(self) -> bool:
        query = "SELECT count(*) FROM sqlite_master WHERE name = 'items'"
        return bool(self._query_single_number(query))

    def _read_metadata_text(self, key: str) -> str:
        for (text,) in self._query_rows("SELECT said FROM meta WHERE key = ?", key):
            return str(text)
        raise _damaged_ledger_error(self.path)

    def _read_metadata_json(self, key: str) -> Any:
        """Parse a JSON entry of the table meta."""
        try:
            return json.loads(self._read_metadata_text(key))
        except (ValueError, RecursionError):
            raise _damaged_ledger_error(self.path) from None

    def _stack_sums_of_blocks(self, rows: Sequence[tuple[int, bytes]]) -> np.ndarray:
        """Stack the rows of the trials of several blocks."""
        if len({len(sums) // n_trials for n_trials, sums in rows}) > 1:
            raise _damaged_ledger_error(self.path)
        n_trials = sum(n_trials for n_trials, _ in rows)
        flat = np.frombuffer(b"".join([sums for _, sums in rows]), "<f8")
        return flat.reshape(n_trials, -1) if n_trials else np.empty((0, 0))

    def _query_single_number(self, query: str) -> float:
        ((number,),) = self._query_rows(query)
        return float(number)

    def _query_rows(self, query: str, *parameters: object) -> Iterator[tuple[Any, ...]]:
        """Yield the rows of a query."""
        with translate_sqlite_errors(self.path, "Nothing was changed."):
            # `yield from` would close the rows too, which fails once the file is closed.
            for row in self._connection.execute(query, parameters):  # noqa: UP028
                yield row


def _is_text_mapping(content: object) -> bool:
    return isinstance(content, dict) and all(isinstance(text, str) for text in content.values())


def connect_sqlite_read_only(path: Path) -> sqlite3.Connection:
    """Open a SQLite file without writing to its folder."""
    uri = path.resolve().as_uri()
    connection = sqlite3.connect(f"{uri}?mode=ro", uri=True, isolation_level=None, timeout=60)
    try:
        connection.execute("PRAGMA schema_version")
    except sqlite3.DatabaseError as error:
        connection.close()
        has_log = path.with_name(f"{LEDGER_NAME}-wal").exists()
        if has_log or not isinstance(error, sqlite3.OperationalError):
            raise
        # A finished study in a read-only folder, in which SQLite cannot create its log index.
        return sqlite3.connect(f"{uri}?immutable=1", uri=True, isolation_level=None)
    return connection


def is_ledger_initialised(connection: sqlite3.Connection, path: Path) -> bool:
    """Return whether a file has the tables of a ledger; False for an empty file, else raise."""
    (application,) = connection.execute("PRAGMA application_id").fetchone()
    n_tables = connection.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]
    if application != APPLICATION_ID and n_tables:
        raise _not_a_ledger_error(path, "a database of something else")
    if not n_tables:  # killed before its tables were made: the next writer makes them
        return False
    names = {name for (name,) in connection.execute("SELECT name FROM sqlite_master")}
    if not names >= set(_ROW_CONDITIONS):
        raise _damaged_ledger_error(path)
    query = "SELECT said FROM meta WHERE key = 'format_version'"
    row = connection.execute(query).fetchone()
    if row is None:
        raise _damaged_ledger_error(path)
    version = row[0]
    if str(version) != str(FORMAT_VERSION):
        raise unusable_path_error(
            path,
            value=f"format {version}",
            expected=f"format {FORMAT_VERSION}, which this version of dechirp writes",
            fix="go on with the version that began it, or name another folder with --out",
        )
    others = (f"SELECT 1 FROM {table} WHERE NOT ({row})" for table, row in _ROW_CONDITIONS.items())
    if connection.execute(f"{' UNION ALL '.join(others)} LIMIT 1").fetchone():
        raise _damaged_ledger_error(path)
    return True


@contextmanager
def translate_sqlite_errors(path: Path, fix_text: str) -> Iterator[None]:
    """Convert exceptions of SQLite to errors that name the file and what remains of it."""
    try:
        yield
    except UnicodeDecodeError:
        raise _damaged_ledger_error(path) from None
    except sqlite3.Error as error:
        if "not a database" in str(error):
            raise _not_a_ledger_error(path, "no database") from None
        if "malformed" in str(error) or "no such" in str(error):
            raise _damaged_ledger_error(path) from None
        is_full = "full" in str(error)
        raise unusable_path_error(
            path.parent,
            value="on a full disk" if is_full else f"not usable ({error})",
            expected="a folder with room" if is_full else "one that can be read and written",
            fix=fix_text,
        ) from None


def _damaged_ledger_error(path: Path) -> DechirpError:
    fix = "Bring back a copy, or name another folder with --out."
    return unusable_path_error(path, value="damaged", expected="an intact record", fix=fix)


def _not_a_ledger_error(path: Path, value: str) -> DechirpError:
    return unusable_path_error(
        path,
        value=value,
        expected="the record of a study, or no file",
        fix="name another folder with --out",
    )


def unusable_path_error(path: Path, *, value: str, expected: str, fix: str) -> DechirpError:
    """Return the error for a folder or file that cannot be used."""
    return DechirpError(Mistake(setting=f"--out: {path}", value=value, expected=expected, fix=fix))
