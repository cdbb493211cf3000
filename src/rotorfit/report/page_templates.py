"""The pages' templates: read from their folder, filled with what is escaped."""

import base64
import hashlib
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from jinja2 import Template

FOLDER: Final = Path(__file__).parent / "templates"


def template_text(name: str) -> str:
    """Return a file of the templates as it is."""
    return (FOLDER / name).read_text(encoding="utf-8")


def page_style(*names: str) -> str:
    """Return the style sheet of a page: what all share, its own, and how it is in the dark."""
    return "".join(template_text(f"{name}.css") for name in ("page", "figure", *names, "dark"))


def fingerprint(script: str) -> str:
    """Return what a page's content policy knows its one script by; no other one may run."""
    return base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()


@cache
def page_template(name: str) -> "Template":
    """Return a template by its file's name, ready to be rendered."""
    # Inside the function: the command line must not wait for it when it only prints help.
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader(FOLDER),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(name)
