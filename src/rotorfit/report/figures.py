"""The drawings of a report as files: SVG always, PNG where a small renderer is installed.

PNG comes from resvg (`pip install "rotorfit[figures]"`): one wheel of 3 MB without further
dependencies. Matplotlib would draw everything a second time, and cairosvg needs the system's cairo.
"""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from rotorfit.errors import OutputError
from rotorfit.logs.files import file_name, write_whole
from rotorfit.report.chart import chart_svg
from rotorfit.report.correlations import correlation_section
from rotorfit.report.excitation import excitation_chart
from rotorfit.report.motor_law import law_picture
from rotorfit.report.page_templates import template_text
from rotorfit.report.series import series_of
from rotorfit.report.svg import standalone
from rotorfit.report.vehicle import vehicle_drawings
from rotorfit.report.wrenches import wrench_svg
from rotorfit.results.result import IdentificationResult
from rotorfit.validation.wrench_comparison import WrenchComparison
from rotorfit.validation.wrench_spectra import wrench_spectra

ALWAYS = ("vehicle-top.svg", "vehicle-side.svg", "correlations.svg")
"""Files that nearly every report writes: where one is there, so is an earlier report."""
HINT = 'for PNG beside the SVG files: pip install "rotorfit[figures]"'


def write_figures(
    folder: Path,
    result: IdentificationResult,
    comparisons: Sequence[WrenchComparison] = (),
    *,
    force: bool = False,
) -> list[Path]:
    """Write every drawing of a report as a file of its own.

    Parameters
    ----------
    folder
        Made where it is missing.
    result, comparisons
        As for `rotorfit.report.html.report_html`.
    force
        Replace files that are there.

    Returns
    -------
    list of Path
        What was written: SVG, and PNG where `can_write_png`.

    Raises
    ------
    OutputError
        If one of the files exists and `force` is false (then none is written), or the folder
        cannot be used.
    """
    return write_drawings(folder, figure_texts(result, comparisons), force=force)


def write_drawings(folder: Path, drawings: Mapping[str, str], *, force: bool = False) -> list[Path]:
    """Write SVG documents by name into a folder, all or none, with PNG where `can_write_png`."""
    contents: dict[str, str | bytes] = {f"{name}.svg": svg for name, svg in drawings.items()}
    if can_write_png():
        contents |= {f"{name}.png": _png(svg) for name, svg in drawings.items()}
    _make(folder)
    there = [name for name in contents if (folder / name).exists()]
    if there and not force:
        raise OutputError(
            f"{folder} already holds {', '.join(there)}; name another folder, or force"
        )
    for name, content in contents.items():
        write_whole(folder / name, content, force=force)
    return [folder / name for name in contents]


def figure_texts(
    result: IdentificationResult, comparisons: Sequence[WrenchComparison] = ()
) -> dict[str, str]:
    """Return every drawing as an SVG document, by a name that any file system takes.

    Parameters
    ----------
    result
        What was identified.
    comparisons
        Body wrench against rotor wrench on flights, each of which is drawn over time.
    """
    style = template_text("figure.css")
    out: dict[str, str] = {}
    vehicle = vehicle_drawings(result)
    if vehicle is not None:
        out = {name: standalone(svg, style) for name, _, svg in vehicle.views}
    for number, comparison in enumerate(comparisons, 1):
        name = f"wrench-{number}-{_plain(comparison.configuration)}-{_plain(comparison.flight)}"
        out[name] = standalone(wrench_svg(comparison, series_of(comparison)), style)
    spectra = wrench_spectra(comparisons)
    if spectra is not None:
        out["excitation"] = standalone(chart_svg(excitation_chart(spectra)), style)
    if result.command_law is not None:
        out["motor-law"] = standalone(law_picture(result.command_law), style)
    heat_map = correlation_section(result).heat_map
    if heat_map is not None:
        out["correlations"] = standalone(heat_map, style)
    return out


def can_write_png() -> bool:
    """Whether the optional renderer is installed; `HINT` says how to get it."""
    from importlib.util import find_spec

    return find_spec("resvg_py") is not None


def _png(svg: str) -> bytes:
    """Return a drawing at twice its size in pixels, for print and slides."""
    from importlib import import_module

    render = import_module("resvg_py").svg_to_bytes
    return bytes(render(svg_string=svg, zoom=2, background="#ffffff"))


def _plain(name: str) -> str:
    """Return a name with nothing in it that a file system may not like."""
    return re.sub(r"[^A-Za-z0-9_-]+", "-", Path(file_name(name)).stem).strip("-")[:40] or "flight"


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{folder} cannot be made a folder ({error}); name another") from error
