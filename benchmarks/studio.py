"""Frame and update rates of the studio in a browser, 128 x 12 x 256 samples per frame.

The page that opens, at 1280 x 720, plays in headless Chromium on this machine, which draws without
a graphics card. Server and browser share its cores; two are enough.

moment     making one moment, over the time between two frames of 20 a second; at most 1.
maps       frames drawn a second, over 20; at least 1.
tables     times a second that tables and spectrogram are sent anew, each over 5; at least 1.
change     from a setting that is changed, at rest, to the frame that shows it, over 0.2 s; at
           most 1. Median of ten.

    python benchmarks/studio.py [SECONDS]
"""

import json
import os
import shutil
import subprocess
import sys
from importlib import resources
from statistics import median
from time import perf_counter, sleep

from playwright.sync_api import Page, sync_playwright

import dechirp as dc
from dechirp.studio.frame_player import FramePlayer

SECONDS = float(sys.argv[1]) if len(sys.argv) > 1 else 10.0
CHROMIUM = os.environ.get("CHROMIUM") or shutil.which("chromium")
READ = ("detections", "tracks", "micro_doppler")
COUNT = """names => {
    window.sent = Object.fromEntries(names.map(name => [name, 0]));
    for (const name of names) {
        const root = Bokeh.documents[0].get_model_by_name(name);
        const sources = [...root.references()].filter(m => m.type === "ColumnDataSource");
        const seen = new Set();
        for (const source of sources) source.change.connect(() => {
            if (seen.size === 0) requestAnimationFrame(() => { seen.clear(); });
            if (seen.size === 0) window.sent[name] += 1;
            seen.add(source.id);
        });
    }
}"""
CHANGE = """async seed => {
    const transport = Bokeh.documents[0].get_model_by_name("transport");
    const field = [...transport.references()].find(m => m.type === "TextInput");
    const before = window.dechirp.frames, began = performance.now();
    field.value = String(seed);
    while (window.dechirp.frames === before)
        await new Promise(done => requestAnimationFrame(done));
    return (performance.now() - began) / 1000;
}"""


def measure_moment_s() -> float:
    """Median time of a moment, without server and browser."""
    with resources.as_file(resources.files("dechirp.studio") / "start.yaml") as file:
        player = FramePlayer(dc.load(file))
    times_s = []
    for step in range(60):
        began = perf_counter()
        player.process_frame_at_step(step, None)
        times_s.append(perf_counter() - began)
    return median(times_s[20:])


def measure_in_browser(page: Page) -> dict[str, float]:
    """Frames and tables a second while it plays, and how soon a change shows."""
    while not page.evaluate("window.dechirp.ready && window.dechirp.frames > 0"):
        sleep(0.05)
    page.evaluate(COUNT, READ)
    page.keyboard.press("Space")
    sleep(3)  # compiled by then, and drawn once
    frames, initial_updates = (
        page.evaluate(expression) for expression in ("window.dechirp.frames", "({...window.sent})")
    )
    began = perf_counter()
    sleep(SECONDS)
    frames = page.evaluate("window.dechirp.frames") - frames
    final_updates, passed_s = page.evaluate("window.sent"), perf_counter() - began
    page.keyboard.press("Space")
    sleep(1)
    changes_s = [page.evaluate(CHANGE, seed) for seed in range(2, 12)]
    return {
        "frames_per_s": frames / passed_s,
        **{
            f"{name}_per_s": (final_updates[name] - initial_updates[name]) / passed_s
            for name in READ
        },
        "change_s": median(changes_s),
    }


def main() -> None:
    measured = {"moment_s": measure_moment_s()}
    command = [sys.executable, "-m", "dechirp", "studio", "--port", "0", "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        try:
            assert server.stdout is not None
            address = json.loads(server.stdout.readline())["address"]
            with sync_playwright() as playwright:
                browser = playwright.chromium.launch(
                    executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu"]
                )
                page = browser.new_page(
                    viewport={"width": 1280, "height": 720},
                    bypass_csp=True,  # which forbids what counts, too
                )
                page.goto(address)
                measured |= measure_in_browser(page)
                browser.close()
        finally:
            server.terminate()
    least = {name: measured[f"{name}_per_s"] / 5 for name in READ}
    least["maps"] = measured["frames_per_s"] / 20
    most = {"moment": measured["moment_s"] * 20, "change": measured["change_s"] / 0.2}
    limits = {"at_least": dict.fromkeys(least, 1.0), "at_most": dict.fromkeys(most, 1.0)}
    print(json.dumps({"measured": measured, "ratios": least | most, **limits}, indent=2))
    failed = min(least.values()) < 1 or max(most.values()) > 1
    raise SystemExit(1 if failed else 0)


if __name__ == "__main__":
    main()
