"""Stages of a simulation: impairments sorted into the order in which they act."""

import reprlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import NamedTuple

from dechirp.core.checks import as_tuple_or_none
from dechirp.core.errors import InvalidSetting
from dechirp.radar.frame import Frame
from dechirp.radar.radar import Radar
from dechirp.simulation.impairments.base import (
    Impairment,
    Oscillator,
    Preset,
    Propagation,
    Receiver,
)

_RAMP_SUPPORT = {
    "any": "any ramps",
    "rising": "rising ramps only",
    "alike": "ramps that all equal the chirp's",
    "even": "equal ramps at equal intervals",
}


class Stages(NamedTuple):
    """Impairments by stage."""

    oscillators: tuple[Oscillator, ...]
    paths: tuple[Propagation, ...]
    receivers: tuple[Receiver, ...]
    presets: tuple[Preset, ...] = ()
    """Presets that some of the other impairments were expanded from."""

    @property
    def impairments(self) -> tuple[Impairment, ...]:
        """Return all impairments in the order in which they act, presets first."""
        return (*self.presets, *self.oscillators, *self.paths, *self.receivers)

    def sample_margins(self, radar: Radar) -> tuple[int, int]:
        """Return how many extra samples the receivers need before and after the window."""
        needed = [receiver.sample_margins(radar) for receiver in self.receivers]
        return sum(n_before for n_before, _ in needed), sum(n_after for _, n_after in needed)


def sort_into_stages(impairments: Iterable[Impairment], radar: Radar) -> Stages:
    """Expand presets and sort impairments into their stages.

    Raises
    ------
    InvalidSetting
        If `impairments` is not a list, or an element is not an impairment.
    """
    listed = as_tuple_or_none(impairments)
    if listed is None:
        raise InvalidSetting(
            "impairments",
            value=reprlib.repr(impairments),
            expected="a list of impairments",
            fix="write [ThermalNoise()], with brackets even for a single impairment",
        )
    expanded = tuple(_expand_presets_recursively(listed, radar))
    return Stages(
        tuple(impairment for impairment in expanded if isinstance(impairment, Oscillator)),
        tuple(impairment for impairment in expanded if isinstance(impairment, Propagation)),
        tuple(impairment for impairment in expanded if isinstance(impairment, Receiver)),
        tuple(impairment for impairment in expanded if isinstance(impairment, Preset)),
    )


@contextmanager
def prefix_errors_with_kind(impairment: Impairment) -> Iterator[None]:
    """Add the kind of an impairment to the setting named by its errors."""
    try:
        yield
    except InvalidSetting as error:
        (mistake,) = error.mistakes
        if mistake.setting.startswith("Radar."):
            raise
        raise InvalidSetting(
            f"{impairment.kind()}.{mistake.setting}",
            value=mistake.value, expected=mistake.expected, fix=mistake.fix,
        ) from None  # fmt: skip


def check_ramps_supported(impairment: Impairment, frame: Frame) -> None:
    """Raise `InvalidSetting` if an impairment does not support the ramps of a frame."""
    is_supported = {
        "any": True,
        "rising": all(ramp.sign > 0 for ramp in frame.ramps),
        "alike": frame.has_identical_ramps,
        "even": frame.modulation is None,
    }
    if frame.modulation is not None and not is_supported[impairment.supported_ramps]:
        raise InvalidSetting(
            "Radar.frame.modulation",
            value=f"{frame.modulation.kind()}, with an impairment of kind {impairment.kind()}",
            expected=f"{_RAMP_SUPPORT[impairment.supported_ramps]} for this impairment",
            fix="remove the modulation or the impairment",
        )


def radar_at_shortest_chirp_interval(radar: Radar) -> Radar:
    """Return the radar as configured in the frame with the shortest chirp interval."""
    radars = [radar.for_frame(index) for index in range(radar.frame.n_intervals)]
    return min(radars, key=lambda impairment: impairment.frame.single_interval_s)


def _expand_presets_recursively(
    impairments: Iterable[Impairment], radar: Radar
) -> Iterator[Impairment]:
    for impairment in impairments:
        if isinstance(impairment, Preset):
            yield impairment
            yield from _expand_presets_recursively(impairment.impairments(radar), radar)
        elif isinstance(impairment, Oscillator | Propagation | Receiver):
            yield impairment
        else:
            raise InvalidSetting(
                "impairments",
                value=impairment,
                expected=f"impairments: {', '.join(Impairment.members())}",
                fix="write ThermalNoise(), with its parentheses",
            )
