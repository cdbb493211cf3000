"""An export into the user's own file of parameters: only what it names changes, line by line.

Everything else (order, comments, separators, line ends) stays as it is; parameters that the file
does not have are added: at its end, or in a Betaflight dump in the profile that it restores.

Rotors of a Gazebo model are matched by place and sense of rotation, not by name or number. The
model's origin may be another one than the result's; the rotors show by how much.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final
from xml.parsers import expat

import numpy as np

from rotorfit.errors import OutputError
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from jaxtyping import Float

MOTOR: Final = (
    *("timeConstantUp", "timeConstantDown", "maxRotVelocity", "motorConstant", "momentConstant"),
    "rotorVelocitySlowdownSim",
)
"""Elements of a motor's plugin that a result determines."""
INERTIA: Final = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
_MISPLACED: Final = 0.03
"""Share of the arm by which a rotor of the file may lie elsewhere than that of the result."""


@dataclass(slots=True, kw_only=True)
class Element:
    """An element of XML, with the bytes between its tags."""

    name: str
    attributes: dict[str, str]
    start: int
    end: int = 0
    children: list[Element] = field(default_factory=list["Element"])

    def every(self, name: str) -> Iterator[Element]:
        """Yield the elements of a name below this one, at any depth."""
        for child in self.children:
            if child.name == name:
                yield child
            yield from child.every(name)

    def child(self, name: str) -> Element | None:
        """Find a direct child; None if there is none."""
        return next((child for child in self.children if child.name == name), None)


@frozen_dataclass
class Number:
    """A number of the user's file: what it is, its bytes, as they are and as they shall be."""

    what: str
    start: int
    end: int
    old: str
    new: str

    @property
    def differs(self) -> bool:
        """Whether the numbers differ, however they are written."""
        try:
            return [float(x) for x in self.old.split()] != [float(x) for x in self.new.split()]
        except ValueError:
            return True

    def words(self, value: str) -> str:
        """Write what it is with a value."""
        return f"{self.what} {value.strip()}"


@frozen_dataclass
class _Rotor:
    """A motor's plugin, the link that it turns, and where that is [m]."""

    plugin: Element
    link: Element
    place: Float[np.ndarray, " 3"]
    turns: str


@frozen_dataclass
class _Model:
    """The body and the rotors of a model, in its own axes, and the bytes that hold it."""

    data: bytes
    body: Element
    rotors: tuple[_Rotor, ...]

    def text(self, element: Element | None) -> str:
        """Return the bytes between the tags of an element as text; empty for none."""
        return "" if element is None else self.data[element.start : element.end].decode().strip()


def with_numbers(data: bytes, numbers: Sequence[Number]) -> bytes:
    """Replace numbers in a file, from its end to its beginning."""
    for one in sorted(numbers, key=lambda number: -number.start):
        data = data[: one.start] + one.new.encode() + data[one.end :]
    return data


def new_numbers(own: bytes, exported: bytes) -> list[Number]:
    """List all numbers of the user's model that an exported one has, with both values."""
    mine, theirs = _find_model(own), _find_model(exported)
    pairs, shift = _match_rotors(mine, theirs)
    numbers = _body_numbers(mine, theirs, shift)
    for rotor, new in pairs:
        name = rotor.link.attributes.get("name", "")
        for key in MOTOR:
            place, value = rotor.plugin.child(key), theirs.text(new.plugin.child(key))
            numbers.append(_replace_number(f"{name} {key}", mine, place, value))
        numbers += _inertial_numbers(name, mine, rotor.link, theirs, new.link)
    return numbers


def _parse_xml(data: bytes) -> Element:
    """Parse XML into elements with the places of their contents."""
    root = Element(name="", attributes={}, start=0)
    stack = [root]
    parser = expat.ParserCreate()

    def start(name: str, attributes: dict[str, str]) -> None:
        tag = re.compile(rb"<(?:[^>\"']|\"[^\"]*\"|'[^']*')*>").match(data, parser.CurrentByteIndex)
        after = parser.CurrentByteIndex if tag is None else tag.end()
        one = Element(name=name, attributes=attributes, start=after)
        stack[-1].children.append(one)
        stack.append(one)

    def end(name: str) -> None:
        del name
        one = stack.pop()
        # Where a tag ends itself, nothing lies between.
        one.end = max(one.start, parser.CurrentByteIndex)

    parser.StartElementHandler, parser.EndElementHandler = start, end
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        raise OutputError(f"no XML ({error}): expected an SDF model") from error
    return root


def _find_model(data: bytes) -> _Model:
    """Find body and rotors of a model by its motor plugins."""
    root = _parse_xml(data)
    links = {link.attributes.get("name", ""): link for link in root.every("link")}
    model = _Model(data=data, body=root, rotors=())
    rotors: list[_Rotor] = []
    parents: set[str] = set()
    for plugin in root.every("plugin"):
        if plugin.child("motorConstant") is None:
            continue
        name = model.text(plugin.child("linkName"))
        if name not in links:
            raise OutputError(f"a motor's plugin turns link {name!r}, which the model has not")
        place = _element_pose(model, links[name])[:3]
        turns = model.text(plugin.child("turningDirection"))
        rotors.append(_Rotor(plugin=plugin, link=links[name], place=place, turns=turns))
        parents |= {
            model.text(joint.child("parent"))
            for joint in root.every("joint")
            if model.text(joint.child("child")) == name
        }
    bodies = [links[name] for name in parents if name in links]
    if len(bodies) != 1:
        raise OutputError(
            "no body with motors in it (links turned by MulticopterMotorModel, joined to one "
            "link): expected the SDF model itself, not a world or one that includes it"
        )
    return _Model(data=data, body=bodies[0], rotors=tuple(rotors))


def _element_pose(model: _Model, element: Element) -> Float[np.ndarray, " 6"]:
    """Return x, y, z, roll, pitch, yaw of an element; zeros if it has none."""
    pose = element.child("pose")
    if pose is None:
        return np.zeros(6)
    values = [float(word) for word in model.text(pose).split()]
    if len(values) != 6 or pose.attributes.keys() - {"relative_to"}:
        raise OutputError(f"a pose of {model.text(pose)!r}: expected x y z roll pitch yaw")
    frame = pose.attributes.get("relative_to", "")
    if frame not in ("", "__model__", model.body.attributes.get("name", "base_link"), "base_link"):
        raise OutputError(f"a pose relative to {frame!r}: expected relative to model or body")
    return np.array(values)


def _match_rotors(mine: _Model, theirs: _Model) -> tuple[list[tuple[_Rotor, _Rotor]], np.ndarray]:
    """Match rotors by place and turning; return the shift of the origin [m], too."""
    if len(mine.rotors) != len(theirs.rotors):
        raise OutputError(
            f"the model has {len(mine.rotors)} motors, the result {len(theirs.rotors)}"
        )
    own = np.array([rotor.place for rotor in mine.rotors])
    new = np.array([rotor.place for rotor in theirs.rotors])
    shift = own.mean(axis=0) - new.mean(axis=0)
    arm = float(np.linalg.norm(new - new.mean(axis=0), axis=1).max())
    away = np.linalg.norm(own[:, None] - (new + shift)[None], axis=2)
    nearest: list[int] = away.argmin(axis=1).tolist()
    pairs = [(rotor, theirs.rotors[k]) for rotor, k in zip(mine.rotors, nearest, strict=True)]
    for (rotor, other), off in zip(pairs, away.min(axis=1), strict=True):
        name = rotor.link.attributes.get("name", "")
        if off > _MISPLACED * arm:
            raise OutputError(
                f"{name} lies {1e3 * off:.0f} mm from the nearest rotor of the result: the model "
                "is another vehicle, or of other size"
            )
        if rotor.turns != other.turns:
            raise OutputError(f"{name} turns {rotor.turns} in the model, {other.turns} in flight")
    return pairs, shift


def _body_numbers(mine: _Model, theirs: _Model, shift: np.ndarray) -> list[Number]:
    """Return mass, CoM and inertia of the body, in the axes of its link."""
    name = mine.body.attributes.get("name", "")
    link = _element_pose(mine, mine.body)
    inertial, new = mine.body.child("inertial"), theirs.body.child("inertial")
    if inertial is None or new is None or np.abs(link[3:]).max() > 0:
        raise OutputError(f"link {name!r} has no <inertial>, or is turned: expected an upright one")
    com = _element_pose(theirs, new)[:3] + shift - link[:3]
    pose = inertial.child("pose")
    if np.abs(_element_pose(mine, inertial)[3:]).max() > 0:
        raise OutputError(f"the inertia of {name!r} is in turned axes: expected none of a turn")
    words = " ".join(f"{value:.12g}" for value in (*com, 0.0, 0.0, 0.0))
    if pose is None:
        at = inertial.start
        placed = Number(what=f"{name} CoM", start=at, end=at, old="", new=f"<pose>{words}</pose>")
    else:
        placed = _replace_number(f"{name} CoM", mine, pose, words)
    return [placed, *_inertial_numbers(name, mine, mine.body, theirs, theirs.body)]


def _inertial_numbers(
    name: str, mine: _Model, link: Element, theirs: _Model, new: Element
) -> list[Number]:
    """Return mass and inertia of a link."""
    own, other = link.child("inertial"), new.child("inertial")
    if own is None or other is None:
        raise OutputError(f"link {name!r} has no <inertial>: add one")
    inertia, values = own.child("inertia"), other.child("inertia")
    if inertia is None or values is None:
        raise OutputError(f"link {name!r} has no <inertia>: add one")
    found = [
        _replace_number(f"{name} mass", mine, own.child("mass"), theirs.text(other.child("mass")))
    ]
    for key in INERTIA:
        value, place = theirs.text(values.child(key)) or "0", inertia.child(key)
        # SDF takes a product that is not written as 0.
        if place is not None or float(value) != 0.0:
            found.append(_replace_number(f"{name} {key}", mine, place, value))
    return found


def _replace_number(what: str, mine: _Model, place: Element | None, value: str) -> Number:
    if place is None:
        raise OutputError(f"{what} is not in the file: add the element, with any number")
    content = mine.data[place.start : place.end]
    start = place.start + len(content) - len(content.lstrip())
    end = max(start, place.start + len(content.rstrip()))
    return Number(what=what, start=start, end=end, old=mine.text(place), new=value)


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


@frozen_dataclass
class Patched:
    """The user's file with the parameters of an export.

    - `changed`: old and new line of each parameter that differs; added ones have no old one.
    - `same`: how many had their value already.
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
        first, last = _profile_section(lines) if form is BETAFLIGHT else (0, len(lines))
        at = _line_of(lines[first:last], wanted["name"], form)
        if at is None:
            lines.insert(last, new)
            changed.append(("", new))
        elif _has_other_value(lines[first + at], wanted["value"], form):
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


def _has_other_value(line: str, value: str, form: re.Pattern[str]) -> bool:
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


def _profile_section(lines: list[str]) -> tuple[int, int]:
    """Find the lines of the profile that a dump restores at its end; all where it names none."""
    named = [i for i, line in enumerate(lines) if PROFILE.fullmatch(line.strip())]
    if not named:
        ends = [i for i, line in enumerate(lines) if line.strip() == "save"]
        return 0, ends[0] if ends else len(lines)
    chosen = lines[named[-1]].strip()
    first = next(i for i in named if lines[i].strip() == chosen) + 1
    ends = (i for i in range(first, len(lines)) if SECTION.match(lines[i]))
    return first, next(ends, len(lines))
