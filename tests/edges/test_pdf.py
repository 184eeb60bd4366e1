"""Pages as PDF: names are never markup, wide tables fit, and what cannot be set is refused."""

import json

import pytest

import dechirp as dc
from dechirp.cli.main import main
from dechirp.config.dumping import dump
from dechirp.experiments.run import run
from dechirp.report import pdf
from dechirp.report.page import render_report
from dechirp.report.pdf import html_to_pdf
from dechirp.report.typst_inline import UnknownElementError
from printed import check_captions, check_pdf, squeezed, text_of
from trial_cases import small, target

MARKUP = (
    '#panic() *b* _i_ `c` $x^2$ @ref <label> \\ \\" " // /* ~ = - + / [a] {b} ](c) #"d" \N{BULLET}'
)


def page_of(body: str, kind: str = "page") -> str:
    return f'<title>A title</title><main class="{kind}">{body}</main>'


@pytest.fixture(scope="module")
def page() -> str:
    """A run of three frames in which all that moves and swings is seen, of two receivers."""
    walker = target(
        12.0, 1.5, name=MARKUP, rcs_m2=1.0, body=dc.bodies.Pedestrian(speed_m_per_s=1.5)
    )
    scene = dc.Scene(targets=(target(name="car", rcs_m2=10.0), walker))
    result = run(dc.Scenario(name=MARKUP, radar=small(2), scene=scene, n_frames=3))
    return render_report(result, yaml=f"name: {MARKUP}")


def test_a_name_may_hold_any_markup(page):
    check_captions(page)
    said = text_of(check_pdf(page))
    assert said.count(squeezed(MARKUP)) >= 3  # headline's name, a table, the settings


def test_every_figure_is_in_the_pdf_with_its_letters(page):
    said = text_of(html_to_pdf(page))

    assert page.count("<figure") > 8
    for label in ("Velocity (m/s)", "training cells", "Power (dBm)"):
        assert squeezed(label) in said


@pytest.mark.parametrize("n_columns", [3, 12, 20, 60])
def test_a_table_fits_however_many_columns_it_has(n_columns):
    names = [f"c{number}x" for number in range(n_columns)]
    head = "".join(f'<th class="num">{name}</th>' for name in names)
    row = "".join(f'<td class="num">{number}.123 ± 0.005</td>' for number in range(n_columns))
    html = page_of(
        f"<section><h2>Points</h2><table><thead><tr>{head}</tr></thead>"
        f"<tbody><tr>{row}</tr></tbody></table></section>"
    )

    import pypdfium2

    made = pypdfium2.PdfDocument(check_pdf(html))
    for one in made:
        words = one.get_textpage()
        width, height = one.get_size()
        for at in range(words.count_chars()):
            left, bottom, right, top = words.get_charbox(at)
            assert left >= 0 and right <= width and bottom >= 0 and top <= height


def test_numbers_go_over_two_lines_before_their_page_is_turned():
    import pypdfium2

    row = '<td class="num">62.31574 ±&nbsp;0.00100</td>' * 10
    table = (
        f"<table><thead><tr>{'<th>r</th>' * 10}</tr></thead><tbody><tr>{row}</tr></tbody></table>"
    )
    made = pypdfium2.PdfDocument(html_to_pdf(page_of(f"<p>Before.</p><section>{table}</section>")))

    assert len(made) == 1
    width, height = made[0].get_size()
    assert width < height
    lines = made[0].get_textpage().get_text_range().split("\r\n")
    assert sum("±" in line and "62" not in line for line in lines) >= 1


@pytest.mark.parametrize("body", ["<video></video>", "<p>a <kbd>key</kbd></p>", "<p><b>open</p>"])
def test_a_page_of_what_no_template_uses_is_refused(body):
    with pytest.raises((UnknownElementError, ValueError)):
        html_to_pdf(page_of(body))


def test_without_the_extra_the_command_says_so_before_it_runs(monkeypatch, tmp_path, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(pdf, "find_spec", lambda name: None)
    for words in (["run"], ["verify"], ["twin", "a.bin"], ["study", "a.yaml"], ["tune", "a.yaml"]):
        with pytest.raises(SystemExit) as ended:
            main([*words, "--pdf"])
        assert ended.value.code == 2
        assert "pip install 'dechirp[pdf]'" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_the_command_writes_the_pdf_beside_the_page_and_takes_it_away(tmp_path, capsys):
    scenario = tmp_path / "small.yaml"
    scenario.write_text(dump(dc.Scenario(radar=small(), scene=dc.Scene(targets=(target(),)))))
    out = tmp_path / "out"
    for words, there in ((["--pdf"], True), ([], False)):
        with pytest.raises(SystemExit):
            main(["run", str(scenario), "--out", str(out), "--json", *words])
        assert ("report.pdf" in json.loads(capsys.readouterr().out)["files"]) is there
        assert (out / "report.pdf").exists() is there
