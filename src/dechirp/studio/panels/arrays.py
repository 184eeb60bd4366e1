"""Another array, and what has to change with it for one edit to be enough."""

from collections.abc import Iterable
from dataclasses import replace

from dechirp.config.tree import read_tree
from dechirp.core.errors import DechirpError
from dechirp.experiment.scenario import Scenario
from dechirp.process.angle.fft import Fft
from dechirp.process.sources import tells_directions
from dechirp.radar.array import Array
from dechirp.radar.multiplexing.tdm import Tdm
from dechirp.radar.radar import Radar
from dechirp.studio.panels.entries import NONE, written
from dechirp.studio.settings import Limits, changed

_SHARED = "radar.frame.multiplexing"


def in_a_row(radar: Radar, n_tx: int, n_rx: int) -> tuple[str, ...]:
    """PATH=VALUE for an array in a row, half a wavelength apart, whose transmitters take turns."""
    apart_m = round(radar.frame.chirp.wavelength_m / 2, 6)
    array = Array(
        tx_m=tuple((0.0, place * n_rx * apart_m, 0.0) for place in range(n_tx)),
        rx_m=tuple((0.0, place * apart_m, 0.0) for place in range(n_rx)),
    )
    calibration = () if radar.calibration is None else (f"radar.calibration={NONE}",)
    return (f"radar.array={written(array)}", _in_turn(n_tx), *calibration)


def with_elements(scenario: Scenario, path: str, text: str, limits: Limits) -> Scenario:
    """A scenario with other elements; of more or fewer transmitters than before, all take turns.

    Raises
    ------
    DechirpError
        As `settings.changed`.
    """
    own = f"{path}={text}"
    try:
        return with_array(scenario, (own,), limits)
    except DechirpError as error:
        if any(one.setting != _SHARED for one in error.mistakes):
            raise
    listed = read_tree(text, path).content
    assert isinstance(listed, list)  # else it would have been refused for itself
    return with_array(scenario, (own, _in_turn(len(listed))), limits)


def with_array(scenario: Scenario, options: Iterable[str], limits: Limits) -> Scenario:
    """A scenario with an array, of options PATH=VALUE, and without what it has no directions for.

    Raises
    ------
    DechirpError
        As `settings.changed`.
    """
    made = changed(_undirected(scenario), options, limits).radar
    assert made is not None
    return with_radar(scenario, made)


def with_radar(scenario: Scenario, radar: Radar) -> Scenario:
    """A scenario with another radar; with one that tells no direction nothing is followed."""
    if not tells_directions(radar):
        scenario = _undirected(scenario)
    return replace(scenario, radar=radar)


def _undirected(scenario: Scenario) -> Scenario:
    """A scenario that asks for no directions: `Fft` steps aside where there are none."""
    chain = scenario.chain
    angle = None if chain.angle is None else Fft()
    return replace(scenario, chain=replace(chain, angle=angle), ego_motion=None, tracker=None)


def _in_turn(n_tx: int) -> str:
    """PATH=VALUE for transmitters that take turns."""
    turns = written(Tdm(order=tuple(range(n_tx)))) if n_tx > 1 else NONE
    return f"{_SHARED}={turns}"
