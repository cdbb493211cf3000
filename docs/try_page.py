"""Open the built page in a browser and identify its example:  python docs/try_page.py SITE

SITE is a folder with the built site (its page is SITE/app), or the address that `rotorfit app`
prints. Ends with an error where the page complains, asks another computer for anything, or gives
no identified kt. Needs  pip install 'rotorfit[browser]'  and Chromium.
"""

import functools
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from urllib.parse import urlsplit

from playwright.sync_api import sync_playwright

PATIENCE = 600_000
"""Python in the browser on a slow computer [ms]."""
ROWS = """() => Object.fromEntries([...document.querySelectorAll('tr[data-value]')].map(
  (row) => [row.dataset.name, row.textContent]))"""


@contextmanager
def served(folder: Path) -> Iterator[str]:
    """Serve a folder on this computer alone, and yield its address."""
    handler = functools.partial(SimpleHTTPRequestHandler, directory=str(folder))
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}/"
        server.shutdown()


def identified_example(address: str) -> dict[str, str]:
    """Take the example on the page at an address, identify it, and return the rows by name."""
    complaints: list[str] = []
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=shutil.which("chromium") or shutil.which("chromium-browser"),
            args=["--no-sandbox", "--disable-gpu"],
        )
        page = browser.new_page()
        page.set_default_timeout(PATIENCE)
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on("request", lambda asked: complaints.extend(elsewhere(asked.url)))
        answered = page.goto(address)
        if answered is None or not answered.ok:
            sys.exit(f"{address}: no page there")
        page.wait_for_selector("html[data-ready]")
        page.click("[data-do=example]")
        page.click("#identify:not([aria-disabled=true])")
        page.wait_for_selector("tr[data-value]")
        rows = page.evaluate(ROWS)
        browser.close()
    if complaints:
        sys.exit("the page complains: " + "; ".join(complaints))
    return rows


def elsewhere(address: str) -> list[str]:
    """Return an address that is not this computer's, as a complaint."""
    parts = urlsplit(address)
    here = parts.scheme in ("blob", "data") or parts.hostname in ("127.0.0.1", "localhost")
    return [] if here else [f"asks for {address}"]


def main(place: str) -> None:
    """Try a folder or an address."""
    if place.startswith("http"):
        rows = identified_example(place)
    else:
        with served(Path(place)) as address:
            rows = identified_example(f"{address}app/index.html")
    kt = rows.get("kt", "no kt")
    sys.stdout.write(f"{len(rows)} numbers; {kt}\n")
    if "identified" not in kt or "not-identified" in kt:
        sys.exit("kt of the example is not identified")


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(sys.argv[1])
