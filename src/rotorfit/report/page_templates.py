"""The pages' templates: read from their folder, filled with what is escaped."""

from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from jinja2 import Template

FOLDER: Final = Path(__file__).parent / "templates"


def template_text(name: str) -> str:
    """Return a file of the templates as it is."""
    return (FOLDER / name).read_text(encoding="utf-8")


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
