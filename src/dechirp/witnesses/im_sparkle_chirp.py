"""A simulated chirp with three bursts of interference, published with a method of repair."""

from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar

import numpy as np

from dechirp.processing.mitigation.interference_tones import InterferenceTones
from dechirp.radar.chirp import Chirp
from dechirp.radar.frame import Frame
from dechirp.witnesses.base import Comparison, Witness
from dechirp.witnesses.hankel_decomposition import separate_tones_from_bursts

_BASIS = "not worse than the published method, computed here with the settings of its script"


class ImSparkleChirp(Witness):
    """Echoes that remain of a chirp whose samples are disturbed to 38 %."""

    folder: ClassVar[str] = "im_sparkle"
    source: ClassVar[str] = "JianpingWang-TUD/InterferenceMitigation_IM-SPARKLE 6344fff"
    licence: ClassVar[str] = "no licence"

    def compare(self, folder: Path) -> Iterator[Comparison]:
        """Compare the SINR after mitigation with that of the published method, by its formula.

        The published method returns echoes without noise. It is compared with the mitigation that
        removes noise as well, and, in the bursts of the one that keeps noise, with that one.
        """
        from scipy.io import loadmat  # 0.1 s, of which `list` needs nothing

        data = loadmat(folder / "Data4Demo.mat")
        clean, disturbed = data["sig_Rx_trc"][0], data["sig_full_trc"][0]
        published = separate_tones_from_bursts(disturbed)
        times = data["t"][0]
        chirp = Chirp(
            start_frequency_hz=float(data["f_c"].item()),
            slope_hz_per_s=float(data["sweep_slope"].item()),
            adc_start_s=float(times[0]),
            ramp_duration_s=float(times[-1]) + 1e-6,
            sample_rate_hz=float(data["f_s"].item()),
            n_samples=times.size,
            sampling="complex",
        )
        frame = Frame(chirp=chirp, interval_s=chirp.ramp_duration_s, n_chirps=1)
        samples = disturbed.astype(np.complex64)[None, None]
        repaired, tones = (
            InterferenceTones(keep_noise=keep_noise).clean(samples, frame)[0, 0]
            for keep_noise in (True, False)
        )
        is_burst = repaired != samples[0, 0]
        yield _compare_sinr("without noise", clean, published, tones)
        yield _compare_sinr(
            "noise kept outside the bursts",
            clean,
            np.where(is_burst, published, disturbed),
            repaired,
        )
        yield _compare_sinr(
            "in the bursts", clean[is_burst], published[is_burst], repaired[is_burst]
        )


def _compare_sinr(part: str, clean: np.ndarray, theirs: np.ndarray, ours: np.ndarray) -> Comparison:
    theirs_db, ours_db = (
        float(20 * np.log10(np.linalg.norm(clean) / np.linalg.norm(clean - signal)))
        for signal in (theirs, ours)
    )
    return Comparison(
        quantity=f"SINR after mitigation, {part}",
        theirs=theirs_db,
        ours=ours_db,
        unit="dB",
        tolerance=0.0,
        relation="at least",
        basis=_BASIS,
        answer="own",  # their method, but computed here: no result is in the file
    )
