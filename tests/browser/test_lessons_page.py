"""Page of the lessons that run in a browser, opened in Chromium.

A stand-in for Pyodide asks the Python of this test for the figures. With DECHIRP_PYODIDE, a folder
with a Pyodide distribution and the wheel of dechirp, the browser computes them itself.
"""

import os
import sys
import threading
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import parse_qsl, urlparse

import pytest

from nightly import nightly

FOLDER = Path(__file__).parents[2] / "examples" / "browser"
DISTRIBUTION = os.environ.get("DECHIRP_PYODIDE", "")
TIMEOUT_MS = 300_000 if DISTRIBUTION else 60_000

STAND_IN = """
function ask(path) {
  const request = new XMLHttpRequest();
  request.open("GET", path, false);
  request.send();
  if (request.status !== 200) throw new Error(request.responseText);
  return request.responseText;
}
export async function loadPyodide() {
  return {
    loadPackage: async () => {},
    unpackArchive: () => {},
    FS: { writeFile: () => {} },
    pyimport: () => ({
      describe_lessons: () => ask("/describe"),
      draw_lesson: (number, positions) =>
        ask(`/draw?${new URLSearchParams({ number, positions })}`),
    }),
  };
}
"""


class LessonHandler(SimpleHTTPRequestHandler):
    """Serves the page; of Pyodide and the wheel, the distribution or the stand-in."""

    def do_GET(self) -> None:
        import lessons  # with the fixture `address`

        url = urlparse(self.path)
        try:
            if url.path == "/describe":
                self._send(lessons.describe_lessons())
            elif url.path == "/draw":
                query = dict(parse_qsl(url.query))
                self._send(lessons.draw_lesson(int(query["number"]), query["positions"]))
            elif not DISTRIBUTION and url.path == "/pyodide/pyodide.mjs":
                self._send(STAND_IN, "text/javascript")
            elif not DISTRIBUTION and url.path.endswith(".whl"):
                self._send("")
            else:
                super().do_GET()
        except Exception as error:  # for the page to show
            self._send(str(error), status=500)

    def translate_path(self, path: str) -> str:
        name = urlparse(path).path.lstrip("/")
        is_in_distribution = name.startswith("pyodide/") or name.endswith(".whl")
        folder = Path(DISTRIBUTION) if is_in_distribution else FOLDER
        return str(folder / name.removeprefix("pyodide/"))

    def log_message(self, format: str, *args: object) -> None:
        pass

    def _send(self, text: str, kind: str = "text/plain", *, status: int = 200) -> None:
        content = text.encode()
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        self.wfile.write(content)


@pytest.fixture(scope="module")
def address():
    """Serve the page, and the folder of the distribution."""
    sys.path.insert(0, str(FOLDER))
    with ThreadingHTTPServer(("127.0.0.1", 0), LessonHandler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}/lessons.html"
        server.shutdown()
    sys.path.remove(str(FOLDER))


@pytest.fixture
def page(browser, address):
    with browser.new_context() as context:
        page = context.new_page()
        page.set_default_timeout(TIMEOUT_MS)
        page.goto(address)
        page.wait_for_selector("section:nth-of-type(4) figure svg")
        yield page


@nightly
def test_lessons_draw_and_redraw_at_moved_controls(page):
    assert page.locator("section").count() == 4
    assert page.inner_text("#status") == ""
    before = page.inner_html("section:nth-of-type(1) figure")

    slider = page.get_by_label("Range (m)")
    slider.focus()
    slider.press("ArrowRight")

    page.wait_for_function(
        "before => document.querySelector('section figure').innerHTML !== before", arg=before
    )
    assert page.locator("section:nth-of-type(1) output").first.inner_text() == "51"
    page.get_by_label("Window").select_option("hann")
    assert page.inner_text("#status") == ""


@nightly
@pytest.mark.skipif(bool(DISTRIBUTION), reason="the real Pyodide has no failing packages")
def test_page_shows_why_python_did_not_start(browser, address):
    with browser.new_context() as context:
        page = context.new_page()
        page.route("**/lessons.py", lambda route: route.fulfill(status=404))
        page.goto(address)
        page.wait_for_function("document.querySelector('#status').textContent.includes('404')")
        assert page.inner_text("#status").startswith("Python did not start: lessons.py: 404")
