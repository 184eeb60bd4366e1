"""What an impairment is, in three stages, in the order of the signal.

An oscillator that is not what it should be turns the phase of what is sent and of what it is
mixed with. Paths add echoes, and weaken them. A receiver changes samples.
"""

from abc import abstractmethod
from collections.abc import Callable, Sequence
from typing import ClassVar, Literal

import numpy as np

from dechirp.core.families import Family
from dechirp.echoes.parts import Part, Window
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene

Ramps = Literal["any", "rising", "alike", "even"]


class Impairment(Family):
    """Acts in its stage; within a stage in the order in which impairments are listed."""

    group: ClassVar[str] = "dechirp.impairment"
    ramps: ClassVar[Ramps] = "any"
    """Under which modulations it is right: any; ramps that all rise; ramps that are all as the
    chirp says; ramps that are so at even intervals, as without a modulation."""

    def check(self, scene: Scene, radar: Radar) -> None:
        """Raise `InvalidSetting` where it cannot act; warn of what surprises.

        The setting in the error is a field of this impairment, as settings files call it.
        """

    def noise_power_w(self, scene: Scene, radar: Radar) -> float:
        """Mean power of the noise that it adds to each sample, W; none by default."""
        return 0.0


class Preset(Impairment):
    """Stands for several impairments, with settings that belong together."""

    @abstractmethod
    def impairments(self, radar: Radar) -> tuple[Impairment, ...]:
        """Those it stands for in a radar."""


class Oscillator(Impairment):
    """A phase error of the wave that is sent; the mixer sees it now, less that a delay ago."""

    # The filter that stands for the delays of all echoes at once is that of one slope.
    ramps: ClassVar[Ramps] = "rising"

    @abstractmethod
    def phase_rad(self, window: Window, radar: Radar, rng: np.random.Generator) -> np.ndarray:
        """Phase error at the times of the window, (n_chirps, n_times), rad.

        All that is sent and received in a frame carries the same error. The window begins
        before the ramp where echoes come late: there the frequency error is that of its start.
        """


class Propagation(Impairment):
    """More echoes, or weaker ones."""

    def parts(
        self,
        parts: Sequence[Part],
        window: Window,
        scene: Scene,
        radar: Radar,
        rng: np.random.Generator,
    ) -> list[Part]:
        """What is summed for a frame instead of `parts`."""
        return list(parts)

    def way_out(self, radar: Radar) -> float:
        """Amplitude that is left, on the way out, of what lights all scatterers of a frame.

        Also of those that impairments listed after it add.
        """
        return 1.0

    def added_delays_s(self, radar: Radar) -> tuple[float, float] | None:
        """Between which delays what `add` adds lies; none where it carries no delayed phase."""
        return None

    def add(
        self,
        samples: np.ndarray,
        window: Window,
        scene: Scene,
        radar: Radar,
        rng: np.random.Generator,
    ) -> None:
        """Add what needs no scatterer to the samples of a window, (n_chirps, n_rx, n_times).

        Complex, in place, before the oscillator turns their phase. Called with some chirps of
        a frame after the other, each time with a generator that begins alike: what is drawn
        for the frame is the same in all of them.
        """


class Receiver(Impairment):
    """Changes samples, real or complex as the radar takes them."""

    def margins(self, radar: Radar) -> tuple[int, int]:
        """Samples that it needs before and after those that are kept."""
        return 0, 0

    @abstractmethod
    def apply(
        self, samples: np.ndarray, scene: Scene, radar: Radar, rng: np.random.Generator
    ) -> None:
        """Change samples, (n_frames, n_chirps, n_rx, n_samples), sqrt(W), in place."""

    def prepared(
        self, scene: Scene, radar: Radar
    ) -> Callable[[np.ndarray, np.random.Generator], None]:
        """`apply` for one scene and radar: what depends on those alone is found once, if it can."""
        return lambda samples, rng: self.apply(samples, scene, radar, rng)

    def attributes(self, radar: Radar) -> dict[str, object]:
        """What the cube says of it, where no other receiver changes samples after it."""
        return {}
