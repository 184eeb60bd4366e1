"""`dechirp studio`: server of the interactive web page."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from dechirp.cli.options import IntegerText, Json, parse_integer_option

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import FrameType

    from dechirp.experiments.scenario import Scenario
    from dechirp.studio.server import StudioServer


def studio(
    *folders: Path,
    scenario: Path | None = None,
    changes: Annotated[list[str] | None, Parameter(name="--set")] = None,
    host: str = "127.0.0.1",
    port: IntegerText = "5006",
    as_json: Json = False,
) -> int:
    """Serve an interactive web page of a radar at work, until Ctrl-C or SIGTERM.

    Parameters
    ----------
    folders
        Folders with recordings and settings files that the page may open; none by default.
    scenario
        Initial scenario of each page (YAML), or a traffic file, with --set traffic.ego=ID; a scene
        with a car and a person by default.
    changes
        PATH=VALUE changes a setting of the scenario, such as seed=7; may be repeated.
    host
        Address to listen on. Any address but this machine's own requires a token in every request.
    port
        Port to listen on; 0 selects a free port.
    """
    from functools import partial

    _check_web_extra_installed()
    from dechirp.studio.page import page_builders_by_address
    from dechirp.studio.scenario_edits import PageLimits, check_scenario_within_limits
    from dechirp.studio.server import StudioServer

    number = parse_integer_option("--port", port or "5006", 0, 65535)
    limits = PageLimits(folders=tuple(_resolve_folder(folder) for folder in folders))
    first_scenario = check_scenario_within_limits(
        _initial_scenario(scenario, changes or []), limits
    )
    if first_scenario.traffic is not None and first_scenario.radar is not None:
        first_scenario.traffic.open_scenes(first_scenario.radar)  # refuses a wrong file or ego
    make_pages = partial(page_builders_by_address, scenario=first_scenario, limits=limits)
    server = StudioServer(make_pages, host=host, port=number)
    _serve_until_signal(server, partial(_print_server_address, server, as_json=as_json))
    return 0


def _check_web_extra_installed() -> None:
    from importlib.util import find_spec

    from dechirp.core.errors import InvalidSetting

    for name in ("bokeh", "tornado"):
        if find_spec(name) is None:
            raise InvalidSetting(
                "dechirp studio",
                value=f"{name} is not installed",
                expected=f"an environment with {name}",
                fix="run pip install 'dechirp[web]'",
            )


def _resolve_folder(folder: Path) -> Path:
    from dechirp.core.errors import InvalidSetting

    if not folder.is_dir():
        raise InvalidSetting(
            "FOLDERS",
            value=f"{folder}, which is not a folder",
            expected="folders with recordings and settings files",
            fix="name the folder that contains a recording",
        )
    return folder.resolve()


def _initial_scenario(path: Path | None, changes: list[str]) -> "Scenario":
    from importlib import resources, util

    from dechirp.experiments.scenario import load, traffic_scenario
    from dechirp.traffic.traffic import recognise_traffic

    if path is not None:
        is_traffic = recognise_traffic(path) is not None
        return traffic_scenario(path, changes) if is_traffic else load(path, changes)
    if util.find_spec("stonesoup") is None:
        changes = ["tracker=null", *changes]
    with resources.as_file(resources.files("dechirp.studio") / "start.yaml") as file:
        return load(file, changes)


def _print_server_address(server: "StudioServer", *, as_json: bool) -> None:
    import json

    if as_json:
        print(json.dumps({"address": server.address, "token": server.token}), flush=True)
        return
    print(f"The studio is at {server.address}\nCtrl-C ends it.", flush=True)
    if server.token is not None:
        print(
            "Other machines can reach it: every request needs the token in this address, which is"
            " printed only here.\nThe connection is not encrypted; use an SSH tunnel across"
            " untrusted networks.",
            flush=True,
        )


def _serve_until_signal(server: "StudioServer", on_start: "Callable[[], None]") -> None:
    import asyncio
    import logging
    import signal

    from dechirp.studio.compilation import compilation_counter

    async def until_signal() -> None:
        stopped, loop = asyncio.Event(), asyncio.get_running_loop()

        def stop(_number: int, _frame: "FrameType | None") -> None:
            logging.disable()  # cancelled requests would be logged as failures
            loop.call_soon_threadsafe(stopped.set)

        # A page that is closed in the middle of a frame is not an error.
        logging.getLogger("bokeh.server.views.ws").setLevel(logging.ERROR)
        for signal_number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(signal_number, stop)
        on_start()  # not before: who reads the address may end it at once
        await server.serve(stopped)

    asyncio.run(until_signal())
    compilation_counter().stop()
