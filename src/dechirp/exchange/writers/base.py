"""What a writer is: it says what its format cannot hold, then writes frame by frame."""

from abc import abstractmethod
from collections.abc import Callable
from pathlib import Path
from typing import ClassVar

from dechirp.core.families import Family
from dechirp.core.values import value
from dechirp.formats.recording import Recording

Progress = Callable[[int, int], None]
"""Called with the number of frames done and of all."""


@value
class Writer(Family):
    """A format that recordings are written in."""

    group: ClassVar[str] = "dechirp.writer"
    endings: ClassVar[tuple[str, ...]]
    """Of names that stand for it, as `.h5`; the first is its own."""
    keeps: ClassVar[str]
    """In a few words for the list of formats: what it keeps of a recording."""
    is_read: ClassVar[bool] = True
    """Whether `formats` reads it back."""

    of_detections: ClassVar[bool] = False
    """Whether it is detections, and no samples, that are written."""

    @abstractmethod
    def check(self, recording: Recording) -> None:
        """Raise `DechirpError` where the format cannot hold a recording; writes nothing."""

    def files(self, recording: Recording, out: Path) -> tuple[Path, ...]:
        """Files and folders that writing it under this name would make; `out` alone for most."""
        return (out,)

    @abstractmethod
    def write(
        self, recording: Recording, out: Path, progress: Progress | None = None
    ) -> tuple[Path, ...]:
        """Write a recording that was checked; one frame is held at a time.

        Parameters
        ----------
        recording : Recording
            Samples with their radar, and the tables that were kept beside them.
        out : Path
            The file or folder, in place of what was there. Others that belong to it lie beside
            it, under the same name with other endings.
        progress : callable, optional
            Told how far it is.

        Returns
        -------
        tuple of Path
            All that was written.

        Raises
        ------
        DechirpError
            If it cannot be written, or the disk fills: what was there is then as it was.
        """
