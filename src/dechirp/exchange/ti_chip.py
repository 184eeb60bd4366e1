"""As which TI chip a recording is written: its antennas, lanes and order of words."""

from dataclasses import replace

import numpy as np

from dechirp.core.errors import DechirpError, InvalidSetting
from dechirp.core.values import value
from dechirp.formats.recording import Recording
from dechirp.formats.samples.layouts import N_LANES, Code, FourLanes, TwoLanes
from dechirp.formats.settings.base import Iq
from dechirp.formats.settings.receivers import known
from dechirp.formats.settings.ti_frame import BITS
from dechirp.formats.settings.ti_numbers import antennas_on, in_steps, must_be_one_profile
from dechirp.formats.settings.write_ti_cfg import ti_cfg_text
from dechirp.radar.devices.base import Device
from dechirp.radar.devices.known import device
from dechirp.radar.radar import Radar

CFG_BITS = BITS[2]
"""Of the demo's converter."""
_BOARDS = ("xwr1843", "xwr6843", "xwr1642", "xwr1443")  # the first that a radar can be
_MOST_TX = 3
_MOST_FRAMES = 65_535  # that the chip counts
_OFF = 1e-3  # of a range, by rounding to the numbers of a chip
_REST_S = 1e-3  # after a frame; the chips need 300 us


@value
class TiChip:
    """The chip as which a radar is written."""

    of: Device
    lanes: int
    tx: tuple[int, ...]
    """Place on the chip of each antenna of the array."""
    rx: tuple[int, ...]
    is_board: bool
    """Whether the antennas lie as on its board."""
    iq: Iq

    def words(self, codes: np.ndarray) -> bytes:
        """Words of the codes (chirp, rx, sample) or (chirp, rx, sample, 2) of a frame."""
        layout = TwoLanes() if self.lanes != N_LANES else FourLanes(receivers=self.rx)
        return layout.encode(codes, Code(iq=self.iq)).astype("<i2", copy=False).tobytes()


def must_be_one_chip(radar: Radar) -> None:
    """Raise `DechirpError` unless one chip of TI's could have such chirps and antennas."""
    for name, there, most in (
        ("rx", radar.array.rx_m, N_LANES),
        ("tx", radar.array.tx_m, _MOST_TX),
    ):
        if len(there) > most:
            raise InvalidSetting(
                f"Radar.array.{name}_m",
                got=f"{len(there)} antennas",
                need=f"at most {most}: a DCA1000 captures one chip, of {N_LANES} receivers on"
                f" {N_LANES} lanes and {_MOST_TX} transmitters",
                fix="Write another format, as .h5, or fewer antennas.",
            )
    must_be_one_profile(radar.frame)
    chirp = radar.frame.chirp
    rate_hz, slope = round(chirp.sample_rate_hz, -3), round(chirp.slope_hz_per_s, -8)
    off = max(abs(rate_hz / chirp.sample_rate_hz - 1), abs(slope / chirp.slope_hz_per_s - 1))
    if off > _OFF:
        raise InvalidSetting(
            "Radar.frame.chirp",
            got=f"of {chirp.sample_rate_hz:.6g} samples/s and {chirp.slope_hz_per_s:.6g} Hz/s",
            need="of rates that a chip counts in kS/s, and slopes in 0.1 kHz/us, to 0.1 %",
            fix="Write another format, as .h5.",
        )
    in_steps(radar.frame)


def chip_of(recording: Recording) -> TiChip:
    """The chip that made it, else the first that could have; of those whose demo can be told."""
    radar = recording.radar
    told = known(recording.contents.device or "")
    if told is not None and told.lanes is not None:
        chips = [_as(told, recording)]
    else:
        chips = [_as(device(kind), recording) for kind in _BOARDS]
    fits = [chip for chip in chips if _holds(chip, radar, recording.n_frames)]
    if not fits:
        chirp = radar.frame.chirp
        raise InvalidSetting(
            "Radar.frame.chirp.n_samples",
            got=f"{chirp.n_samples} {chirp.sampling} samples of {radar.array.n_rx} receivers",
            need=f"as many as {' or '.join(chip.of.kind() for chip in chips)} writes: complex ones"
            " in groups of two, all in whole groups of 8 bytes",
            fix="Leave the last sample out, or write another format, as .h5.",
        )
    told_so = [chip for chip in fits if cfg_of(recording, chip, CFG_BITS)[0] is not None]
    boards = [chip for chip in fits if chip.is_board]
    return [*told_so, *boards, *fits][0]


def _as(of: Device, recording: Recording) -> TiChip:
    """A recording as one of that chip; where antennas lie elsewhere, they are its first ones."""
    array = recording.radar.array
    try:
        (tx, rx), is_board = antennas_on(array, of), True
    except InvalidSetting:
        tx, rx, is_board = tuple(range(len(array.tx_m))), tuple(range(array.n_rx)), False
    return TiChip(
        of=of,
        lanes=of.lanes or 2,
        tx=tx,
        rx=rx,
        is_board=is_board,
        iq=recording.contents.iq or "iq",
    )


def _holds(chip: TiChip, radar: Radar, n_frames: int) -> bool:
    """Whether samples come in the groups of the chip."""
    chirp = radar.frame.chirp
    is_complex = chirp.sampling == "complex"
    if chip.lanes == N_LANES:
        return True
    n_words = n_frames * radar.frame.n_sent * radar.array.n_rx * chirp.n_samples
    return chirp.n_samples % 2 == 0 if is_complex else n_words % 4 == 0


def cfg_of(recording: Recording, chip: TiChip, bits: int) -> tuple[str | None, str]:
    """Text of the `.cfg`; none, and why, where the demo of the board cannot be told."""
    if bits != CFG_BITS:
        return None, f"its codes have {bits} bits, those of the demo {CFG_BITS}"
    try:
        text = ti_cfg_text(
            told_radar(recording), device=chip.of, n_frames=told_frames(recording), iq=chip.iq
        )
    except DechirpError as error:
        return None, "; ".join(f"{one.setting} is {one.got}" for one in error.mistakes)
    return text, ""


def told_frames(recording: Recording) -> int:
    """Frames as the chip counts them; 0: until stopped."""
    return recording.n_frames if recording.n_frames <= _MOST_FRAMES else 0


def told_radar(recording: Recording) -> Radar:
    """The radar as settings of the chip say it: a frame alone has any period, for they need one."""
    radar = recording.radar
    if radar.frame.period_s is not None or recording.n_frames > 1:
        return radar
    return replace(radar, frame=replace(radar.frame, period_s=radar.frame.duration_s + _REST_S))
