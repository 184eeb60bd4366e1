"""Scripts of the gallery: short, of public names alone, and the same each time they run."""

import ast
from pathlib import Path

import pytest

import dechirp

GALLERY = Path(__file__).parents[2] / "docs" / "gallery"
SCRIPTS = sorted(GALLERY.glob("*/plot_*.py"))
API = Path(__file__).parents[1] / "api.txt"
MOST_LINES = 60

# Those of these draw unless told otherwise from what seed.
DRAWS = {
    "simulate",
    "default_rng",
    "sense",
    "signal_to_quantisation_noise_over_bits",
    "Study",
    "Scenario",
}


def test_there_are_at_least_twenty_in_sections_that_say_what_they_show() -> None:
    assert len(SCRIPTS) >= 20
    for folder in {script.parent for script in SCRIPTS} | {GALLERY}:
        assert (folder / "GALLERY_HEADER.rst").is_file(), folder


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)
def test_a_script_is_short_and_begins_with_what_to_see(script: Path) -> None:
    text = script.read_text(encoding="utf-8")
    assert len(text.splitlines()) <= MOST_LINES

    words = ast.get_docstring(ast.parse(text))
    assert words is not None
    title, line, *rest = words.splitlines()
    assert len(line) >= len(title)
    assert set(line) == {"="}
    assert "See " in " ".join(rest)


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)
def test_a_script_uses_names_that_are_promised_to_users(script: Path) -> None:
    tree = ast.parse(script.read_text(encoding="utf-8"))

    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("dechirp"):
            promised = f"# from {node.module} import" in API.read_text(encoding="utf-8")
            assert promised or node.module == "dechirp.report.figures"
        if isinstance(node, ast.Import):
            for name in node.names:
                assert name.name == "dechirp" or not name.name.startswith("dechirp")
        if isinstance(node, ast.Attribute):
            assert not node.attr.startswith("_")
            if isinstance(node.value, ast.Name) and node.value.id == "dc":
                assert node.attr in {*dechirp.__all__, *dechirp._NAMESPACES}


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)
def test_a_script_says_what_is_on_both_axes_or_leaves_it_to_a_figure_of_the_package(
    script: Path,
) -> None:
    tree = ast.parse(script.read_text(encoding="utf-8"))
    calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call)]
    given = {word.arg for call in calls for word in call.keywords}
    given |= {_called(call).removeprefix("set_") for call in calls}
    figures = {
        name.name
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom)
        for name in node.names
    }

    drawn = any(
        isinstance(call.func, ast.Attribute)
        and isinstance(call.func.value, ast.Name)
        and call.func.value.id in figures
        for call in calls
    )
    assert drawn or {"xlabel", "ylabel"} <= given


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)
def test_whatever_draws_is_seeded(script: Path) -> None:
    for call in ast.walk(ast.parse(script.read_text(encoding="utf-8"))):
        if not isinstance(call, ast.Call) or _called(call) not in DRAWS:
            continue
        given = {word.arg: word.value for word in call.keywords}
        without_noise = (
            isinstance(given.get("impairments"), ast.Tuple) and not given["impairments"].elts
        )
        of_a_study = _called(call) == "Scenario" and "n_frames" not in given
        assert "seed" in given or without_noise or of_a_study, ast.unparse(call)


def _called(call: ast.Call) -> str:
    return call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")
