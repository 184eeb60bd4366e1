"""Panel of the scene: targets, noise and time."""

from dataclasses import replace
from functools import partial

import numpy as np
from bokeh.models import Button, Column, Row, Select, UIElement

from dechirp.core.errors import InvalidSetting
from dechirp.core.units import to_decibels
from dechirp.experiments.scenario import Scenario
from dechirp.radar.budget import noise_power_w
from dechirp.scene.target import Target
from dechirp.simulation.impairments.base import Impairment
from dechirp.simulation.impairments.noise import ThermalNoise, WhiteNoise
from dechirp.studio.panels.base import Panel
from dechirp.studio.panels.fold import Fold
from dechirp.studio.panels.knob_widgets import KnobForm, make_setting_changer
from dechirp.studio.panels.knobs import NONE, list_member_name_in_path
from dechirp.studio.scenario_edits import apply_overrides, check_scenario_within_limits
from dechirp.studio.session import Edit, Session
from dechirp.studio.theme import Theme

_TARGET_SETTINGS = "name position velocity rcs fluctuation body"
_NOISES = {
    "thermal": "by the noise figure",
    "white": "by the SNR",
    "none": "none",
}


class Targets(Panel):
    """Knobs of the targets, the noise and the frames."""

    name = "targets"

    def __init__(self, session: Session) -> None:
        super().__init__(session)
        self._rows: list[_TargetRow] = []
        self._add = Button(label="Add a target", sizing_mode="stretch_width", margin=(6, 0, 6, 0))
        self._add.on_click(
            lambda: self._queue_edit_within_limits("add a target", add_target_beyond_farthest)
        )
        self._noise = Select(
            title="Noise",
            options=list(_NOISES.items()),
            sizing_mode="stretch_width",
            css_classes=["field"],
            margin=(2, 0, 2, 0),
        )
        self._noise.on_change("value", lambda attr, old, new: self._apply_noise_choice(str(new)))
        self._form = KnobForm(
            session.scenario, _noise_and_frame_setting_paths, make_setting_changer(session)
        )
        self._root = Column(name=self.name, sizing_mode="stretch_width", spacing=0)
        session.on_settings.append(self._show_targets_and_noise)
        session.on_mistakes.append(self._form.show_mistakes)
        self._show_targets_and_noise(session.scenario)

    @property
    def root_element(self) -> UIElement:
        return self._root

    def apply_theme(self, theme: Theme) -> None:
        """Do nothing: the widgets inherit the colours of the page."""

    def _show_targets_and_noise(self, scenario: Scenario) -> None:
        scene = scenario.scene
        for part in (self._add, self._noise):
            part.visible = scene is not None
        self._form.show_settings_of(scenario)
        self._noise.value = _noise_kind_of_scenario(scenario)
        targets = () if scene is None else scene.targets
        while len(self._rows) < len(targets):
            self._rows.append(_TargetRow(self.session, len(self._rows)))
        for row in self._rows[: len(targets)]:
            row.show_settings_of(scenario)
        roots = [row.root_element for row in self._rows[: len(targets)]]
        # No column of the rows alone: Bokeh warns of one that is empty, as in traffic.
        children = [self._noise, self._form.root_element, *roots, self._add]
        if self._root.children != children:
            self._root.children = children

    def _apply_noise_choice(self, noise: str) -> None:
        if noise != _noise_kind_of_scenario(self.session.scenario):
            self._queue_edit_within_limits("noise", partial(replace_noise_model, noise_kind=noise))

    def _queue_edit_within_limits(self, key: str, edit: Edit) -> None:
        self.session.queue_edit(
            key, lambda scenario: check_scenario_within_limits(edit(scenario), self.session.limits)
        )


class _TargetRow:
    """Knobs of one target, and a button that removes it."""

    def __init__(self, session: Session, index: int) -> None:
        self._session, self._index = session, index
        self.form = KnobForm(
            session.scenario, self._target_setting_paths, self._change_target_setting
        )
        remove = Button(label="Remove", width=70, margin=(0, 0, 0, 0))
        remove.html_attributes = {"title": f"Remove target {index + 1}"}
        remove.on_click(self._remove_own_target)
        self._fold = Fold(f"Target {index + 1}")
        self._fold.set_children([self.form.root_element, Row(children=[remove], align="end")])
        self.root_element = self._fold.root_element
        session.on_mistakes.append(self.form.show_mistakes)

    def show_settings_of(self, scenario: Scenario) -> None:
        """Show the current settings of the target."""
        assert scenario.scene is not None
        target = scenario.scene.targets[self._index]
        body = "" if target.body is None else f", {target.body.kind()}"
        self._fold.set_title(f"{scenario.scene.names[self._index]}{body}")
        self.form.show_settings_of(scenario)

    def _target_setting_paths(self, scenario: Scenario) -> list[str]:
        targets = () if scenario.scene is None else scenario.scene.targets
        if self._index >= len(targets):
            return []
        target_path = f"scene.targets.{list_member_name_in_path(targets, self._index)}"
        has_body = targets[self._index].body is not None
        return [
            f"{target_path}.{key}"
            for key in _TARGET_SETTINGS.split()
            if not (has_body and key == "rcs")
        ]

    def _change_target_setting(self, path: str, text: str) -> None:
        if not path.endswith(".body") or text == NONE:
            make_setting_changer(self._session)(path, text)
            return
        # A body defines its own cross sections.
        options = (f"{path}={text}", f"{path.removesuffix('.body')}.rcs=0 dBsm")
        self._session.queue_edit(
            path, partial(apply_overrides, overrides=options, limits=self._session.limits)
        )

    def _remove_own_target(self) -> None:
        scene = self._session.scenario.scene
        if scene is not None and self._index < len(scene.targets):
            name = scene.names[self._index]
            self._session.queue_edit(f"remove {name}", partial(remove_target, name=name))


def add_target_beyond_farthest(scenario: Scenario) -> Scenario:
    """Add a target at rest straight ahead, 5 m beyond the farthest."""
    scene = scenario.scene
    if scene is None:
        return scenario
    ranges_m = [float(np.linalg.norm(target.position_m)) for target in scene.targets]
    range_m = round(max(ranges_m, default=15.0) + 5.0, 1)
    numbers = (f"target-{n}" for n in range(1, len(scene.targets) + 2))
    name = next(name_candidate for name_candidate in numbers if name_candidate not in scene.names)
    target = Target(name=name, position_m=(range_m, 0.0, 0.0), rcs_m2=10.0)
    return replace(scenario, scene=replace(scene, targets=(*scene.targets, target)))


def remove_target(scenario: Scenario, name: str) -> Scenario:
    """Remove a target; the others keep their names."""
    scene = scenario.scene
    if scene is None or name not in scene.names:
        return scenario
    named = zip(scene.names, scene.targets, strict=True)
    remaining = tuple(
        replace(target, name=own_name) for own_name, target in named if own_name != name
    )
    impairments = tuple(
        impairment
        for impairment in scenario.impairments
        if not (isinstance(impairment, WhiteNoise) and impairment.target in (name, None))
    )
    has_lost_noise = len(impairments) < len(scenario.impairments)
    edited = replace(scenario, scene=replace(scene, targets=remaining), impairments=impairments)
    return replace_noise_model(edited, "thermal") if has_lost_noise else edited


def replace_noise_model(scenario: Scenario, noise_kind: str) -> Scenario:
    """Return the scenario with another noise model of the same power as thermal noise."""
    others = tuple(o for o in scenario.impairments if not isinstance(o, ThermalNoise | WhiteNoise))
    noise_impairments: tuple[Impairment, ...] = ()
    if noise_kind == "thermal":
        noise_impairments = (ThermalNoise(),)
    elif noise_kind == "white":
        noise_impairments = (_white_noise_equal_to_thermal(scenario),)
    return replace(scenario, impairments=(*noise_impairments, *others))


def _white_noise_equal_to_thermal(scenario: Scenario) -> WhiteNoise:
    scene, radar = scenario.scene, scenario.radar
    if scene is None or radar is None or not scene.targets:
        raise InvalidSetting(
            "scene.targets",
            value="empty",
            expected="at least one target, to which the SNR refers",
            fix="add a target, or set the noise by the noise figure",
        )
    echo_w = WhiteNoise(snr=1.0, target=scene.names[0]).noise_power_w(scene, radar)
    ratio_db = round(float(to_decibels(echo_w / noise_power_w(radar))), 1)
    return WhiteNoise(snr=10 ** (ratio_db / 10), target=scene.names[0])


def _noise_kind_of_scenario(scenario: Scenario) -> str:
    if any(isinstance(impairment, WhiteNoise) for impairment in scenario.impairments):
        return "white"
    return "thermal" if any(isinstance(o, ThermalNoise) for o in scenario.impairments) else "none"


def _noise_and_frame_setting_paths(scenario: Scenario) -> list[str]:
    """Return the paths of the settings of noise and frames."""
    if scenario.scene is None:
        return ["seed"]
    paths = ["seed", "n_frames"]
    for index, impairment in enumerate(scenario.impairments):
        if isinstance(impairment, WhiteNoise):
            path = f"impairments.{list_member_name_in_path(scenario.impairments, index)}"
            paths += [f"{path}.snr", f"{path}.target"]
    return paths if len(paths) > 2 else [*paths, "radar.hardware.noise_factor"]
