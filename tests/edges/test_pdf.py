"""Reports as PDF: escaped names, figures, wide tables, and no files or networks opened."""

import json
import math
import re
import socket
import sys
from importlib.resources import files

import pypdfium2
import pytest

import dechirp as dc
from dechirp.cli.main import main
from dechirp.config.dumping import dump_yaml
from dechirp.experiments.run import run
from dechirp.report import pdf
from dechirp.report.page import render_report
from dechirp.report.pdf import html_to_pdf
from html_tree import parse_html
from nightly import nightly
from page_checks import (
    check_captions,
    check_pdf_contains_page_text,
    extract_pdf_text,
    remove_spaces_and_dashes,
    skip_without_pdf,
)
from trial_cases import make_target, small_radar

MARKUP = (
    '#panic() *b* _i_ `c` $x^2$ @ref <label> \\ \\" " // /* ~ = - + / [a] {b} ](c) #"d" \N{BULLET}'
)


def make_page(body: str, kind: str = "page") -> str:
    style = files("dechirp.report").joinpath("page.css").read_text(encoding="utf-8")
    return (
        f"<!doctype html><title>A title</title><style>{style}</style>"
        f'<main class="{kind}">{body}</main>'
    )


@pytest.fixture(scope="module")
def page() -> str:
    """Report of a run with two receivers and three frames: a car and a walking pedestrian."""
    walker = make_target(
        12.0, 1.5, name=MARKUP, rcs_m2=1.0, body=dc.bodies.Pedestrian(speed_m_per_s=1.5)
    )
    scene = dc.Scene(targets=(make_target(name="car", rcs_m2=10.0), walker))
    result = run(dc.Scenario(name=MARKUP, radar=small_radar(2), scene=scene, n_frames=3))
    return render_report(result, yaml=f"name: {MARKUP}")


@nightly
def test_markup_in_names_is_escaped(page):
    check_captions(page)
    text = extract_pdf_text(check_pdf_contains_page_text(page))
    # Headline's name, a table, the settings.
    assert text.count(remove_spaces_and_dashes(MARKUP)) >= 3


@nightly
def test_pdf_contains_figures_with_text_labels(page):
    skip_without_pdf()
    text = extract_pdf_text(html_to_pdf(page))

    assert page.count("<figure") > 8
    for label in ("Velocity (m/s, receding positive)", "training cells", "Power (dBm)"):
        assert remove_spaces_and_dashes(label) in text


@nightly
@pytest.mark.parametrize("n_columns", [3, 12, 20, 60])
def test_table_fits_page_with_any_number_of_columns(n_columns):
    names = [f"c{number}x" for number in range(n_columns)]
    head = "".join(f'<th class="num">{name}</th>' for name in names)
    row = "".join(f'<td class="num">{number}.123 ± 0.005</td>' for number in range(n_columns))
    html = make_page(
        f"<section><h2>Points</h2><table><thead><tr>{head}</tr></thead>"
        f"<tbody><tr>{row}</tr></tbody></table></section>"
    )

    document = pypdfium2.PdfDocument(check_pdf_contains_page_text(html))
    for sheet in document:
        text_page = sheet.get_textpage()
        width, height = sheet.get_size()
        for index in range(text_page.count_chars()):
            left, bottom, right, top = text_page.get_charbox(index)
            assert left >= 0 and right <= width and bottom >= 0 and top <= height
    assert min(text_sizes_pt(document)) > 5.9


def text_sizes_pt(document: pypdfium2.PdfDocument) -> list[float]:
    """Return the sizes of all characters on their pages."""
    sizes_pt = []
    for sheet in document:
        text_page = sheet.get_textpage()
        for index in range(text_page.count_chars()):
            matrix = pypdfium2.raw.FS_MATRIX()
            pypdfium2.raw.FPDFText_GetMatrix(text_page, index, matrix)
            if text_page.get_text_range(index, 1).strip():
                size = pypdfium2.raw.FPDFText_GetFontSize(text_page, index)
                sizes_pt.append(size * math.hypot(matrix.c, matrix.d))
    return sizes_pt


def test_wide_table_continues_below_with_its_first_column():
    skip_without_pdf()
    head = "".join(f"<th>h{number}x</th>" for number in range(40))
    row = "".join(f"<td>v{number}x</td>" for number in range(40))
    html = make_page(f"<table><thead><tr>{head}</tr></thead><tbody><tr>{row}</tr></tbody></table>")

    document = pypdfium2.PdfDocument(html_to_pdf(html))
    text = " ".join(sheet.get_textpage().get_text_range() for sheet in document)
    assert text.count("h0x") == text.count("v0x") == 3
    assert all(text.count(f"{kind}{number}x") == 1 for number in range(1, 40) for kind in "hv")


@nightly
def test_text_is_set_closer_rather_than_leaving_last_page_nearly_empty(monkeypatch):
    skip_without_pdf()
    page = make_page("<p>One line.</p>" * 38)
    n_pages = []
    for fill in (0.0, pdf._SMALL_FILL):
        monkeypatch.setattr(pdf, "_SMALL_FILL", fill)
        n_pages.append(len(pypdfium2.PdfDocument(html_to_pdf(page))))

    assert n_pages == [2, 1]


@nightly
def test_numbers_of_headline_stay_with_their_units(page):
    headline = next(parse_html(page).descendants("h1")).text
    assert re.search(r"\d\xa0m\b", headline)
    assert not re.search(r"\d m\b", headline)
    # Settings are for copying: plain spaces.
    assert "\xa0" not in next(parse_html(page).descendants("pre")).text


def test_wide_numbers_wrap_before_page_becomes_landscape():
    skip_without_pdf()
    row = '<td class="num">62.31574 ±&nbsp;0.00100</td>' * 10
    table = (
        f"<table><thead><tr>{'<th>r</th>' * 10}</tr></thead><tbody><tr>{row}</tr></tbody></table>"
    )
    document = pypdfium2.PdfDocument(
        html_to_pdf(make_page(f"<p>Before.</p><section>{table}</section>"))
    )

    assert len(document) == 1
    width, height = document[0].get_size()
    assert width < height
    lines = document[0].get_textpage().get_text_range().split("\r\n")
    assert sum("±" in line and "62" not in line for line in lines) >= 1


def test_equal_pages_give_equal_pdfs():
    skip_without_pdf()
    page = make_page("<h1>Title</h1><p>Text</p>")
    assert html_to_pdf(page) == html_to_pdf(page)


@pytest.mark.parametrize("scheme", ["file", "http"])
def test_page_opens_no_files_and_no_network(tmp_path, scheme):
    skip_without_pdf()
    with socket.create_server(("127.0.0.1", 0)) as server:
        (tmp_path / "a.svg").write_text('<svg xmlns="http://www.w3.org/2000/svg"/>')
        host, port = server.getsockname()
        address = {"file": (tmp_path / "a.svg").as_uri(), "http": f"http://{host}:{port}/a.svg"}
        picture = f'<img alt="" src="{address[scheme]}">'
        assert html_to_pdf(make_page(picture)) == html_to_pdf(make_page('<img alt="" src="x:">'))
        server.setblocking(False)
        with pytest.raises(BlockingIOError):
            server.accept()


@pytest.mark.parametrize(
    ("text", "reason", "fix"),
    [
        ("import weasyprint_", "package weasyprint_ is not", "run pip install 'dechirp[pdf]'"),
        (
            "raise OSError('cannot load library libpango-1.0-0')",
            "find the library Pango: cannot load library libpango-1.0-0",
            "brew install pango",
        ),
        ("from re import none", "imported: cannot import name 'none' from 're'", "--force-"),
        ("raise OSError('too many open files')", "imported: too many open files", "--force-"),
        ("raise AttributeError('no attribute a')", "imported: no attribute a", "--force-"),
    ],
)
def test_missing_library_is_reported_before_run(monkeypatch, tmp_path, capsys, text, reason, fix):
    libraries, folder = tmp_path / "libraries", tmp_path / "empty"
    libraries.mkdir()
    folder.mkdir()
    (libraries / "weasyprint.py").write_text(text)
    monkeypatch.syspath_prepend(libraries)
    monkeypatch.chdir(folder)
    monkeypatch.delitem(sys.modules, "weasyprint", raising=False)
    for arguments in (
        ["run"],
        ["verify"],
        ["twin", "a.bin"],
        ["study", "a.yaml"],
        ["tune", "a.yaml"],
    ):
        with pytest.raises(SystemExit) as exit_info:
            main([*arguments, "--pdf"])
        assert exit_info.value.code == 2
        message = capsys.readouterr().err
        assert reason in message and fix in message
        assert "print the .html file to PDF in a browser" in message
    assert list(folder.iterdir()) == []


@nightly
def test_pdf_option_writes_pdf_and_next_run_removes_it(tmp_path, capsys, without_figures):
    skip_without_pdf()
    scenario = tmp_path / "small.yaml"
    scenario.write_text(
        dump_yaml(dc.Scenario(radar=small_radar(), scene=dc.Scene(targets=(make_target(),))))
    )
    out = tmp_path / "out"
    for options, is_expected in ((["--pdf"], True), ([], False)):
        with pytest.raises(SystemExit):
            main(["run", str(scenario), "--out", str(out), "--json", *options])
        assert ("report.pdf" in json.loads(capsys.readouterr().out)["files"]) is is_expected
        assert (out / "report.pdf").exists() is is_expected
