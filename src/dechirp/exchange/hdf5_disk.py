"""A new HDF5 file that takes the place of another, on a disk that may fill."""

import io
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from dechirp.store.whole import whole_file


class _Patient(io.FileIO):
    """A file to which writing never fails: the first error is kept, and no more is written.

    HDF5 (2.0) crashes the process where it cannot write what it still holds when it closes.
    """

    failed: OSError | None = None

    def write(self, data: Any) -> int:
        rest = memoryview(data).cast("B")
        n_bytes = len(rest)
        try:
            while rest and self.failed is None:
                rest = rest[super().write(rest) :]
        except OSError as error:
            self.failed = error
        return n_bytes

    def truncate(self, size: int | None = None) -> int:
        try:
            if self.failed is None:
                return super().truncate(size)
        except OSError as error:
            self.failed = error
        return self.tell() if size is None else size

    def must_have_written(self) -> None:
        """Raise the first error, if there was one."""
        if self.failed is not None:
            raise self.failed


@contextmanager
def new_hdf5(out: Path) -> Iterator[tuple[Any, Callable[[], None]]]:
    """A new file, which takes the place of `out` at the end, and what says that it fails."""
    import h5py  # takes 0.1 s, for these formats alone

    with whole_file(out) as made, _Patient(made, "w+") as disk:
        # netCDF counts what is in a group in the order in which it was made. Before v108 an
        # attribute has 64 KiB at most, and no checksum.
        with h5py.File(disk, "w", track_order=True, libver=("v108", "v108")) as file:
            yield file, disk.must_have_written
        disk.must_have_written()


def say(thing: Any, name: str, text: str) -> None:
    """Give a group or dataset an attribute of text, of fixed length: those are safe to read."""
    import h5py

    encoded = text.encode(errors="replace")
    thing.attrs.create(name, encoded, dtype=h5py.string_dtype("utf-8", max(len(encoded), 1)))
