"""Files and folders that are there whole or not at all: written beside, then renamed."""

import os
import re
import shutil
import uuid
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from dechirp.core.errors import DechirpError, Mistake

_LEFT_BY_FILE_MANAGERS = frozenset({".DS_Store", "Thumbs.db", "desktop.ini"})


def must_be_replaceable(out: Path, *, mark: str, ours: Collection[str]) -> None:
    """Raise `DechirpError` unless a folder is absent, empty, or an earlier one of ours.

    Parameters
    ----------
    out : Path
        The folder that is to be replaced as a whole.
    mark : str
        Name of a file in it that shows that it is ours.
    ours : collection of str
        Names that may be in it; any other is somebody's own.
    """
    try:
        if not out.exists() and not out.is_symlink():
            _must_be_writable(out)
            return
        if not out.is_dir():
            raise _refused(out, got="a file", fix="Give the name of a folder.")
        here = Path.cwd()
        if out.resolve() in (here, *here.parents):
            raise _refused(
                out,
                got="the folder you are in, or one above it",
                fix="It would be replaced as a whole: name a folder in it.",
            )
        names = {file.name for file in out.iterdir()} - _LEFT_BY_FILE_MANAGERS
        own = sorted(names - set(ours))
        if names and (own or mark not in names):
            raise _refused(
                out,
                got=f"a folder that holds {own[0] if own else f'no {mark}'}",
                fix="It would be replaced as a whole: name another, or empty it.",
            )
        _must_be_writable(out)
    except OSError as error:
        raise _unwritable(out, error) from None


@contextmanager
def whole_folder(out: Path) -> Iterator[Path]:
    """Give an empty folder to write into, which takes the place of `out` at the end.

    Whatever goes wrong, `out` stays as it was and the new folder is removed.

    Raises
    ------
    DechirpError
        If it cannot be written, or the disk is full.
    """
    place = out.resolve()
    made = _beside(place)
    before = made.with_name(f"{made.name}.before")
    try:
        _put_back(place)
        made.mkdir(parents=True)
        yield made
        if place.exists():
            place.rename(before)
        made.rename(place)
    except OSError as error:
        raise _unwritable(out, error) from None
    finally:
        if before.exists() and not place.exists():
            before.rename(place)
        shutil.rmtree(before, ignore_errors=True)
        shutil.rmtree(made, ignore_errors=True)


def _put_back(place: Path) -> None:
    """Undo what a run that was killed between its two renames left behind."""
    left = re.compile(rf"{re.escape(f'.{place.name}.')}[0-9a-f]{{8}}\.before")
    there = place.parent.iterdir() if place.parent.is_dir() else ()
    for before in [folder for folder in there if left.fullmatch(folder.name)]:
        if not place.exists():
            before.rename(place)
        shutil.rmtree(before, ignore_errors=True)
        shutil.rmtree(before.with_suffix(""), ignore_errors=True)


@contextmanager
def whole_file(out: Path) -> Iterator[Path]:
    """Give the name of a new file, which takes the place of `out` at the end.

    Whatever goes wrong, `out` stays as it was and the new file is removed.

    Raises
    ------
    DechirpError
        If it cannot be written, or the disk is full.
    """
    place = out.resolve()
    made = _beside(place)
    try:
        try:
            if place.is_dir():
                raise IsADirectoryError(None, "a folder")
            yield made
            made.replace(place)
        finally:
            made.unlink(missing_ok=True)
    except OSError as error:
        raise _unwritable(out, error) from None


@contextmanager
def whole_files(*outs: Path) -> Iterator[tuple[Path, ...]]:
    """Give names of new files, which take the places of `outs` together at the end.

    A new file that is not written leaves its place empty. Whatever goes wrong, all that was
    there stays as it was and the new files are removed.

    The first is the one without which nobody reads the others: it goes first and comes last. So
    files of two times never lie together, and what a killed process leaves has no first; the
    earlier files are then beside it, hidden, as `.name.0123abcd.before`.

    Raises
    ------
    DechirpError
        If one is a folder, they cannot be written, or the disk is full.
    """
    if folder := next((out for out in outs if out.is_dir()), None):
        raise _refused(folder, got="a folder", fix="Give the name of a file.")
    places = [out.resolve() for out in outs]
    made = [_beside(place) for place in places]
    before = [new.with_name(f"{new.name}.before") for new in made]
    placed: list[Path] = []
    is_done = False
    try:
        yield tuple(made)
        for place, old in zip(places, before, strict=True):
            if place.exists():
                place.rename(old)
        for place, new in reversed(list(zip(places, made, strict=True))):
            if new.exists():
                new.rename(place)
                placed.append(place)
        is_done = True
    except OSError as error:
        raise _unwritable(outs[0], error) from None
    finally:
        if not is_done:
            for place in placed:
                place.unlink(missing_ok=True)
            for place, old in zip(places, before, strict=True):
                if old.exists():
                    old.rename(place)
        for file in (*made, *before):
            with suppress(OSError):  # none is there, or a file stands where the folder should
                file.unlink()


def write_whole(out: Path, text: str) -> None:
    """Write a file of text, in place of what was there.

    Raises
    ------
    DechirpError
        If it cannot be written, or the disk is full.
    """
    with whole_file(out) as made:
        made.write_bytes(in_utf8(text))


def in_utf8(text: str) -> bytes:
    """UTF-8, with escapes as JSON has them for bytes in names of files that are no text."""
    return text.encode("utf-8", "backslashreplace")


def _must_be_writable(out: Path) -> None:
    """Make a folder where one will be needed: /proc says that it is writable, and is not."""
    place = Path(os.path.realpath(out))
    # A link that is left leads to itself; no folder can be made in it.
    there = next(one for one in place.parents if one.exists() or one.is_symlink())
    trial = there / f"{_beside(place).name}.trying"  # as long as the longest name of a result
    try:
        trial.mkdir()
    except OSError as error:
        why = f"{there} cannot be written to: {error.strerror}"
        raise OSError(error.errno, why) from None
    finally:
        with suppress(OSError):
            trial.rmdir()


def _beside(place: Path) -> Path:
    """Hidden name for what will take that place."""
    return place.with_name(f".{place.name}.{uuid.uuid4().hex[:8]}")


def _unwritable(out: Path, error: OSError) -> DechirpError:
    return _refused(
        out,
        got=f"not writable ({error.strerror or error})",
        fix="Name a place that can be written and has room.",
    )


def _refused(out: Path, *, got: str, fix: str) -> DechirpError:
    return DechirpError(
        Mistake(
            setting="--out",
            got=f"{out}, {got}",
            need="a new name, or results to be replaced",
            fix=fix,
        )
    )
