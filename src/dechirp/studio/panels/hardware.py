"""What the electronics do: powers and gains, and what is not as it should be."""

from bokeh.models import UIElement

from dechirp.studio.panels.base import Panel
from dechirp.studio.panels.fields import Form, changer
from dechirp.studio.session import Session
from dechirp.studio.theme import Theme

_HARDWARE = "transmit_power antenna_gain noise_factor loss tx_pattern rx_pattern"


class Hardware(Panel):
    """Knobs of the hardware, and impairments to switch on and off."""

    name = "hardware"

    def __init__(self, session: Session) -> None:
        super().__init__(session)
        paths = [*(f"radar.hardware.{key}" for key in _HARDWARE.split()), "impairments"]
        self._form = Form(session.scenario, lambda _: paths, changer(session))
        self._form.root.name = self.name
        session.on_settings.append(self._form.show)
        session.on_trouble.append(self._form.tell)

    @property
    def root(self) -> UIElement:
        """The knobs."""
        return self._form.root

    def wear(self, theme: Theme) -> None:
        """Take the colours of a theme: widgets inherit them."""
