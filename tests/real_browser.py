"""A real browser for tests: playwright (extra `browser`) with the Chromium of the system."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
ARGUMENTS = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]


@contextmanager
def opened_browser(profile: Path, *, width: int, height: int) -> Iterator[Any]:
    """Open a browser; skip, saying so, where there is none."""
    api = pytest.importorskip(
        "playwright.sync_api", reason='needs a browser driver: pip install "rotorfit[browser]"'
    )
    if CHROMIUM is None:
        pytest.skip("no chromium on the path: install the system's package")
    with api.sync_playwright() as playwright:
        context = playwright.chromium.launch_persistent_context(
            profile,
            executable_path=CHROMIUM,
            args=ARGUMENTS,
            viewport={"width": width, "height": height},
        )
        yield context
        context.close()
