"""The scene: targets that come and go, and the noise that they are seen in."""

from dataclasses import replace
from functools import partial

import numpy as np
from bokeh.models import Button, Column, Row, Select, UIElement

from dechirp.core.errors import InvalidSetting
from dechirp.core.units import decibels
from dechirp.echoes.impairments.base import Impairment
from dechirp.echoes.impairments.thermal_noise import ThermalNoise
from dechirp.echoes.impairments.white_noise import WhiteNoise
from dechirp.experiment.scenario import Scenario
from dechirp.radar.budget import noise_power_w
from dechirp.scene.target import Target
from dechirp.studio.panels.base import Panel
from dechirp.studio.panels.entries import NONE, label_of
from dechirp.studio.panels.fields import Form, changer
from dechirp.studio.session import Edit, Session
from dechirp.studio.settings import changed, checked
from dechirp.studio.theme import Theme

_KEYS = "name position velocity rcs fluctuation body"
_NOISES = {
    "thermal": "by the noise figure",
    "white": "by the SNR",
    "none": "none",
}


class Targets(Panel):
    """Knobs of the targets, of the noise and of time."""

    name = "targets"

    def __init__(self, session: Session) -> None:
        super().__init__(session)
        self._rows: list[_Row] = []
        self._list = Column(sizing_mode="stretch_width", spacing=8)
        self._add = Button(label="Add a target", sizing_mode="stretch_width", margin=(6, 0, 6, 0))
        self._add.on_click(lambda: self._edit("add a target", with_target))
        self._noise = Select(
            title="Noise",
            options=list(_NOISES.items()),
            sizing_mode="stretch_width",
            css_classes=["field"],
            margin=(2, 0, 2, 0),
        )
        self._noise.on_change("value", lambda attr, old, new: self._take(str(new)))
        self._form = Form(session.scenario, _of_noise, changer(session))
        self._root = Column(
            name=self.name,
            children=[self._noise, self._form.root, self._list, self._add],
            sizing_mode="stretch_width",
            spacing=0,
        )
        session.on_settings.append(self._show)
        session.on_trouble.append(self._form.tell)
        self._show(session.scenario)

    @property
    def root(self) -> UIElement:
        """The knobs."""
        return self._root

    def wear(self, theme: Theme) -> None:
        """Take the colours of a theme: widgets inherit them."""

    def _show(self, scenario: Scenario) -> None:
        scene = scenario.scene
        for part in (self._add, self._noise, self._list):
            part.visible = scene is not None
        self._form.show(scenario)
        self._noise.value = _noise_of(scenario)
        targets = () if scene is None else scene.targets
        while len(self._rows) < len(targets):
            self._rows.append(_Row(self.session, len(self._rows)))
        for row in self._rows[: len(targets)]:
            row.form.show(scenario)
        roots = [row.root for row in self._rows[: len(targets)]]
        if self._list.children != roots:
            self._list.children = roots

    def _take(self, noise: str) -> None:
        if noise != _noise_of(self.session.scenario):
            self._edit("noise", partial(with_noise, noise=noise))

    def _edit(self, key: str, made: Edit) -> None:
        self.session.edit(key, lambda scenario: checked(made(scenario), self.session.limits))


class _Row:
    """One target: its knobs, and a button that takes it out."""

    def __init__(self, session: Session, index: int) -> None:
        self._session, self._index = session, index
        self.form = Form(session.scenario, self._paths, self._change)
        remove = Button(label="Remove", width=70, margin=(0, 0, 0, 0))
        remove.html_attributes = {"title": f"Take target {index + 1} out"}
        remove.on_click(self._remove)
        self.root = Column(
            children=[self.form.root, Row(children=[remove], align="end")],
            sizing_mode="stretch_width",
            spacing=2,
            css_classes=["one-of-many"],
        )
        session.on_trouble.append(self.form.tell)

    def _paths(self, scenario: Scenario) -> list[str]:
        targets = () if scenario.scene is None else scenario.scene.targets
        if self._index >= len(targets):
            return []
        own = f"scene.targets.{label_of(targets, self._index)}"
        has_body = targets[self._index].body is not None
        return [f"{own}.{key}" for key in _KEYS.split() if not (has_body and key == "rcs")]

    def _change(self, path: str, text: str) -> None:
        if not path.endswith(".body") or text == NONE:
            changer(self._session)(path, text)
            return
        # A body has cross sections of its own.
        both = (f"{path}={text}", f"{path.removesuffix('.body')}.rcs=0 dBsm")
        self._session.edit(path, partial(changed, options=both, limits=self._session.limits))

    def _remove(self) -> None:
        scene = self._session.scenario.scene
        if scene is not None and self._index < len(scene.targets):
            name = scene.names[self._index]
            self._session.edit(f"remove {name}", partial(without_target, name=name))


def with_target(scenario: Scenario) -> Scenario:
    """One target more, at rest straight ahead, 5 m beyond the farthest."""
    scene = scenario.scene
    if scene is None:
        return scenario
    ranges_m = [float(np.linalg.norm(target.position_m)) for target in scene.targets]
    at_m = round(max(ranges_m, default=15.0) + 5.0, 1)
    numbers = (f"target-{n}" for n in range(1, len(scene.targets) + 2))
    name = next(one for one in numbers if one not in scene.names)
    target = Target(name=name, position_m=(at_m, 0.0, 0.0), rcs_m2=10.0)
    return replace(scenario, scene=replace(scene, targets=(*scene.targets, target)))


def without_target(scenario: Scenario, name: str) -> Scenario:
    """The others keep the names that they had, from their places in the scene or given."""
    scene = scenario.scene
    if scene is None or name not in scene.names:
        return scenario
    named = zip(scene.names, scene.targets, strict=True)
    left = tuple(replace(target, name=own) for own, target in named if own != name)
    kept = tuple(
        one
        for one in scenario.impairments
        if not (isinstance(one, WhiteNoise) and one.target in (name, None))
    )
    lost = len(kept) < len(scenario.impairments)
    made = replace(scenario, scene=replace(scene, targets=left), impairments=kept)
    return with_noise(made, "thermal") if lost else made


def with_noise(scenario: Scenario, noise: str) -> Scenario:
    """Noise that is told in another way, as strong as thermal noise of the receiver."""
    others = tuple(o for o in scenario.impairments if not isinstance(o, ThermalNoise | WhiteNoise))
    own: tuple[Impairment, ...] = ()
    if noise == "thermal":
        own = (ThermalNoise(),)
    elif noise == "white":
        own = (_by_snr(scenario),)
    return replace(scenario, impairments=(*own, *others))


def _by_snr(scenario: Scenario) -> WhiteNoise:
    scene, radar = scenario.scene, scenario.radar
    if scene is None or radar is None or not scene.targets:
        raise InvalidSetting(
            "scene.targets",
            got="empty",
            need="at least one target, whose echo the noise is measured by",
            fix="Add a target, or tell the noise by the noise figure.",
        )
    echo_w = WhiteNoise(snr=1.0, target=scene.names[0]).noise_power_w(scene, radar)
    ratio_db = round(float(decibels(echo_w / noise_power_w(radar))), 1)
    return WhiteNoise(snr=10 ** (ratio_db / 10), target=scene.names[0])


def _noise_of(scenario: Scenario) -> str:
    if any(isinstance(one, WhiteNoise) for one in scenario.impairments):
        return "white"
    return "thermal" if any(isinstance(o, ThermalNoise) for o in scenario.impairments) else "none"


def _of_noise(scenario: Scenario) -> list[str]:
    """Settings that say how strong the noise is, and of time."""
    if scenario.scene is None:
        return ["seed"]
    paths = ["seed", "n_frames"]
    for index, one in enumerate(scenario.impairments):
        if isinstance(one, WhiteNoise):
            own = f"impairments.{label_of(scenario.impairments, index)}"
            paths += [f"{own}.snr", f"{own}.target"]
    return paths if len(paths) > 2 else [*paths, "radar.hardware.noise_factor"]
