"""Impairments in the order in which they act."""

import reprlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import NamedTuple

from dechirp.core.checks import listed
from dechirp.core.errors import InvalidSetting
from dechirp.echoes.impairments.base import Impairment, Oscillator, Preset, Propagation, Receiver
from dechirp.radar.frame import Frame
from dechirp.radar.radar import Radar


class Stages(NamedTuple):
    """Impairments by stage."""

    oscillators: tuple[Oscillator, ...]
    paths: tuple[Propagation, ...]
    receivers: tuple[Receiver, ...]
    presets: tuple[Preset, ...] = ()
    """Those that some of the others come from."""

    @property
    def all(self) -> tuple[Impairment, ...]:
        """In the order in which they act, presets first."""
        return (*self.presets, *self.oscillators, *self.paths, *self.receivers)

    def margins(self, radar: Radar) -> tuple[int, int]:
        """Samples that receivers need before and after those that are kept."""
        needed = [receiver.margins(radar) for receiver in self.receivers]
        return sum(before for before, _ in needed), sum(after for _, after in needed)


def by_stage(impairments: Iterable[Impairment], radar: Radar) -> Stages:
    """Sort impairments into their stages; presets give those they stand for.

    Raises
    ------
    InvalidSetting
        If they are no list, or one of them is no impairment.
    """
    given = listed(impairments)
    if given is None:
        raise InvalidSetting(
            "impairments",
            got=reprlib.repr(impairments),
            need="a list of impairments",
            fix="Write [ThermalNoise()], with the brackets of a list, even for one alone.",
        )
    every = tuple(_single(given, radar))
    return Stages(
        tuple(one for one in every if isinstance(one, Oscillator)),
        tuple(one for one in every if isinstance(one, Propagation)),
        tuple(one for one in every if isinstance(one, Receiver)),
        tuple(one for one in every if isinstance(one, Preset)),
    )


@contextmanager
def naming(impairment: Impairment) -> Iterator[None]:
    """Name what an impairment refuses by its kind as well."""
    try:
        yield
    except InvalidSetting as error:
        (mistake,) = error.mistakes
        if mistake.setting.startswith("Radar."):
            raise
        raise InvalidSetting(
            f"{impairment.kind()}.{mistake.setting}",
            got=mistake.got, need=mistake.need, fix=mistake.fix,
        ) from None  # fmt: skip


def must_suit(impairment: Impairment, frame: Frame) -> None:
    """Raise `InvalidSetting` where a frame has ramps of which an impairment does not know."""
    suits = {
        "any": True,
        "rising": all(ramp.sign > 0 for ramp in frame.ramps),
        "alike": frame.ramps_are_alike,
        "even": frame.modulation is None,
    }
    if frame.modulation is not None and not suits[impairment.ramps]:
        raise InvalidSetting(
            "Radar.frame.modulation",
            got=f"{frame.modulation.kind()}, with an impairment of kind {impairment.kind()}",
            need=f"ramps that are {impairment.ramps}: of others it does not know",
            fix="Leave one of the two out.",
        )


def shortest(radar: Radar) -> Radar:
    """The radar as it is in the frame of the shortest interval."""
    each = [radar.at(index) for index in range(radar.frame.n_intervals)]
    return min(each, key=lambda one: one.frame.only_interval_s)


def _single(impairments: Iterable[Impairment], radar: Radar) -> Iterator[Impairment]:
    for impairment in impairments:
        if isinstance(impairment, Preset):
            yield impairment
            yield from _single(impairment.impairments(radar), radar)
        elif isinstance(impairment, Oscillator | Propagation | Receiver):
            yield impairment
        else:
            raise InvalidSetting(
                "impairments",
                got=impairment,
                need=f"impairments: {', '.join(Impairment.members())}",
                fix="Write ThermalNoise(), with its brackets.",
            )
