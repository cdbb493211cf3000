"""Pages and drawings: templates filled with what is escaped, elements of SVG, and PNG from it.

PNG comes from resvg (`pip install "rotorfit[figures]"`): one wheel of 3 MB without further
dependencies. Matplotlib would draw everything a second time, and cairosvg needs the system's cairo.
"""

from __future__ import annotations

import base64
import hashlib
import math
import re
from collections.abc import Mapping
from functools import cache
from html import escape
from pathlib import Path
from typing import Any, Final

from rotorfit.digits import short
from rotorfit.errors import OutputError
from rotorfit.logs.files import write_whole

FOLDER: Final = Path(__file__).parent / "templates"
HINT: Final = 'for PNG as well as SVG files: pip install "rotorfit[figures]"'


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
    return clean(_load_template(name).render(content))


@cache
def _load_template(name: str) -> Any:
    # Inside the function: the command line must not wait for it when it only prints help.
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader(FOLDER),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["plus_minus"] = plus_minus
    environment.filters["short"] = short
    return environment.get_template(f"{name}.html")


def plus_minus(sentence: str) -> str:
    """Write ``+-`` of a sentence as the sign that a page has room for."""
    return sentence.replace("+-", "± ")


def write_drawings(folder: Path, drawings: Mapping[str, str], *, force: bool = False) -> list[Path]:
    """Write SVG documents by name into a folder, all or none, with PNG where `can_write_png`."""
    contents: dict[str, str | bytes] = {f"{name}.svg": svg for name, svg in drawings.items()}
    if can_write_png():
        contents |= {f"{name}.png": _render_png(svg) for name, svg in drawings.items()}
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


def _render_png(svg: str) -> bytes:
    """Render a drawing at twice its size in pixels, for print and slides."""
    from importlib import import_module

    render = import_module("resvg_py").svg_to_bytes
    return bytes(render(svg_string=svg, zoom=2, background="#ffffff"))


NAMESPACE = "http://www.w3.org/2000/svg"
Attributes = Mapping[str, str | float | int]

_FORBIDDEN = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def clean(words: str) -> str:
    """Replace what neither XML nor UTF-8 can hold (control and half characters)."""
    return _FORBIDDEN.sub("\ufffd", words)


def tag(name: str, attributes: Attributes, *children: str) -> str:
    """Write one element; children are elements already, or escaped text."""
    inside = "".join(
        f' {key}="{escape(clean(value)) if isinstance(value, str) else decimal(value)}"'
        for key, value in attributes.items()
    )
    return f"<{name}{inside}>{''.join(children)}</{name}>" if children else f"<{name}{inside}/>"


def text(words: str) -> str:
    """Escape the text of an element."""
    return escape(clean(words))


def label(words: str, attributes: Attributes) -> str:
    """Write a text element."""
    return tag("text", attributes, text(words))


def drawing(width: float, height: float, attributes: Attributes, *children: str) -> str:
    """Write an SVG to stand inside a page; it scales with the width it is given."""
    box = f"0 0 {decimal(width)} {decimal(height)}"
    return tag("svg", {"viewBox": box, **attributes}, *children)


def standalone(inline: str, style: str) -> str:
    """Write an SVG of a page as a file of its own, with its style and a white ground."""
    head, rest = inline.split(">", maxsplit=1)
    box = re.search(r'viewBox="0 0 ([\d.]+) ([\d.]+)"', head)
    size = (
        ""
        if box is None
        else f' width="{box[1]}" height="{box[2]}" style="max-width:100%;height:auto"'
    )
    ground = '<rect width="100%" height="100%" fill="#fff"/>'
    return (
        f'<?xml version="1.0" encoding="UTF-8"?>\n{head} xmlns="{NAMESPACE}"{size}>'
        f"<style>{escape(style, quote=False)}</style>{ground}{rest}\n"
    )


def decimal(value: float | int) -> str:
    """Write a coordinate with at most two decimals."""
    digits = f"{value:.2f}".rstrip("0").rstrip(".")
    return "0" if digits == "-0" else digits


def nice_step(span: float, count: int) -> float:
    """Choose 1, 2, 4 or 5 times a power of ten that divides a span into about `count` steps."""
    if not (math.isfinite(span) and span > 0):
        return 1.0
    raw = span / count
    power = 10.0 ** math.floor(math.log10(raw))
    return power * next(f for f in (1.0, 2.0, 4.0, 5.0, 10.0) if raw <= f * power * (1 + 1e-9))


def ticks(low: float, high: float, count: int) -> list[float]:
    """Choose round numbers between two ends, about `count` of them and at least two."""
    step = nice_step(high - low, count)
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    if last <= first and count < 20 and high > low:
        return ticks(low, high, 2 * count)
    return [i * step for i in range(first, last + 1)]


def labelled_ticks(low: float, high: float, count: int) -> list[tuple[float, str]]:
    """Choose round numbers between two ends, with the decimals that their distance needs."""
    values = ticks(low, high, count)
    step = values[1] - values[0] if len(values) > 1 else 1.0
    return [(value, tick_label(value, step)) for value in values]


def tick_label(value: float, step: float) -> str:
    """Write a tick's number with the decimals that its step needs."""
    decimals = max(0, -math.floor(math.log10(step) + 1e-9))
    digits = f"{value:.{decimals}f}"
    return digits.replace("-", "\u2212") if float(digits) else f"{0:.{decimals}f}"
