"""Panel of the hardware: powers, gains and impairments."""

from bokeh.models import UIElement

from dechirp.studio.panels.base import Panel
from dechirp.studio.panels.knob_widgets import KnobForm, make_setting_changer
from dechirp.studio.session import Session
from dechirp.studio.theme import Theme

_POWERS = "Powers and gains"
_GROUPS = {
    "Noise, quantisation and ADC": "thermal-noise white-noise coloured-noise quantisation"
    " aperture-jitter dc-offset",
    "Oscillator and ramp": "phase-noise pll slope-drift sinusoidal-nonlinearity"
    " polynomial-nonlinearity",
    "Mixers and channels": "iq-imbalance compression if-filter channel-mismatch mutual-coupling"
    " position-errors automotive-chip",
    "Leakage and interference": "leakage interference",
    "Propagation and weather": "bumper radome rain-attenuation rain-backscatter fog-attenuation"
    " gas-attenuation two-ray-ground wall-multipath body-multipath",
}
_GROUP_BY_KIND = {kind: title for title, kinds in _GROUPS.items() for kind in kinds.split()}
_HARDWARE = "transmit_power antenna_gain noise_factor loss tx_pattern rx_pattern"


class Hardware(Panel):
    """Knobs of the hardware, and switches for impairments."""

    name = "hardware"

    def __init__(self, session: Session) -> None:
        super().__init__(session)
        paths = [*(f"radar.hardware.{key}" for key in _HARDWARE.split()), "impairments"]
        self._form = KnobForm(
            session.scenario,
            lambda _: paths,
            make_setting_changer(session),
            group=_group_of_setting,
        )
        self._form.root_element.name = self.name
        session.on_settings.append(self._form.show_settings_of)
        session.on_mistakes.append(self._form.show_mistakes)

    @property
    def root_element(self) -> UIElement:
        return self._form.root_element

    def apply_theme(self, theme: Theme) -> None:
        """Do nothing: the widgets inherit the colours of the page."""


def _group_of_setting(path: str) -> str:
    whole, _, rest = path.partition(".")
    if whole != "impairments":
        return _POWERS
    return _GROUP_BY_KIND.get(rest.partition(".")[0].rstrip("0123456789-"), "Other impairments")
