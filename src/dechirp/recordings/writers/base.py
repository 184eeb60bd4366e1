"""Base class of writers: checks that the format can hold a recording, then writes it."""

from abc import abstractmethod
from collections.abc import Callable
from pathlib import Path
from typing import ClassVar

from dechirp.core.families import Family
from dechirp.core.values import frozen_dataclass
from dechirp.recordings.recording import Recording

Progress = Callable[[int, int], None]
"""Called with the number of completed frames and of all frames."""


@frozen_dataclass
class Writer(Family):
    """Format in which recordings are written."""

    group: ClassVar[str] = "dechirp.writer"
    suffixes: ClassVar[tuple[str, ...]]
    """File suffixes of the format, as `.h5`; the first is the default."""
    summary: ClassVar[str]
    """Stored content in a few words, for the list of formats."""
    is_readable: ClassVar[bool] = True
    """True if `recordings/readers` reads the format."""

    holds_detections: ClassVar[bool] = False
    """True if the format stores detections and no samples."""

    @abstractmethod
    def check_recording(self, recording: Recording) -> None:
        """Raise `DechirpError` if the format cannot hold a recording; writes nothing."""

    def output_files(self, recording: Recording, out: Path) -> tuple[Path, ...]:
        """Return the files and folders that writing would create; usually `out` alone."""
        return (out,)

    @abstractmethod
    def write(
        self, recording: Recording, out: Path, progress: Progress | None = None
    ) -> tuple[Path, ...]:
        """Write a checked recording; one frame is held at a time.

        Parameters
        ----------
        recording : Recording
            Samples with their radar, and the tables stored with them.
        out : Path
            The file or folder, which is replaced. Further files have the same name with other
            suffixes.
        progress : callable, optional
            Called after each frame.

        Returns
        -------
        tuple of Path
            All files and folders written.

        Raises
        ------
        DechirpError
            If it cannot be written, or the disk is full; existing files are then unchanged.
        """
