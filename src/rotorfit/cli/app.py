"""rotorfit app: the page on which logs are dropped, on this computer alone."""

from __future__ import annotations

from threading import Timer
from typing import Annotated

import typer

from rotorfit.cli.terminal import print_result, print_status
from rotorfit.errors import OutputError

MISSING = (
    "the page needs starlette and uvicorn, two small packages: install them with "
    "pip install 'rotorfit[app]'"
)
BROWSER_DELAY = 0.3
"""Time after which the server responds; a browser takes longer to start [s]."""


def page(
    port: Annotated[
        int, typer.Option(min=0, max=65535, metavar="N", help="Listen here; 0: any free port.")
    ] = 0,
    browser: Annotated[
        bool, typer.Option("--browser/--no-browser", help="Open the page in the browser.")
    ] = True,
    limit: Annotated[
        int, typer.Option(min=1, metavar="MB", help="Largest sum of the files on a page [MB].")
    ] = 2000,
) -> None:
    """Open a page on which you drop your logs.

    The page inspects them, asks for the vehicle on a drawing, identifies it, and gives report,
    result and exports. It runs on this computer alone and sends nothing. Ctrl-C ends it.
    """
    try:
        from rotorfit.app.server import ready, serve
    except ModuleNotFoundError as error:
        if error.name not in ("starlette", "uvicorn"):
            raise
        raise OutputError(MISSING) from error
    served = ready(port=port, most_bytes=limit * 1_000_000)
    print_result(served.address)
    print_status("rotorfit: the page is at this address, on this computer only; Ctrl-C ends it")
    if browser:
        opening = Timer(BROWSER_DELAY, _open_browser, (served.address,))
        opening.daemon = True
        opening.start()
    serve(served)
    print_status("rotorfit: ended, and everything of the page is removed")


def _open_browser(address: str) -> None:
    import webbrowser

    if not webbrowser.open(address):
        print_status("rotorfit: no browser was found: open the address yourself")
