"""`dechirp studio`: the web page, until it is told to end."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from dechirp.cli.options import Json, Whole, whole_number

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import FrameType

    from dechirp.experiment.scenario import Scenario
    from dechirp.studio.server import Studio


def studio(
    *folders: Path,
    scenario: Path | None = None,
    changes: Annotated[list[str] | None, Parameter(name="--set")] = None,
    host: str = "127.0.0.1",
    port: Whole = "5006",
    as_json: Json = False,
) -> int:
    """Serve a web page on which a radar can be seen at work, until Ctrl-C or SIGTERM.

    Parameters
    ----------
    folders
        Folders with recordings and settings files that the page may open; without any, none.
    scenario
        What pages start with (YAML); a scene with a car and a person without it.
    changes
        PATH=VALUE changes a setting of it, as seed=7; may be repeated.
    host
        Address to listen on. Any but this machine's own makes a token that every request needs.
    port
        Port to listen on; 0 for any that is free.
    """
    from functools import partial

    _must_have_web()
    from dechirp.studio.pages import pages
    from dechirp.studio.server import Studio
    from dechirp.studio.settings import Limits, checked

    number = whole_number("--port", port or "5006", 0, 65535)
    limits = Limits(folders=tuple(_folder(folder) for folder in folders))
    start = checked(_start(scenario, changes or []), limits)
    made = partial(pages, scenario=start, limits=limits)
    started = Studio(made, host=host, port=number)
    _serve(started, partial(_tell, started, as_json=as_json))
    return 0


def _must_have_web() -> None:
    from importlib.util import find_spec

    from dechirp.core.errors import InvalidSetting

    for name in ("bokeh", "tornado"):
        if find_spec(name) is None:
            raise InvalidSetting(
                "dechirp studio",
                got=f"called without {name}",
                need=f"called where {name} is installed",
                fix="Install it: pip install 'dechirp[web]'.",
            )


def _folder(folder: Path) -> Path:
    from dechirp.core.errors import InvalidSetting

    if not folder.is_dir():
        raise InvalidSetting(
            "FOLDERS",
            got=f"{folder}, where there is no folder",
            need="folders with recordings and settings files",
            fix="Name the folder that a recording is in.",
        )
    return folder.resolve()


def _start(path: Path | None, changes: list[str]) -> "Scenario":
    from importlib import resources, util

    from dechirp.experiment.scenario import load

    if path is not None:
        return load(path, changes)
    if util.find_spec("stonesoup") is None:
        changes = ["tracker=null", *changes]
    with resources.as_file(resources.files("dechirp.studio") / "start.yaml") as file:
        return load(file, changes)


def _tell(started: "Studio", *, as_json: bool) -> None:
    import json

    if as_json:
        print(json.dumps({"address": started.address, "token": started.token}), flush=True)
        return
    print(f"The studio is at {started.address}\nCtrl-C ends it.", flush=True)
    if started.token is not None:
        print(
            "Others may reach it: every request needs the token in this address, told only here.\n"
            "It is sent in the clear; through networks of strangers, go by an SSH tunnel.",
            flush=True,
        )


def _serve(started: "Studio", tell: "Callable[[], None]") -> None:
    import asyncio
    import logging
    import signal

    async def until_signal() -> None:
        stopped, loop = asyncio.Event(), asyncio.get_running_loop()

        def stop(_number: int, _frame: "FrameType | None") -> None:
            logging.disable()  # what is under way is let go, and each would be told as a failure
            loop.call_soon_threadsafe(stopped.set)

        # A page that was closed in the middle of a frame is none of the user's concern.
        logging.getLogger("bokeh.server.views.ws").setLevel(logging.ERROR)
        for one in (signal.SIGINT, signal.SIGTERM):
            signal.signal(one, stop)
        tell()  # not before: who reads the address may end it at once
        await started.serve(stopped)

    asyncio.run(until_signal())
