"""Frame and update rates of the studio in a browser, 128 x 12 x 256 samples per frame.

The start page of the studio plays at 1280 x 720 in headless Chromium, which draws without a
graphics card. Server and browser share the cores of this machine; two are enough. The ratios are:

moment     Time to process one frame, over the frame period of 50 ms; at most 1.
maps       Drawn frames per second, over 20; at least 1.
tables     Updates per second of tables and spectrogram, each over 5; at least 1.
lessons    Drawn frames per second of each lesson, each over 15; at least 1.
change     Time from the change of a setting, while paused, to the first frame that shows it, over
           0.2 s; at most 1. Median of ten.

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
LESSONS = range(1, 5)
UPDATED_MODELS = ("detections", "tracks", "micro_doppler")
COUNT = """names => {
    window.sent = Object.fromEntries(names.map(name => [name, 0]));
    for (const name of names) {
        const root = Bokeh.documents[0].get_model_by_name(name);
        const sources = [...root.references()].filter(
            m => m.type === "ColumnDataSource" || m.name === `${name}-rows`);
        const changed = new Set();
        for (const source of sources) source.change.connect(() => {
            if (changed.size === 0) requestAnimationFrame(() => { changed.clear(); });
            if (changed.size === 0) window.sent[name] += 1;
            changed.add(source.id);
        });
    }
}"""
CHANGE = """async seed => {
    const transport = Bokeh.documents[0].get_model_by_name("transport");
    const field = [...transport.references()].find(m => m.type === "TextInput");
    const initial = window.dechirp.frames, start = performance.now();
    field.value = String(seed);
    while (window.dechirp.frames === initial)
        await new Promise(resolve => requestAnimationFrame(resolve));
    return (performance.now() - start) / 1000;
}"""


def measure_moment_s() -> float:
    """Measure the median time to process a frame, without server and browser."""
    with resources.as_file(resources.files("dechirp.studio") / "start.yaml") as file:
        player = FramePlayer(dc.load(file))
    times_s = []
    for step in range(60):
        start = perf_counter()
        player.process_frame_at_step(step, None)
        times_s.append(perf_counter() - start)
    return median(times_s[20:])


def wait_for_first_frame(page: Page) -> None:
    """Wait until a frame is drawn; an error in a script of the page would last for ever."""
    page.wait_for_function("window.dechirp?.ready && window.dechirp.frames > 0", timeout=60_000)


def measure_in_browser(page: Page) -> dict[str, float]:
    """Measure the frame and update rates during playback, and the response time to a change."""
    wait_for_first_frame(page)
    page.evaluate(COUNT, UPDATED_MODELS)
    page.keyboard.press("Space")
    sleep(3)  # compiles, and draws the first frames
    frames, initial_updates = (
        page.evaluate(expression) for expression in ("window.dechirp.frames", "({...window.sent})")
    )
    start = perf_counter()
    sleep(SECONDS)
    frames = page.evaluate("window.dechirp.frames") - frames
    final_updates, elapsed_s = page.evaluate("window.sent"), perf_counter() - start
    page.keyboard.press("Space")
    sleep(1)
    changes_s = [page.evaluate(CHANGE, seed) for seed in range(2, 12)]
    return {
        "frames_per_s": frames / elapsed_s,
        **{
            f"{name}_per_s": (final_updates[name] - initial_updates[name]) / elapsed_s
            for name in UPDATED_MODELS
        },
        "change_s": median(changes_s),
    }


def measure_lesson_frame_rate(page: Page) -> float:
    """Measure the drawn frames per second of a lesson during playback."""
    wait_for_first_frame(page)
    page.keyboard.press("Space")
    sleep(2)
    frames, start = page.evaluate("window.dechirp.frames"), perf_counter()
    sleep(SECONDS / 2)
    n_frames: int = page.evaluate("window.dechirp.frames") - frames
    return n_frames / (perf_counter() - start)


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
                    reduced_motion="reduce",  # else it begins to play
                    bypass_csp=True,  # the policy also blocks the scripts below
                )
                page.goto(address)
                measured |= measure_in_browser(page)
                for number in LESSONS:
                    page.goto(f"{address}teach/{number}")
                    measured[f"lesson_{number}_per_s"] = measure_lesson_frame_rate(page)
                browser.close()
        finally:
            server.terminate()
    rate_ratios = {name: measured[f"{name}_per_s"] / 5 for name in UPDATED_MODELS}
    for number in LESSONS:
        rate_ratios[f"lesson_{number}"] = measured[f"lesson_{number}_per_s"] / 15
    rate_ratios["maps"] = measured["frames_per_s"] / 20
    time_ratios = {"moment": measured["moment_s"] * 20, "change": measured["change_s"] / 0.2}
    limits = {
        "at_least": dict.fromkeys(rate_ratios, 1.0),
        "at_most": dict.fromkeys(time_ratios, 1.0),
    }
    print(
        json.dumps({"measured": measured, "ratios": rate_ratios | time_ratios, **limits}, indent=2)
    )
    failed = min(rate_ratios.values()) < 1 or max(time_ratios.values()) > 1
    raise SystemExit(1 if failed else 0)


if __name__ == "__main__":
    main()
