"""A simulated chirp with three bursts of interference, published with a method of repair."""

from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar

import numpy as np

from dechirp.processing.mitigation.tone_fit import fit_tones_outside_bursts
from dechirp.witnesses.base import Comparison, Witness

# Of the authors' `main_IM_SPARKLE.m` with its own settings, after its 60 steps.
_PUBLISHED_SINR_DB = 30.2


class ImSparkleChirp(Witness):
    """Echoes that remain of a chirp whose samples are disturbed to 38 %."""

    folder: ClassVar[str] = "im_sparkle"
    source: ClassVar[str] = "JianpingWang-TUD/InterferenceMitigation_IM-SPARKLE 6344fff"
    licence: ClassVar[str] = "no licence"

    def compare(self, folder: Path) -> Iterator[Comparison]:
        """Compare the ratio of the echoes to what differs from them, in dB."""
        from scipy.io import loadmat  # 0.1 s, of which `list` needs nothing

        data = loadmat(folder / "Data4Demo.mat")
        clean, disturbed = data["sig_Rx_trc"], data["sig_full_trc"]
        echoes = fit_tones_outside_bursts(disturbed).tones
        error = np.linalg.norm(clean - echoes) / np.linalg.norm(clean)
        yield Comparison(
            quantity="signal over interference and noise of the tones fitted outside the bursts",
            theirs=_PUBLISHED_SINR_DB,
            ours=float(-20 * np.log10(error)),
            unit="dB",
            tolerance=0.0,
            relation="at least",
            basis="result of the published method, which models the echoes as well",
        )
