"""Atomic files and folders: written under a hidden name, then renamed."""

import ctypes
import math
import os
import re
import shutil
import signal
import sys
import threading
import time
import uuid
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType

from dechirp.core.errors import DechirpError, InvalidSetting, Mistake

_FILE_MANAGER_FILES = frozenset({".DS_Store", "Thumbs.db", "desktop.ini"})
_ABSENT_S, _MAX_REMOVAL_S = 0.2, 5.0
_AT_WORKING_FOLDER, _RENAME_EXCHANGE, _RENAME_SWAP = -100, 2, 2  # of Linux and macOS

if sys.platform != "win32":
    import fcntl

_completed: list[Path] = []


def completed_outputs() -> tuple[Path, ...]:
    """Return the outputs that this process has put in place, for the message on an interrupt."""
    return tuple(_completed)


def check_output_folder_replaceable(
    out: Path,
    *,
    marker_file: str,
    own_names: Collection[str],
    fix: str = "name another folder, or empty it: the output folder is replaced completely",
) -> None:
    """Raise `DechirpError` unless a folder is absent, empty, or an earlier result.

    Parameters
    ----------
    out : Path
        Folder to replace completely.
    marker_file : str
        Name of a file that identifies an earlier result.
    own_names : collection of str
        Names that a result may contain; any other file belongs to the user.
    fix : str
        Advice of the error message on a folder with other files.
    """
    try:
        if not out.exists() and not out.is_symlink():
            _check_folder_creatable(out)
            return
        if not out.is_dir():
            raise _out_option_error(out, value="a file", fix="name a folder")
        working_folder = Path.cwd()
        if out.resolve() in (working_folder, *working_folder.parents):
            raise _out_option_error(
                out,
                value="the working folder, or one of its parents",
                fix="name a folder inside it: the output folder is replaced completely",
            )
        names = {file.name for file in out.iterdir()} - _FILE_MANAGER_FILES
        foreign_names = sorted(names - set(own_names))
        if names and (foreign_names or marker_file not in names):
            raise _out_option_error(
                out,
                value=f"a folder with {foreign_names[0] if foreign_names else f'no {marker_file}'}",
                fix=fix,
            )
        _check_folder_creatable(out)
    except OSError as error:
        raise _unwritable_out_option_error(out, error) from None


@contextmanager
def atomic_folder(out: Path) -> Iterator[Path]:
    """Yield an empty folder that replaces `out` at the end.

    After an error `out` is unchanged and the new folder is removed. Linux and macOS exchange the
    folders in one step; elsewhere, a process that is killed between two renames leaves none until
    the next call restores it. The next call also removes the hidden folder of a killed process; on
    Windows, which cannot lock a folder, that one stays.

    Raises
    ------
    DechirpError
        If it cannot be written, or the disk is full.
    """
    target = out.resolve()
    new_folder = _unique_hidden_sibling(target, suffix=".new")
    backup = new_folder.with_suffix(".before")
    new_identity, is_placed = None, False
    try:
        _clean_up_after_killed_processes(target)
        new_folder.parent.mkdir(parents=True, exist_ok=True)
        with _locked_new_folder(new_folder):
            new_identity = _file_identity(new_folder)
            yield new_folder
            if not target.exists():
                new_folder.rename(target)
            elif not _exchange_paths(new_folder, target):
                target.rename(backup)
                new_folder.rename(target)
            is_placed = True
    except OSError as error:
        raise _unwritable_out_option_error(out, error) from None
    finally:
        with _signals_deferred():
            if backup.exists() and not target.exists():
                backup.rename(target)
            if new_identity is not None and _file_identity(target) == new_identity:
                _completed.append(out)
            shutil.rmtree(backup, ignore_errors=True)
            if is_placed:
                shutil.rmtree(new_folder, ignore_errors=True)
            else:
                _remove_while_written(new_folder)


def _remove_while_written(folder: Path) -> None:
    """Remove a folder into which threads of an interrupted library may still write.

    Zarr writes in threads of its own, which create missing folders again. The folder counts as
    removed after 0.2 s without it.
    """
    end = time.monotonic() + _MAX_REMOVAL_S
    last_seen = -math.inf
    while time.monotonic() < end:
        if folder.exists():
            last_seen = time.monotonic()
            shutil.rmtree(folder, ignore_errors=True)
        elif time.monotonic() - last_seen > _ABSENT_S:
            return
        time.sleep(_ABSENT_S / 10)


@contextmanager
def _signals_deferred() -> Iterator[None]:
    """Deliver SIGINT and SIGTERM after the block, so that they do not end a removal half-way.

    `timeout` and terminals signal a process and its group, so that one comes twice: the second
    while the files of the first are being removed.
    """
    if threading.current_thread() is not threading.main_thread():  # gets no signals
        yield
        return
    received: list[int] = []

    def record(number: int, _frame: FrameType | None) -> None:
        received.append(number)

    numbers = (signal.SIGINT, signal.SIGTERM)
    handlers = {n: handler for n in numbers if (handler := signal.getsignal(n)) is not None}
    try:
        for number in handlers:
            signal.signal(number, record)
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
        if received:
            signal.raise_signal(received[0])


@contextmanager
def _locked_new_folder(folder: Path) -> Iterator[None]:
    """Create a folder and lock it, so that other processes do not remove it as abandoned."""
    descriptor = None
    while descriptor is None:
        folder.mkdir(exist_ok=True)
        if sys.platform == "win32":
            break
        with suppress(FileNotFoundError):
            descriptor = os.open(folder, os.O_RDONLY)
            with suppress(OSError):  # a file system without locks
                fcntl.flock(descriptor, fcntl.LOCK_EX)
            if not os.fstat(descriptor).st_nlink:  # removed before it was locked
                os.close(descriptor)
                descriptor = None
    try:
        yield
    finally:
        if descriptor is not None:
            os.close(descriptor)


def _is_locked(folder: Path) -> bool | None:
    """Return True if a running process has locked a folder, or None if that cannot be known."""
    if sys.platform == "win32":
        return None
    try:
        descriptor = os.open(folder, os.O_RDONLY)
    except OSError:
        return None
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:  # a file system without locks
        return None
    finally:
        os.close(descriptor)
    return False


def _file_identity(path: Path) -> tuple[int, int] | None:
    """Return the device and the number of a file or folder, which a rename keeps."""
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_dev, status.st_ino


def _exchange_paths(first: Path, second: Path) -> bool:
    """Exchange two paths in one step; return False if the system or the file system cannot."""
    names = os.fsencode(first), os.fsencode(second)
    try:
        library = ctypes.CDLL(None, use_errno=True)
        if sys.platform == "darwin":
            return int(library.renamex_np(*names, _RENAME_SWAP)) == 0
        pair = _AT_WORKING_FOLDER, names[0], _AT_WORKING_FOLDER, names[1]
        return int(library.renameat2(*pair, _RENAME_EXCHANGE)) == 0
    except (AttributeError, OSError, TypeError):  # another system, or an old C library
        return False


def _clean_up_after_killed_processes(target: Path) -> None:
    """Restore a folder that a process moved away before it was killed; remove what it left.

    A hidden folder without a lock belongs to no process.
    """
    pattern = re.compile(rf"{re.escape(f'.{target.name}.')}[0-9a-f]{{8}}\.(new|before|trying)")
    siblings = target.parent.iterdir() if target.parent.is_dir() else ()
    leftovers = [path for path in siblings if pattern.fullmatch(path.name)]
    for backup in [path for path in leftovers if path.suffix == ".before"]:
        if _is_locked(backup.with_suffix(".new")):
            continue
        if not target.exists():
            backup.rename(target)
        shutil.rmtree(backup, ignore_errors=True)
    for folder in [path for path in leftovers if path.suffix != ".before"]:
        if _is_locked(folder) is False:
            shutil.rmtree(folder, ignore_errors=True)


@contextmanager
def atomic_file(out: Path) -> Iterator[Path]:
    """Yield the path of a new file that replaces `out` at the end.

    After an error `out` is unchanged and the new file is removed.

    Raises
    ------
    DechirpError
        If it cannot be written, or the disk is full.
    """
    try:
        with _replaced_file(out, _unique_hidden_sibling(out.resolve())) as new_file:
            yield new_file
    except OSError as error:
        raise _unwritable_out_option_error(out, error) from None


@contextmanager
def _replaced_file(out: Path, new_file: Path) -> Iterator[Path]:
    """Yield the path of a new file that replaces `out` at the end, or is removed on an error."""
    target = Path(os.path.realpath(out))
    new_identity = None
    try:
        if target.is_dir():
            raise IsADirectoryError(None, "a folder")
        yield new_file
        new_identity = _file_identity(new_file)
        new_file.replace(target)
    finally:
        with _signals_deferred():
            if new_identity is not None and _file_identity(target) == new_identity:
                _completed.append(out)
            new_file.unlink(missing_ok=True)


@contextmanager
def atomic_files(*outs: Path) -> Iterator[tuple[Path, ...]]:
    """Yield paths of new files that replace `outs` together at the end.

    A path that is not written leaves no file. After an error all earlier files are unchanged and
    the new ones are removed.

    The first is the file that readers need to open the others: it is removed first and placed
    last. Files of two runs therefore never mix, and a killed process leaves no first file; the
    earlier files then remain as hidden files `.name.0123abcd.before`.

    Raises
    ------
    DechirpError
        If one is a folder, they cannot be written, or the disk is full.
    """
    if folder := next((out for out in outs if out.is_dir()), None):
        raise _out_option_error(folder, value="a folder", fix="name a file")
    targets = [out.resolve() for out in outs]
    new_files = [_unique_hidden_sibling(target) for target in targets]
    backups = [new_file.with_name(f"{new_file.name}.before") for new_file in new_files]
    placed: list[Path] = []
    is_done = False
    try:
        yield tuple(new_files)
        for target, backup in zip(targets, backups, strict=True):
            if target.exists():
                target.rename(backup)
        for target, new_file in reversed(list(zip(targets, new_files, strict=True))):
            if new_file.exists():
                new_file.rename(target)
                placed.append(target)
        is_done = True
        _completed.extend(outs)
    except OSError as error:
        raise _unwritable_out_option_error(outs[0], error) from None
    finally:
        with _signals_deferred():
            if not is_done:
                for target in placed:
                    target.unlink(missing_ok=True)
                for target, backup in zip(targets, backups, strict=True):
                    if backup.exists():
                        backup.rename(target)
            for file in (*new_files, *backups):
                with suppress(OSError):  # absent, or its folder is a file
                    file.unlink()


def write_text_atomically(out: Path, text: str) -> None:
    """Write a text file that replaces an earlier one.

    Raises
    ------
    DechirpError
        If it cannot be written, or the disk is full.
    """
    with atomic_file(out) as new_file:
        new_file.write_bytes(encode_utf8_with_escapes(text))


def encode_utf8_with_escapes(text: str) -> bytes:
    """Encode as UTF-8, with JSON escapes for undecodable bytes of file names."""
    return text.encode("utf-8", "backslashreplace")


def check_file_suffix(path: object, suffixes: Collection[str]) -> Path:
    """Return a path that ends in one of the suffixes, or raise `InvalidSetting`."""
    if not isinstance(path, str | Path):
        raise InvalidSetting("path", value=repr(path), expected="a path", fix="pass it as a string")
    suffix = Path(path).suffix
    if "\0" in str(path) or suffix.lower() not in suffixes:
        raise InvalidSetting(
            "path",
            value=f"{str(path)!r}, {f'with the suffix {suffix}' if suffix else 'without a suffix'}",
            expected=f"one that ends in {', '.join(suffixes)}",
            fix="name it after the format that you want",
        )
    return Path(path)


@contextmanager
def atomic_output_file(path: Path) -> Iterator[Path]:
    """Yield a temporary path that replaces `path` on success.

    On any error, `path` keeps its content.

    Raises
    ------
    InvalidSetting
        If it is a folder, cannot be written, or the disk is full.
    """
    target = Path(os.path.realpath(path))
    hidden_file = target.with_name(f".{uuid.uuid4().hex[:12]}{target.suffix}")
    try:
        with _replaced_file(path, hidden_file) as temporary:
            yield temporary
    except OSError as error:
        raise _unwritable_path_error(path, error) from None


def check_output_writable(path: Path) -> None:
    """Raise `InvalidSetting` unless the file can be written; call this before a long run."""
    target = Path(os.path.realpath(path))
    trial = target.with_name(f".{uuid.uuid4().hex[:12]}{target.suffix}")
    try:
        if target.is_dir():
            raise IsADirectoryError(None, "a folder")
        trial.touch(exist_ok=False)
        trial.unlink()
    except OSError as error:
        raise _unwritable_path_error(path, error) from None


def _check_folder_creatable(out: Path) -> None:
    """Create and remove a trial folder: access rights alone are wrong for /proc."""
    target = Path(os.path.realpath(out))
    # A link that realpath leaves unresolved points to itself; no folder fits in it.
    existing_parent = next(
        parent for parent in target.parents if parent.exists() or parent.is_symlink()
    )
    # As long as the longest name of a result.
    trial = existing_parent / f"{_unique_hidden_sibling(target).name}.trying"
    try:
        trial.mkdir()
    except OSError as error:
        reason = f"{existing_parent} cannot be written to: {error.strerror}"
        raise OSError(error.errno, reason) from None
    finally:
        with suppress(OSError):
            trial.rmdir()


def _unique_hidden_sibling(path: Path, *, suffix: str = "") -> Path:
    """Return a hidden, unique name in the same folder."""
    return path.with_name(f".{path.name}.{uuid.uuid4().hex[:8]}{suffix}")


def _unwritable_out_option_error(out: Path, error: OSError) -> DechirpError:
    return _out_option_error(
        out,
        value=f"not writable ({error.strerror or error})",
        fix="name a writable folder with free space",
    )


def _out_option_error(out: Path, *, value: str, fix: str) -> DechirpError:
    return DechirpError(
        Mistake(
            setting="--out",
            value=f"{out}, {value}",
            expected="a new name, or earlier results to replace",
            fix=fix,
        )
    )


def _unwritable_path_error(path: Path, error: OSError) -> InvalidSetting:
    return InvalidSetting(
        "path",
        value=f"{path}, not writable ({error.strerror or error})",
        expected="a file in an existing folder",
        fix="name a writable folder with free space",
    )
