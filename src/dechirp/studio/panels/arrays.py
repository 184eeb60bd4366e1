"""Edits of the array, with the settings that must change together with it."""

from collections.abc import Iterable
from dataclasses import replace

from dechirp.config.yaml_tree import parse_yaml
from dechirp.core.errors import DechirpError
from dechirp.experiments.scenario import Scenario
from dechirp.processing.angle.fft import Fft
from dechirp.processing.direction_finding import can_resolve_directions
from dechirp.radar.array import Array
from dechirp.radar.multiplexing.tdm import Tdm
from dechirp.radar.radar import Radar
from dechirp.studio.panels.knobs import NONE, format_setting_inline
from dechirp.studio.scenario_edits import PageLimits, apply_overrides

_MULTIPLEXING = "radar.frame.multiplexing"


def linear_array_tdm_overrides(radar: Radar, n_tx: int, n_rx: int) -> tuple[str, ...]:
    """Return PATH=VALUE options for a uniform linear array with TDM transmitters."""
    spacing_m = round(radar.frame.chirp.wavelength_m / 2, 6)
    array = Array(
        tx_m=tuple((0.0, index * n_rx * spacing_m, 0.0) for index in range(n_tx)),
        rx_m=tuple((0.0, index * spacing_m, 0.0) for index in range(n_rx)),
    )
    calibration = () if radar.calibration is None else (f"radar.calibration={NONE}",)
    return (f"radar.array={format_setting_inline(array)}", _tdm_override(n_tx), *calibration)


def replace_array_elements(
    scenario: Scenario, path: str, text: str, limits: PageLimits
) -> Scenario:
    """Return the scenario with other elements; a new number of transmitters uses TDM.

    Raises
    ------
    DechirpError
        As `scenario_edits.apply_overrides`.
    """
    option = f"{path}={text}"
    try:
        return apply_array_overrides(scenario, (option,), limits)
    except DechirpError as error:
        if any(mistake.setting != _MULTIPLEXING for mistake in error.mistakes):
            raise
    elements = parse_yaml(text, path).content
    assert isinstance(elements, list)  # anything else was refused above
    return apply_array_overrides(scenario, (option, _tdm_override(len(elements))), limits)


def apply_array_overrides(
    scenario: Scenario, overrides: Iterable[str], limits: PageLimits
) -> Scenario:
    """Return the scenario with another array, without the parts that need missing directions.

    Raises
    ------
    DechirpError
        As `scenario_edits.apply_overrides`.
    """
    radar = apply_overrides(_without_direction_processing(scenario), overrides, limits).radar
    assert radar is not None
    return replace_radar_and_adapt_processing(scenario, radar)


def replace_radar_and_adapt_processing(scenario: Scenario, radar: Radar) -> Scenario:
    """Return the scenario with another radar; without directions there is no tracker."""
    if not can_resolve_directions(radar):
        scenario = _without_direction_processing(scenario)
    return replace(scenario, radar=radar)


def _without_direction_processing(scenario: Scenario) -> Scenario:
    """Return the scenario with no use of directions: `Fft` also accepts arrays without any."""
    chain = scenario.chain
    angle = None if chain.angle is None else Fft()
    return replace(
        scenario,
        chain=replace(chain, angle=angle),
        ego_motion=None,
        tracker=None,
        group_tracker=None,
    )


def _tdm_override(n_tx: int) -> str:
    """Return the PATH=VALUE option for time-division multiplexing."""
    multiplexing = format_setting_inline(Tdm(order=tuple(range(n_tx)))) if n_tx > 1 else NONE
    return f"{_MULTIPLEXING}={multiplexing}"
