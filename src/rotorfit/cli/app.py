"""rotorfit app: the page on which logs are dropped, on this computer alone."""

import webbrowser
from threading import Timer

from rotorfit.cli.terminal import say, show
from rotorfit.errors import OutputError

MISSING = (
    "the page needs starlette and uvicorn, two small packages: install them with "
    "pip install 'rotorfit[app]'"
)
SOON = 0.3
"""After which the server answers; a browser takes longer to start [s]."""


def run(*, port: int, browser: bool, limit: int) -> None:
    """Serve the page until Ctrl-C."""
    try:
        from rotorfit.app.server import ready, serve
    except ModuleNotFoundError as error:
        if error.name not in ("starlette", "uvicorn"):
            raise
        raise OutputError(MISSING) from error
    served = ready(port=port, most_bytes=limit * 1_000_000)
    show(served.address)
    say("rotorfit: the page is at this address, on this computer only; Ctrl-C ends it")
    if browser:
        opening = Timer(SOON, _open, (served.address,))
        opening.daemon = True
        opening.start()
    serve(served)
    say("rotorfit: ended, and everything of the page is removed")


def _open(address: str) -> None:
    if not webbrowser.open(address):
        say("rotorfit: no browser was found: open the address yourself")
