"""An export into the user's own file of parameters: only what it names changes, line by line.

Everything else (order, comments, separators, line ends) stays as it is; parameters that the file
does not have are added: at its end, or in a Betaflight dump in the profile that it restores.
"""

import re
from dataclasses import dataclass
from typing import Final

from rotorfit.errors import OutputError
from rotorfit.export.sdf_numbers import new_numbers, with_numbers

ARDUPILOT: Final = re.compile(r"(?P<head>\s*(?P<name>[A-Z]\w*)(?:\s*,\s*|\s+))(?P<value>[^\s,#]+)")
"""NAME,VALUE of a ground station; NAME VALUE of MAVProxy."""
PX4: Final = re.compile(r"(?P<head>\d+\t\d+\t(?P<name>\w+)\t)(?P<value>\S+)")
BETAFLIGHT: Final = re.compile(r"(?P<head>set (?P<name>\w+) = )(?P<value>.*\S)")
FORMS: Final[dict[str, re.Pattern[str]]] = {
    "ardupilot": ARDUPILOT,
    "px4": PX4,
    "px4-gazebo": PX4,
    "px4-sih": PX4,
    "betaflight": BETAFLIGHT,
    "indiflight": BETAFLIGHT,
}
"""Of the targets that are lists of parameters: one line of them."""
PROFILE: Final = re.compile(r"profile \d+")
SECTION: Final = re.compile(r"(rate)?profile \d+|# (restore|rateprofile)\b|save\b|batch end")
"""Where a profile of a dump ends."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Patched:
    """The user's file with the parameters of an export.

    Attributes
    ----------
    text
        The whole file.
    changed
        Old and new line of each parameter that differs; the old one is empty where it is added.
    same
        How many had their value already.
    """

    text: str
    changed: tuple[tuple[str, str], ...]
    same: int


def patched(own: str, exported: str, target: str) -> Patched:
    """Put the parameters of an exported file into the user's own; OutputError if it is no such."""
    if target == "gazebo":
        return patched_sdf(own, exported)
    if target not in FORMS:
        raise OutputError(
            f"--into is for lists of parameters ({', '.join(FORMS)}) and models of gazebo, and "
            f"{target} is neither: export into a file of its own"
        )
    form, end = FORMS[target], "\r\n" if "\r\n" in own else "\n"
    lines = own.splitlines()
    if not any(form.match(line) for line in lines):
        raise OutputError(f"the file to export into has no parameter as {target} writes them")
    changed: list[tuple[str, str]] = []
    same = 0
    for new in exported.splitlines():
        wanted = form.match(new)
        if wanted is None:
            continue
        first, last = _section(lines) if form is BETAFLIGHT else (0, len(lines))
        at = _line_of(lines[first:last], wanted["name"], form)
        if at is None:
            lines.insert(last, new)
            changed.append(("", new))
        elif _differs(lines[first + at], wanted["value"], form):
            old = lines[first + at]
            lines[first + at] = _with_value(old, wanted["value"], form)
            changed.append((old, lines[first + at]))
        else:
            same += 1
    return Patched(text=end.join([*lines, ""]), changed=tuple(changed), same=same)


def patched_sdf(own: str, exported: str) -> Patched:
    """Put the numbers of an exported Gazebo model into the user's own, and change nothing else."""
    numbers = new_numbers(own.encode(), exported.encode())
    differing = [one for one in numbers if one.differs]
    return Patched(
        text=with_numbers(own.encode(), differing).decode(),
        changed=tuple((one.words(one.old), one.words(one.new)) for one in differing),
        same=len(numbers) - len(differing),
    )


def _line_of(lines: list[str], name: str, form: re.Pattern[str]) -> int | None:
    """Find the last line that sets a parameter: it is the one that counts."""
    found = [i for i, x in enumerate(lines) if (line := form.match(x)) and line["name"] == name]
    return found[-1] if found else None


def _differs(line: str, value: str, form: re.Pattern[str]) -> bool:
    """Test whether a line has another value, compared as numbers where both are."""
    found = form.match(line)
    old = "" if found is None else found["value"]
    try:
        return float(old) != float(value)
    except ValueError:
        return old != value


def _with_value(line: str, value: str, form: re.Pattern[str]) -> str:
    found = form.match(line)
    assert found is not None
    return line[: found.start("value")] + value + line[found.end("value") :]


def _section(lines: list[str]) -> tuple[int, int]:
    """Find the lines of the profile that a dump restores at its end; all where it names none."""
    named = [i for i, line in enumerate(lines) if PROFILE.fullmatch(line.strip())]
    if not named:
        ends = [i for i, line in enumerate(lines) if line.strip() == "save"]
        return 0, ends[0] if ends else len(lines)
    chosen = lines[named[-1]].strip()
    first = next(i for i in named if lines[i].strip() == chosen) + 1
    ends = (i for i in range(first, len(lines)) if SECTION.match(lines[i]))
    return first, next(ends, len(lines))
