"""Lesson 3: velocity from many chirps, the range-Doppler map and detection."""

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from bokeh.layouts import column, row
from bokeh.models import ColorBar, ColumnDataSource, LinearColorMapper, UIElement

from dechirp.core.text import format_number
from dechirp.core.units import to_decibels
from dechirp.radar.radar import Radar
from dechirp.report.labels import (
    BEAT_FREQUENCY_LABEL,
    POWER_OVER_NOISE_LABEL,
    RANGE_LABEL,
    VELOCITY_LABEL,
)
from dechirp.studio.teach.lesson import (
    STACK_WHEN_NARROW_CSS,
    Choice,
    Dial,
    Experiment,
    Lesson,
)
from dechirp.studio.teach.mixer_demo import (
    GUARDS,
    NO_RAMP,
    RAMP,
    MixerComparison,
    MixerFrame,
    MixerSettings,
    compute_iq_and_single_mixer_frames,
)
from dechirp.studio.theme import Theme
from dechirp.studio.views.line_figure import LineFigure

_MAX_VELOCITY_M_PER_S = 70.0
"""Limit of the velocity axes."""
_ADD_CHIRPS, _WHOLE_FRAMES = "one frame, more and more chirps", "successive frames"
_LOW_DB, _HIGH_DB = -5.0, 45.0


class DopplerLesson(Lesson[MixerSettings, MixerComparison]):
    """Maps of two mixers and of one, with the phase over chirps and the threshold below."""

    title = "128 chirps: velocity and detection"
    introduction = (
        "From chirp to chirp the range changes by a fraction of a wavelength, and the phase of the"
        " beat advances. A second transform, over the chirps, gives the velocity. A cell far above"
        " the cells around it is a detection."
    )
    formulas = (
        (r"f_\mathrm{D} = \dfrac{2v}{\lambda}\,,\quad \Delta v = \dfrac{\lambda}{2MT}", "Doppler"),
        (
            r"\alpha = K\left(P_\mathrm{fa}^{-1/K} - 1\right)",
            "threshold over the mean of K training cells",
        ),
    )
    knobs: ClassVar = {
        "velocity_m_per_s": Dial(VELOCITY_LABEL, -60, 60, 1, 20),
        "ramp": Choice("Ramp", (RAMP, NO_RAMP), RAMP),
        "guard": Choice("Guard cells on each side", tuple(GUARDS), "4 cells"),
        "false_alarms": Choice("False-alarm probability", ("1e-6", "1e-4", "1e-3"), "1e-6"),
        "n_chirps": Dial("Chirps M, of 128", 4, 128, 4, 128),
        "play": Choice("Play shows", (_ADD_CHIRPS, _WHOLE_FRAMES), _ADD_CHIRPS),
    }
    animated_dial = ("n_chirps", 4)
    experiments = (
        Experiment(
            "Let the target approach",
            {"velocity_m_per_s": -20},
            "The phase advances in the other direction, and the peak moves to -20 m/s. With a ramp,"
            " one mixer shows this too: the half of its range spectrum that is kept has one peak.",
        ),
        Experiment(
            "Transmit a carrier without a ramp",
            {"ramp": NO_RAMP},
            "One mixer gives real samples, whose phase is zero or half a cycle. It shows equal"
            " peaks at 20 and -20 m/s, so the sign is lost. Two mixers preserve it. All ranges are"
            " in one column.",
        ),
        Experiment(
            "The carrier with an approaching target",
            {"ramp": NO_RAMP, "velocity_m_per_s": -20},
            "The right map is the same as before, the left one is not. The students' report, whose"
            " radar these lessons use, states that one mixer loses the sign of the velocity. This"
            " is true only without a ramp.",
        ),
        Experiment(
            "Remove the guard cells",
            {"guard": "none"},
            "The main lobe of the target now counts as noise. The threshold rises around the target"
            " and would hide a weaker neighbour.",
        ),
        Experiment(
            "Allow more false alarms",
            {"false_alarms": "1e-3", "play": _WHOLE_FRAMES},
            "The threshold falls, and noise alone exceeds it in about one cell in 1,000. Press"
            " Play: the false alarms are in other cells in each frame, and the target stays.",
        ),
    )

    def __init__(self) -> None:
        super().__init__(MixerSettings)
        self._mapper = LinearColorMapper(low=_LOW_DB, high=_HIGH_DB, palette=["#000", "#fff"])
        self._two, self._one = _MapFigure(self._mapper), _MapFigure(self._mapper)
        bar = ColorBar(
            color_mapper=self._mapper,
            width=8,
            padding=2,
            margin=2,
            title=POWER_OVER_NOISE_LABEL,
            title_text_font_size="12px",
            title_text_font_style="normal",
        )
        self._one.figure.add_layout(bar, "right")
        self._phase = LineFigure(
            x="Chirp",
            y="Phase of the target's beat (cycles)",
            x_range=(-1, 128),
            y_range=(-0.55, 0.75),
        )
        self._phase.add_marks("one", "threshold", label="one mixer", size=5, marker="triangle")
        self._phase.add_marks("two", "echo", label="two mixers", size=5)
        self._phase.add_legend(orientation="horizontal")
        self._cut = LineFigure(
            x=VELOCITY_LABEL,
            y=POWER_OVER_NOISE_LABEL,
            x_range=(-_MAX_VELOCITY_M_PER_S, _MAX_VELOCITY_M_PER_S),
            y_range=(_LOW_DB - 5, _HIGH_DB + 18),
        )
        self._cut.add_vertical_bands("training", "echo", label="training", alpha=0.15)
        self._cut.add_vertical_bands("guard", "muted", label="guard", alpha=0.25)
        self._cut.add_line(
            "one", "threshold", label="one mixer", line_width=1.2, line_dash="dashed"
        )
        self._cut.add_line("two", "echo", label="two mixers", line_width=2)
        self._cut.add_line("threshold", "track", label="threshold", line_width=2)
        self._cut.add_legend(orientation="horizontal")
        self._root = column(
            *(
                row(*pair, sizing_mode="stretch_both", stylesheets=[STACK_WHEN_NARROW_CSS])
                for pair in (
                    (self._two.figure, self._one.figure),
                    (self._phase.figure, self._cut.figure),
                )
            ),
            sizing_mode="stretch_both",
        )

    @property
    def root_element(self) -> UIElement:
        return self._root

    def compute_frame(self, settings: MixerSettings, frame_number: int) -> MixerComparison:
        return compute_iq_and_single_mixer_frames(settings, frame_number)

    def draw_frame_and_format_numbers(self, frame: MixerComparison) -> Mapping[str, str]:
        two_mixers, one_mixer, settings = frame.two_mixers, frame.one_mixer, frame.settings
        radar = settings.radar("complex")
        for map_, mixer_frame, name in (
            (self._two, two_mixers, "Two mixers"),
            (self._one, one_mixer, "One mixer"),
        ):
            map_.draw_map_near_target(
                mixer_frame,
                radar,
                x_label=BEAT_FREQUENCY_LABEL if settings.ramp == NO_RAMP else RANGE_LABEL,
            )
            strongest = mixer_frame.velocity_m_per_s[
                np.argmax(mixer_frame.power[:, mixer_frame.column])
            ]
            image = (
                settings.ramp == NO_RAMP and mixer_frame is one_mixer and settings.velocity_m_per_s
            )
            peak_text = "a peak and its image" if image else f"a peak at {strongest:+.1f} m/s"
            map_.set_title(f"{name}: {peak_text}")
        for name, mixer_frame in (("two", two_mixers), ("one", one_mixer)):
            self._phase.set_data(
                name, x=np.arange(mixer_frame.phase_turns.size), y=mixer_frame.phase_turns
            )
            self._cut.set_data(
                name,
                x=mixer_frame.velocity_m_per_s,
                y=_to_clipped_db(mixer_frame.power[:, mixer_frame.column]),
            )
        self._phase.set_title(f"Phase from chirp to chirp: {radar.frame.n_chirps} of 128 chirps")
        self._cut.set_title("Cut through the target along velocity")
        self._draw_threshold_and_training_cells(frame)
        waveform = radar.frame
        pending_text = "with 128 chirps"
        return {
            "velocity bin λ / 2MT": f"{waveform.velocity_resolution_m_per_s:.2f} m/s",
            "unambiguous velocity": f"±{waveform.max_velocity_m_per_s:.0f} m/s",
            "false alarms in the frame": pending_text
            if two_mixers.threshold is None
            else f"{two_mixers.n_false_alarms:,}",
            "expected false alarms": format_number(
                two_mixers.n_tested * float(settings.false_alarms), 2
            ),
        }

    def _draw_threshold_and_training_cells(self, comparison: MixerComparison) -> None:
        two_mixers, training_window = comparison.two_mixers, comparison.training_window
        if two_mixers.threshold is None:
            self._cut.set_data("threshold", x=[], y=[])
            self._cut.set_data("training", left=[], right=[])
            self._cut.set_data("guard", left=[], right=[])
            return
        self._cut.set_data(
            "threshold",
            x=two_mixers.velocity_m_per_s,
            y=_to_clipped_db(two_mixers.threshold[:, two_mixers.column]),
        )
        step = float(two_mixers.velocity_m_per_s[1] - two_mixers.velocity_m_per_s[0])
        peak = two_mixers.velocity_m_per_s[np.argmax(two_mixers.power[:, two_mixers.column])]
        inner, outer = (
            (n + 0.5) * step
            for n in (training_window.n_guard.velocity, training_window.half_velocity)
        )
        self._cut.set_data(
            "training", left=[peak - outer, peak + inner], right=[peak - inner, peak + outer]
        )
        self._cut.set_data("guard", left=[peak - inner], right=[peak + inner])

    def next_animated_knob_values(self, knob_values: Mapping[str, Any]) -> Mapping[str, float]:
        return (
            {}
            if knob_values["play"] == _WHOLE_FRAMES
            else super().next_animated_knob_values(knob_values)
        )

    def apply_theme(self, theme: Theme) -> None:
        for drawing in (self._two, self._one, self._phase, self._cut):
            drawing.apply_theme(theme)
        self._mapper.palette = list(theme.map)


class _MapFigure(LineFigure):
    """Range-Doppler map with a circle around each cell above the threshold."""

    def __init__(self, mapper: LinearColorMapper) -> None:
        super().__init__(
            x=RANGE_LABEL,
            y=VELOCITY_LABEL,
            x_range=(35, 65),
            y_range=(-_MAX_VELOCITY_M_PER_S, _MAX_VELOCITY_M_PER_S),
        )
        self._image = ColumnDataSource({key: [] for key in ("image", "x", "y", "dw", "dh")})
        self.figure.image("image", "x", "y", "dw", "dh", source=self._image, color_mapper=mapper)
        self.figure.grid.visible = False
        self.add_marks("over", "threshold", size=5)

    def draw_map_near_target(self, mixer_frame: MixerFrame, radar: Radar, *, x_label: str) -> None:
        """Draw the columns near the target."""
        chirp, frame = radar.frame.chirp, radar.frame
        first = max(mixer_frame.column - 15, 0)
        last = first + (30 if first else 12)
        bins_hz = chirp.sample_rate_hz / chirp.n_samples
        step = chirp.range_m(bins_hz) if x_label == RANGE_LABEL else bins_hz / 1e6
        self.figure.xaxis[0].axis_label = x_label
        ends = ((first - 0.5) * step, (last - 0.5) * step)
        velocity_step = frame.velocity_resolution_m_per_s
        low = float(mixer_frame.velocity_m_per_s[0]) - velocity_step / 2
        self.set_axis_limits(x=ends, y=(self.figure.y_range.start, self.figure.y_range.end))
        self._image.data = {
            "image": [_to_clipped_db(mixer_frame.power[:, first:last])],
            "x": [ends[0]],
            "y": [low],
            "dw": [ends[1] - ends[0]],
            "dh": [velocity_step * len(mixer_frame.power)],
        }
        cells = np.empty((0, 2), int)
        if mixer_frame.threshold is not None:
            cells = np.argwhere(
                mixer_frame.power[:, first:last] > mixer_frame.threshold[:, first:last]
            )
        self.set_data(
            "over", x=(cells[:, 1] + first) * step, y=mixer_frame.velocity_m_per_s[cells[:, 0]]
        )


def _to_clipped_db(power: np.ndarray) -> np.ndarray:
    with np.errstate(divide="ignore"):
        return np.maximum(to_decibels(power), _LOW_DB - 5).astype(np.float32)
