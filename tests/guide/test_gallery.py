"""Gallery scripts: length, title, public names, axis labels and seeds."""

import ast
from pathlib import Path

import pytest

import dechirp

GALLERY = Path(__file__).parents[2] / "docs" / "gallery"
SCRIPTS = sorted(GALLERY.glob("*/plot_*.py"))
MAX_LINES = 60

# Calls that are random unless they are given a seed.
RANDOM_CALLS = {
    "simulate",
    "default_rng",
    "draw_statistical_detections",
    "signal_to_quantisation_noise_over_bits",
    "Study",
    "Scenario",
}


def test_gallery_has_twenty_scripts_in_titled_sections() -> None:
    assert len(SCRIPTS) >= 20
    for folder in {script.parent for script in SCRIPTS} | {GALLERY}:
        assert (folder / "GALLERY_HEADER.rst").is_file(), folder


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)
def test_script_is_short_and_has_title_and_explanation(script: Path) -> None:
    text = script.read_text(encoding="utf-8")
    assert len(text.splitlines()) <= MAX_LINES

    docstring = ast.get_docstring(ast.parse(text))
    assert docstring is not None
    title, underline, *rest = docstring.splitlines()
    assert len(underline) >= len(title)
    assert set(underline) == {"="}
    explanation = " ".join(" ".join(rest).split())
    assert "The figure shows " in explanation or "The figure compares " in explanation


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)
def test_script_uses_only_public_attributes(script: Path) -> None:
    for node in ast.walk(ast.parse(script.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Attribute):
            assert not node.attr.startswith("_")
            if isinstance(node.value, ast.Name) and node.value.id == "dc":
                assert node.attr in dechirp.__all__


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)
def test_script_labels_both_axes_or_uses_package_figure(
    script: Path,
) -> None:
    tree = ast.parse(script.read_text(encoding="utf-8"))
    calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call)]
    arguments = {keyword.arg for call in calls for keyword in call.keywords}
    arguments |= {_get_function_name(call).removeprefix("set_") for call in calls}
    uses_package_figure = ".dechirp.plot(" in script.read_text(encoding="utf-8")
    assert uses_package_figure or {"xlabel", "ylabel"} <= arguments


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)
def test_random_calls_have_seed(script: Path) -> None:
    for call in ast.walk(ast.parse(script.read_text(encoding="utf-8"))):
        if not isinstance(call, ast.Call) or _get_function_name(call) not in RANDOM_CALLS:
            continue
        arguments = {keyword.arg: keyword.value for keyword in call.keywords}
        is_noiseless = (
            isinstance(arguments.get("impairments"), ast.Tuple)
            and not arguments["impairments"].elts
        )
        is_study_scenario = _get_function_name(call) == "Scenario" and "n_frames" not in arguments
        assert "seed" in arguments or is_noiseless or is_study_scenario, ast.unparse(call)


def _get_function_name(call: ast.Call) -> str:
    return call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")
