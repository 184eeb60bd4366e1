"""Shortest radar as YAML, for the messages of recordings without settings."""

import math
import shlex
from pathlib import Path

from dechirp.core.values import frozen_dataclass


@frozen_dataclass
class RadarExample:
    """Waveform of an example, with the values that the recording itself contains.

    Its frequencies are those of a typical radar: files of samples do not contain them.
    """

    start_frequency: str = "77 GHz"
    slope: str = "20 MHz/us"
    sample_rate_hz: float = 5e6
    n_samples: int = 256
    sampling: str = "complex"
    n_chirps: int = 128
    interval_s: float | None = None
    """None: 20 µs after the end of a ramp."""
    options: str = ""
    """Options that the recording needs beside the radar, such as ` --axes chirp,sample`."""
    inner_name: str | None = None
    """Name of the array in the file of the recording."""
    known: tuple[str, ...] = ()
    """Names of the settings that come from the recording."""

    def advice(self, recording: Path) -> str:
        """Return the commands that write the radar and read the recording with it."""
        if not self.known:
            values = "with your values"
        else:
            values = f"with your values ({', '.join(self.known)} are of the recording)"
        if self.inner_name is not None:
            recording /= self.inner_name
        return (
            "give the radar: --radar FILE (radar=FILE in Python), its vendor's settings or YAML"
            f" {values}: echo '{self._yaml()}' > radar.yaml; dechirp run"
            f" {shlex.quote(str(recording))}{self.options} --radar radar.yaml"
        )

    def _yaml(self) -> str:
        # 52 µs of samples fit into a ramp of 60 µs.
        ramp_us = 10 * math.ceil(1.15e5 * self.n_samples / self.sample_rate_hz)
        interval_us = ramp_us + 20 if self.interval_s is None else 1e6 * self.interval_s
        return (
            f"frame: {{chirp: {{start_frequency: {self.start_frequency}, slope: {self.slope},"
            f" ramp_duration: {ramp_us} us, sample_rate: {self.sample_rate_hz / 1e6:.9g} MHz,"
            f" n_samples: {self.n_samples}, sampling: {self.sampling}}},"
            f" n_chirps: {self.n_chirps}, interval: {interval_us:.6g} us}}"
        )
