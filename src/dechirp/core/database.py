"""DuckDB in memory, by which tables are read and written, and texts as its language has them."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any


def database() -> Any:
    """One in memory, that never fetches anything from a network."""
    import duckdb

    return duckdb.connect(
        config={"autoinstall_known_extensions": False, "autoload_known_extensions": False}
    )


def quoted(text: str) -> str:
    """Write a text as SQL does."""
    return "'" + text.replace("'", "''") + "'"


@contextmanager
def utf8_name(path: Path) -> Iterator[str]:
    """Name of a file that DuckDB reads or makes; it stands in for one that is not UTF-8."""
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


def literal(name: str) -> str:
    """Pattern that matches this name alone: names may hold what stands for other letters."""
    return "".join(f"[{letter}]" if letter in "*?[" else letter for letter in name)
