"""A heading, a table and remarks: what a thing shows of itself in a terminal and in a notebook."""

import re
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from typing import Final

WIDTH: Final = 80
LINES: Final = 24
"""Of one screen."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sheet:
    """What is shown.

    Attributes
    ----------
    heading
        One sentence.
    columns
        Their names; empty names stand for nothing.
    rows
        Cells as text, one for each column.
    hints
        What the first cell of each row means; none, or one for each row.
    remarks
        Sentences below the table.
    more
        How to see the rest.
    """

    heading: str
    columns: tuple[str, ...]
    rows: Sequence[tuple[str, ...]]
    hints: Sequence[str] = ()
    remarks: tuple[str, ...] = ()
    more: str = ""


def sheet_text(sheet: Sheet) -> str:
    """Return a sheet as text of one screen: what does not fit is counted instead."""
    head = textwrap.wrap(sheet.heading, WIDTH)
    tail = [line for words in (*sheet.remarks, sheet.more) for line in textwrap.wrap(words, WIDTH)]
    table = _aligned([sheet.columns, *sheet.rows] if any(sheet.columns) else sheet.rows)
    room = max(LINES - len(head) - len(tail), 4)
    if len(table) > room:
        table = [*table[: room - 1], f"  ... and {len(table) - room + 1} more"]
    return "\n".join([*head, *table, *tail])


def _aligned(rows: Sequence[tuple[str, ...]]) -> list[str]:
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = [
        "  " + "  ".join(f"{cell:<{width}}" for cell, width in zip(row, widths, strict=True))
        for row in rows
    ]
    return [
        textwrap.shorten(line, 4 * WIDTH) if not line.strip() else line[:WIDTH].rstrip()
        for line in lines
    ]


def sheet_html(sheet: Sheet) -> str:
    """Return a sheet as HTML for a notebook: no script, no colours of its own, all escaped."""
    left = ' style="text-align:left"'
    whole = ' style="text-align:left;white-space:nowrap"'
    styles = [*[whole] * (len(sheet.columns) - 1), left]  # the last column may be a sentence
    head = "".join(f"<th{left}>{escape(name)}</th>" for name in sheet.columns)
    hints = [*sheet.hints, *[""] * (len(sheet.rows) - len(sheet.hints))]
    body = "".join(
        f'<tr title="{escape(hint)}">'
        + "".join(f"<td{s}>{_typeset(cell)}</td>" for s, cell in zip(styles, row, strict=True))
        + "</tr>"
        for row, hint in zip(sheet.rows, hints, strict=True)
    )
    below = "".join(f"<li>{escape(words)}</li>" for words in sheet.remarks)
    return (
        f"<p><strong>{_typeset(sheet.heading)}</strong></p>"
        f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
        + (f"<ul>{below}</ul>" if below else "")
        + (f"<p>{escape(sheet.more)}</p>" if sheet.more else "")
    )


def _typeset(words: str) -> str:
    """Return text of a terminal as HTML, with +-, powers of ten and exponents as in print."""
    words = escape(words).replace("+-", "±")
    words = re.sub(r"(?<=[\d)])e([+-]\d+)", lambda m: f" × 10<sup>{int(m[1])}</sup>", words)
    words = re.sub(r"\^(-?\d+)", r"<sup>\1</sup>", words)
    return words.replace("<sup>-", "<sup>−")
