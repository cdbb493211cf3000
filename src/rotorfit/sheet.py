"""Tables of results, logs and plans: in a terminal, in a notebook, as a pandas frame."""

from __future__ import annotations

import re
import textwrap
from html import escape
from importlib import import_module
from typing import TYPE_CHECKING, Any, Final

from rotorfit.errors import OutputError
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

WIDTH: Final = 80
LINES: Final = 24
"""Lines of one screen."""
DataFrame = Any
"""A data frame of pandas, which need not be installed."""


_ARGUMENT: Final = r"(?:'[^']*'|[^\s()';,-][^\s()';,]*)"
_FILE: Final = r"(?:'[^']*'|[^\s()';,]*[./][^\s()';,]*)"
_OPTION: Final = rf"-{{1,2}}[a-z][a-z-]*(?: {_ARGUMENT})?"
COMMAND: Final = re.compile(
    rf"rotorfit [a-z]+ (?:{_OPTION}|{_ARGUMENT})(?: (?:{_OPTION}|{_FILE}))*"
)
"""A command in a sentence, with its arguments; a comma, a bracket or the sentence's end ends it."""
_UNBROKEN: Final = "\N{NO-BREAK SPACE}"
"""Stands for the blanks of a command while its sentence is wrapped."""


def wrapped(text: str, width: int, first: str = "", later: str | None = None) -> list[str]:
    """Wrap a paragraph behind a beginning; the later lines are indented as far, or by `later`.

    A command stays on one line, however long, so that it can be copied.
    """
    lines = textwrap.wrap(
        COMMAND.sub(lambda found: found[0].replace(" ", _UNBROKEN), text),
        width,
        initial_indent=first,
        subsequent_indent=" " * len(first) if later is None else later,
        break_long_words=False,
        break_on_hyphens=False,
    )
    return [line.replace(_UNBROKEN, " ") for line in lines]


@frozen_dataclass
class Sheet:
    """A heading, a table and remarks.

    - `hints`: explanations of the first cell of each row; none, or one for each row.
    - `more`: how to see the rest.
    """

    heading: str
    columns: tuple[str, ...]
    rows: Sequence[tuple[str, ...]]
    hints: Sequence[str] = ()
    remarks: tuple[str, ...] = ()
    more: str = ""


def sheet_text(sheet: Sheet) -> str:
    """Format a sheet as text of one screen; rows that do not fit are counted."""
    head = textwrap.wrap(sheet.heading, WIDTH)
    tail = [line for text in (*sheet.remarks, sheet.more) for line in textwrap.wrap(text, WIDTH)]
    table = _align_rows([sheet.columns, *sheet.rows] if any(sheet.columns) else sheet.rows)
    room = max(LINES - len(head) - len(tail), 4)
    if len(table) > room:
        table = [*table[: room - 1], f"  ... and {len(table) - room + 1} more"]
    return "\n".join([*head, *table, *tail])


def _align_rows(rows: Sequence[tuple[str, ...]]) -> list[str]:
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
    """Format a sheet as HTML for a notebook: no script, no colours, all escaped."""
    left = ' style="text-align:left"'
    whole = ' style="text-align:left;white-space:nowrap"'
    styles = [*[whole] * (len(sheet.columns) - 1), left]  # the last column may be a sentence
    head = "".join(f"<th{left}>{escape(name)}</th>" for name in sheet.columns)
    hints = [*sheet.hints, *[""] * (len(sheet.rows) - len(sheet.hints))]
    body = "".join(
        f'<tr title="{escape(hint)}">'
        + "".join(f"<td{s}>{_typeset_html(cell)}</td>" for s, cell in zip(styles, row, strict=True))
        + "</tr>"
        for row, hint in zip(sheet.rows, hints, strict=True)
    )
    below = "".join(f"<li>{escape(text)}</li>" for text in sheet.remarks)
    return (
        f"<p><strong>{_typeset_html(sheet.heading)}</strong></p>"
        f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
        + (f"<ul>{below}</ul>" if below else "")
        + (f"<p>{escape(sheet.more)}</p>" if sheet.more else "")
    )


def _typeset_html(text: str) -> str:
    """Convert text of a terminal to HTML, with +-, powers of ten and exponents as in print."""
    html = escape(text).replace("+-", "±")
    html = re.sub(r"(?<=[\d)])e([+-]\d+)", lambda m: f" × 10<sup>{int(m[1])}</sup>", html)
    html = re.sub(r"\^(-?\d+)", r"<sup>\1</sup>", html)
    return html.replace("<sup>-", "<sup>−")


def frame(columns: Mapping[str, Sequence[Any]]) -> DataFrame:
    """Convert columns of one length to a pandas DataFrame."""
    return pandas().DataFrame(dict(columns))


def pandas() -> Any:
    """Import pandas; raise OutputError if it is not installed."""
    try:
        return import_module("pandas")
    except ImportError as error:
        raise OutputError(
            f"a frame needs pandas ({error}): pip install pandas, then call this again"
        ) from error


INDENT: Final = 8
"""Indent of text that a narrow terminal pushes to the next line."""


def table_lines(rows: Sequence[Sequence[str]], width: int) -> list[str]:
    """Join the cells of rows, which are padded to columns; columns that do not fit follow below."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    groups: list[list[int]] = [[]]
    used = -1
    for i, wide in enumerate(widths):
        if groups[-1] and used + 1 + wide > width:
            groups.append([])
            used = INDENT - 1
        groups[-1].append(i)
        used += 1 + wide
    joined = (
        " " * INDENT * bool(n) + " ".join(row[i] for i in group)
        for row in rows
        for n, group in enumerate(groups)
    )
    return [line.rstrip() for line in joined if line.strip()]


def listed(names: Sequence[str]) -> str:
    """Write names as a list in words."""
    return " and ".join(filter(None, (", ".join(names[:-1]), names[-1])))
