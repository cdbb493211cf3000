"""Pages and drawings as files: templates filled with what is escaped, SVG, and PNG from it.

PNG comes from resvg (`pip install "rotorfit[figures]"`): one wheel of 3 MB without further
dependencies. Matplotlib would draw everything a second time, and cairosvg needs the system's cairo.
"""

import base64
import hashlib
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any, Final

from rotorfit.errors import OutputError
from rotorfit.logs.files import write_whole
from rotorfit.report.svg import clean

FOLDER: Final = Path(__file__).parent / "templates"
HINT: Final = 'for PNG beside the SVG files: pip install "rotorfit[figures]"'


def template_text(name: str) -> str:
    """Read a file of the templates."""
    return (FOLDER / name).read_text(encoding="utf-8")


def render_page(name: str, /, *styles: str, script: str | None = None, **content: Any) -> str:
    """Fill the template ``NAME.html`` with style sheets, its one script, and escaped content."""
    content["style"] = "".join(template_text(f"{sheet}.css") for sheet in styles)
    if script is not None:
        content["script"] = template_text(script)
        # The page's content policy runs no script but that of this hash.
        digest = hashlib.sha256(content["script"].encode()).digest()
        content["script_hash"] = base64.b64encode(digest).decode()
    return clean(_template(name).render(content))


@cache
def _template(name: str) -> Any:
    # Inside the function: the command line must not wait for it when it only prints help.
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader(FOLDER),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(f"{name}.html")


def write_drawings(folder: Path, drawings: Mapping[str, str], *, force: bool = False) -> list[Path]:
    """Write SVG documents by name into a folder, all or none, with PNG where `can_write_png`."""
    contents: dict[str, str | bytes] = {f"{name}.svg": svg for name, svg in drawings.items()}
    if can_write_png():
        contents |= {f"{name}.png": _png(svg) for name, svg in drawings.items()}
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{folder} cannot be made a folder ({error}); name another") from error
    there = [name for name in contents if (folder / name).exists()]
    if there and not force:
        raise OutputError(
            f"{folder} already holds {', '.join(there)}; name another folder, or force"
        )
    for name, content in contents.items():
        write_whole(folder / name, content, force=force)
    return [folder / name for name in contents]


def can_write_png() -> bool:
    """Test whether the optional renderer is installed; `HINT` says how to get it."""
    from importlib.util import find_spec

    return find_spec("resvg_py") is not None


def _png(svg: str) -> bytes:
    """Render a drawing at twice its size in pixels, for print and slides."""
    from importlib import import_module

    render = import_module("resvg_py").svg_to_bytes
    return bytes(render(svg_string=svg, zoom=2, background="#ffffff"))
