"""Directive `settings`: settings of the guide, checked by the package during the build.

    ```{settings}
    chain:
      angle: {kind: music}
    ```

A wrong name is a warning, which `-W` makes an error. Fragments are completed from the
reference scenario, from `examples/mimo.yaml` if they require an array, or from the file that `over`
names; fragments of a study or a search get a scenario and scores.
"""

import warnings
from collections.abc import Callable
from contextlib import chdir
from dataclasses import replace
from importlib import resources
from pathlib import Path
from typing import Any

from docutils import nodes
from docutils.parsers.rst import directives
from scratch import folder_of
from sphinx.application import Sphinx
from sphinx.directives.code import container_wrapper
from sphinx.util import logging
from sphinx.util.docutils import SphinxDirective

from dechirp.config import loading
from dechirp.config.validation import ValidationContext
from dechirp.config.yaml_tree import YamlNode, parse_yaml
from dechirp.core.errors import DechirpError
from dechirp.experiments.scenario import READERS, Scenario
from dechirp.experiments.study.parsing import load_study
from dechirp.experiments.tune.parsing import load_tune
from dechirp.radar.design.requirements import Requirements
from dechirp.radar.radar import Radar

_REFERENCE = Path(str(resources.files("dechirp.experiments"))) / "reference.yaml"
_LOG = logging.getLogger(__name__)
_EXAMPLES = Path(__file__).parents[2] / "examples"
_REST: dict[str, dict[str, str]] = {
    "study": {"scenario": f"{_REFERENCE}", "scores": "[detection_probability]"},
    "tune": {
        "scenarios": f"[{_REFERENCE}]",
        "search": "{chain.cfar.n_guard.range: [3, 4]}",
        "objective": "{maximise: detection_probability}",
    },
    "requirements": {
        "max_range": "200 m",
        "range_resolution": "1 m",
        "max_velocity": "100 m/s",
    },
}


class Settings(SphinxDirective):
    """A settings file, or a part of one."""

    has_content = True
    option_spec = {  # noqa: RUF012
        "of": lambda text: directives.choice(text, tuple(_LOADED)),
        "over": directives.unchanged_required,
        "name": directives.unchanged_required,
        "whole": directives.flag,
    }
    """`of`: type of the settings, a scenario by default. `over`: scenario that completes it.
    `whole`: the settings are complete. `name`: file that receives the settings, complete, for
    later blocks."""

    def run(self) -> list[nodes.Node]:
        """Load the settings; return them as a block."""
        text = "\n".join(self.content)
        folder = folder_of(self.env.app, self.env.docname)
        name = self.options.get("name", "")
        file = folder / (name or "settings.yaml")
        file.write_text(text + "\n", encoding="utf-8")
        try:
            self._load(file, folder)
        except DechirpError as error:
            _LOG.warning("%s\n%s", error, text, location=self.get_location(), type="guide")
        block = nodes.literal_block(text, text, language="yaml", classes=["settings"])
        if name:
            return [container_wrapper(self, block, f"`{name}`")]
        file.unlink()
        return [block]

    def _load(self, file: Path, folder: Path) -> None:
        """Load the settings, completed from the first base scenario that accepts them."""
        load = _LOADED[self.options.get("of", "scenario")]
        bases: list[Path | None] = [_REFERENCE, _EXAMPLES / "mimo.yaml"]
        if "over" in self.options:
            bases = [folder / self.options["over"]]
        if "whole" in self.options or "name" in self.options:
            bases = [None]
        errors: list[DechirpError] = []
        for base in bases:
            try:
                with chdir(folder), warnings.catch_warnings():
                    warnings.simplefilter("ignore")  # findings, which a run would print
                    return load(file, base)
            except DechirpError as error:
                errors.append(error)
        raise errors[0]


def _scenario(file: Path, base: Path | None) -> None:
    _load(file, base, Scenario)


def _radar(file: Path, base: Path | None) -> None:
    _load(file, base, Radar)


def _load(file: Path, base: Path | None, kind: type) -> None:
    fragment = parse_yaml(file.read_text(encoding="utf-8"), file.name)
    if base is not None:
        base_node = parse_yaml(base.read_text(encoding="utf-8"), base.name)
        if kind is Radar and isinstance(base_node.content, dict):
            base_node = base_node.content.get("radar", base_node)
        fragment = _merge_nodes(_drop_replaced_settings(base_node, fragment), fragment)
    loading.build_value_from_tree(
        fragment, kind, ValidationContext(folder=file.parent, readers=READERS)
    )


def _drop_replaced_settings(base_node: YamlNode, fragment: YamlNode) -> YamlNode:
    """Remove the settings of the base that a scene or recording of the fragment replaces."""
    assert isinstance(base_node.content, dict)
    assert isinstance(fragment.content, dict)
    replaced_names: set[str] = set()
    if "recording" in fragment.content:
        replaced_names = {"scene", "radar", "impairments", "engine", "n_frames"}
    elif "scene" in fragment.content:
        replaced_names = {"scene", "impairments"}  # noise levels may refer to a target by name
    remaining = {
        name: node for name, node in base_node.content.items() if name not in replaced_names
    }
    return replace(base_node, content=remaining)


def _merge_nodes(base_node: YamlNode, overrides: YamlNode) -> YamlNode:
    """Merge two trees of settings; a family member with a `kind` replaces the base value."""
    if not (isinstance(base_node.content, dict) and isinstance(overrides.content, dict)):
        return overrides
    if "kind" in overrides.content:
        return overrides
    merged = {
        name: _merge_nodes(base_node.content[name], node) if name in base_node.content else node
        for name, node in overrides.content.items()
    }
    return replace(overrides, content={**base_node.content, **merged})


def _study(file: Path, base: Path | None) -> None:
    _load_completed(file, base, "study", load_study)


def _tune(file: Path, base: Path | None) -> None:
    _load_completed(file, base, "tune", load_tune)


def _requirements(file: Path, base: Path | None) -> None:
    _load_completed(
        file, base, "requirements", lambda path: loading.read_settings(path, Requirements)
    )


def _load_completed(
    file: Path, base: Path | None, kind: str, load: Callable[[Path], object]
) -> None:
    text = file.read_text(encoding="utf-8")
    if base is None:
        load(file)
        return
    content = parse_yaml(text, file.name).content
    assert isinstance(content, dict)
    rest = dict(_REST[kind])
    if base != _REFERENCE and "scenario" in rest:
        rest["scenario"] = str(base)
    if "recordings" in content:
        rest.pop("scenarios", None)
    if base != _REFERENCE and "scenarios" in rest:
        rest["scenarios"] = f"[{base}]"
    lines = [f"{name}: {value}" for name, value in rest.items() if name not in content]
    filled = file.with_name("filled.yaml")
    filled.write_text("\n".join([text, *lines, ""]), encoding="utf-8")
    load(filled)
    filled.unlink()


_LOADED: dict[str, Callable[[Path, Path | None], None]] = {
    "scenario": _scenario,
    "study": _study,
    "tune": _tune,
    "radar": _radar,
    "requirements": _requirements,
}


def setup(app: Sphinx) -> dict[str, Any]:
    """Give Sphinx the directive."""
    app.setup_extension("scratch")
    app.add_directive("settings", Settings)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
