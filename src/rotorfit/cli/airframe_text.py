"""The text of an airframe file: rotors as named, listed or logged, and the columns of a table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rotorfit.logs import ReadOptions
    from rotorfit.logs.proposal import Proposal

NAME_WIDTH = 24
"""Letters of a column's name that are shown."""


def proposal_text(proposal: Proposal) -> str:
    """Write a proposal for people: three values a column, reasons, doubts."""
    from rotorfit.logs.columns import unit_of

    rows: list[tuple[str, ...]] = [("is", "column", "unit", "first row", "middle", "last")]
    for name, spec in proposal.columns.items():
        scale = "" if spec.scale == 1 else f" x {spec.scale:.6g}"
        values = (f"{value:.{13 if name == 'time' else 6}g}" for value in proposal.preview[name])
        rows.append((name, _short_name(spec.name), f"{unit_of(name, spec)}{scale}", *values))
    widths = [max(len(row[i]) for row in rows) for i in range(6)]
    lines = ["proposed columns, with values as recorded:"]
    lines += [
        "  " + "  ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)).rstrip()
        for row in rows
    ]
    lines += [f"  {words}" for words in proposal.reasons]
    lines += [f"  CHECK: {words}" for words in proposal.doubts]
    if proposal.unused:
        shown = ", ".join(_short_name(name) for name in proposal.unused[:8])
        more = len(proposal.unused) - 8
        lines.append(f"  not used: {shown}{f' and {more} more' if more > 0 else ''}")
    return "\n".join(lines)


def _short_name(name: str) -> str:
    """Shorten a column's name for a table; its end, which tells it from others, stays."""
    return name if len(name) <= NAME_WIDTH else f"..{name[2 - NAME_WIDTH :]}"


def table_text(options: ReadOptions) -> str:
    """Write the columns of a table as ``[table]`` of an airframe file."""
    from rotorfit.fit.experiment.toml_files import experiment_text, table_of_options

    poles = "" if options.motor_poles is None else f"poles = {options.motor_poles}\n"
    head = (
        "\n# how tables of this vehicle are read: proposed by names and values, yours to correct\n"
    )
    return f"{poles}{head}" + experiment_text({"table": table_of_options(options)})


def logged_text(rotors: Sequence[Mapping[str, Any]], *, speed: str) -> str:
    """Write the airframe file of rotors whose places a log has."""
    from rotorfit.fit.experiment.toml_files import experiment_text

    lines = [
        "# by CA_ROTOR* of the log, from the centre, forward, left, up [m]: compare it",
        experiment_text({"airframe": {"rotors": [dict(rotor) for rotor in rotors]}}).rstrip(),
        *_remaining_lines(speed),
    ]
    return "\n".join(lines) + "\n"


def listed_text(
    sites: tuple[tuple[float, float, str], ...],
    spacing: tuple[float, float],
    *,
    speed: str,
    source: str,
) -> str:
    """Write the airframe file of rotors in any order; spacing front to back, left to right [m].

    `source`: what shows their order, spins and directions.
    """
    forward, left = ([site[0] for site in sites], [site[1] for site in sites])
    x_scale, y_scale = (
        wide / (max(places) - min(places)) if max(places) > min(places) else 0.0
        for wide, places in zip(spacing, (forward, left), strict=True)
    )
    rows = [
        f'  {{ position = [{x_scale * x + 0.0:.6g}, {y_scale * y + 0.0:.6g}, 0.0], spin = "{s}" }},'
        for x, y, s in sites
    ]
    lines = [
        "[airframe]",
        f"# order, spins and directions by {source}, the size as measured",
        "rotors = [  # position from the centre, forward, left, up [m]",
        *rows,
        "]",
        *_remaining_lines(speed),
    ]
    return "\n".join(lines) + "\n"


def airframe_text(
    layout: str, order: str, spacing: tuple[float, float], *, speed: str, turned: bool
) -> str:
    """Write the airframe file; spacing front to back, left to right [m]; turned: spins reversed."""
    from rotorfit.model.vehicle import spaced_rotors

    lines = ["[airframe]"]
    if turned:
        reversed_spin = {"ccw": "cw", "cw": "ccw"}
        rotors = spaced_rotors(layout, spacing=spacing, order=order)
        lines.append(f"# {layout} in the motor order of {order}, every spin reversed (props out)")
        lines += [
            "rotors = [  # position from the centre, forward, left, up [m]",
            *(
                f'  {{ position = {list(r.position)}, spin = "{reversed_spin[r.spin]}" }},'
                for r in rotors
            ),
            "]",
        ]
    else:
        lines += [
            f'layout = "{layout}"',
            f'order = "{order}"  # whose motor numbering',
            f"spacing = {list(spacing)}  # between motor axes, front to back, left to right [m]",
        ]
    return "\n".join([*lines, *_remaining_lines(speed)]) + "\n"


def _remaining_lines(speed: str) -> list[str]:
    return [
        "# imu = { position = [0.0, 0.0, 0.0] }  # of the flight controller, forward, left, up [m]",
        "",
        "[motors]",
        f'speed = "{speed}"',
    ]
