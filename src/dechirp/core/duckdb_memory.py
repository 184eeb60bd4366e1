"""DuckDB in memory, which reads and writes table files, and quoting for its SQL."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any


def connect_duckdb_in_memory() -> Any:
    """Connect to a database in memory that never downloads extensions."""
    import duckdb

    return duckdb.connect(
        config={"autoinstall_known_extensions": False, "autoload_known_extensions": False}
    )


def quote_sql_string(text: str) -> str:
    """Quote a text as an SQL string."""
    return "'" + text.replace("'", "''") + "'"


@contextmanager
def utf8_path_alias(path: Path) -> Iterator[str]:
    """Yield a UTF-8 path for DuckDB to read or write; a temporary one if `path` is not UTF-8."""
    try:
        str(path).encode()
    except UnicodeEncodeError:
        with TemporaryDirectory() as folder:
            other = Path(folder, "file")
            if path.exists():
                other.symlink_to(path.absolute())
                yield str(other)
            else:
                yield str(other)
                shutil.move(other, path)
    else:
        yield str(path)


def escape_glob_wildcards(name: str) -> str:
    """Escape the wildcards of a file name, so that the pattern matches this name alone."""
    return "".join(f"[{letter}]" if letter in "*?[" else letter for letter in name)
