"""What a settings file says of the recording beside it."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Literal

from dechirp.core.errors import InvalidSetting, RecordingError
from dechirp.core.findings import Finding
from dechirp.core.values import value
from dechirp.radar.devices.base import Device
from dechirp.radar.radar import Radar

Iq = Literal["iq", "qi"]
"""Which comes first, the in-phase or the quadrature sample."""


@value
class Settings:
    """The radar of a recording, and what its settings file says of the layout."""

    radar: Radar
    iq: Iq | None = None
    """None where the file does not say."""
    n_frames: int | None = None
    """Frames the radar was told to send; None where the file does not say."""
    merged: bool = False
    """Whether frames of one chirp each were taken as the chirps of one frame."""
    interleaved: bool | None = None
    """Whether the receivers' samples alternate (True), or lie one receiver after the other in a
    chirp (False); None where the file does not say."""
    bits: int = 16
    """Bits of the converter's codes, which lie in words of 16."""
    receivers: tuple[int, ...] | None = None
    """Which receivers of the chip were on, counted from 0; None where the file does not say."""
    device: str | None = None
    """Kind of the chip, as `radar.devices` calls it; None where the file does not say."""
    path: Path | None = None
    """The file that says so; None where they were made in Python."""
    findings: tuple[Finding, ...] = ()

    def of_radar(self, radar: Radar) -> "Settings":
        """What the file says of the layout, for a radar that was changed since."""
        return replace(self, radar=radar, n_frames=None, findings=())

    def with_findings(self, *found: Finding) -> "Settings":
        """The same settings, with more to be said of them."""
        return replace(self, findings=(*self.findings, *found))

    def of_device(self, device: Device | None) -> "Settings":
        """The same settings, with what is known of the chip where they do not say it."""
        if device is None:
            return self
        interleaved = None if device.lanes is None else device.lanes == 4
        return replace(
            self,
            interleaved=interleaved if self.interleaved is None else self.interleaved,
            device=self.device or device.kind(),
        )

    def receivers_of(self, n_rx: int) -> tuple[int, ...]:
        """Which receivers of the chip the array holds: the first ones where nobody said."""
        told = self.receivers
        return told if told is not None and len(told) == n_rx else tuple(range(n_rx))


@contextmanager
def values_from(file: Path) -> Iterator[None]:
    """Turn settings that cannot work into a `RecordingError` that names their file."""
    try:
        yield
    except InvalidSetting as error:
        raise RecordingError(
            file,
            got=f"settings that cannot work ({error})",
            need="those of a radar that did record",
            fix="Check whether it is the right file, or give the radar.",
        ) from None
