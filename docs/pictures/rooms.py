"""Draw the rooms of the source and who calls whom, from the imports:  python docs/pictures/rooms.py

The rooms, in their layers as pyproject.toml has them, are boxes with what their `__init__` says of
them; an arrow leads from a room to one that it imports. Arrows that follow from others are left
out (the transitive reduction). A test holds the file against the imports.
"""

import ast
import tomllib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from textwrap import wrap
from typing import Final

from rotorfit.report.pages import NAMESPACE, drawing, label, tag

ROOT: Final = Path(__file__).parents[2]
SOURCE: Final = ROOT / "src" / "rotorfit"
PICTURE: Final = Path(__file__).with_name("rooms.svg")
WIDTH, BOX, HEIGHT, GAP, TOP = 900.0, 250.0, 62.0, 34.0, 20.0
COLUMNS: Final = {1: (0.4,), 2: (0.22, 0.58), 3: (0.18, 0.5, 0.82)}
ASIDE: Final = (0.82,)
"""Where the rooms of a layer stand, in parts of the width."""
INK, FAINT, EDGE, FILL = "#22303c", "#4f5d68", "#1a5fa3", "#eef3f8"
WITNESS: Final = "#f8f0ea"


@dataclass(frozen=True, slots=True, kw_only=True)
class Room:
    """One folder of the source, or a module that stands alone.

    Attributes
    ----------
    name, what
        Of the folder, and the first line of its `__init__`.
    modules
        How many it has.
    uses
        The other rooms that it imports.
    """

    name: str
    what: str
    modules: int
    uses: frozenset[str]


def layers() -> list[list[str]]:
    """Return the rooms of each layer, from the command line down."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    contract = next(
        c for c in settings["tool"]["importlinter"]["contracts"] if c["type"] == "layers"
    )
    return [
        [name.strip().removeprefix("rotorfit.") for name in layer.split("|")]
        for layer in contract["layers"]
    ]


@cache
def rooms() -> dict[str, Room]:
    """Return every room of the layers, with its imports as the source has them."""
    names = [name for layer in layers() for name in layer]
    return {name: _room(name, names) for name in names}


def _room(name: str, names: Sequence[str]) -> Room:
    folder = SOURCE / name
    files = sorted(folder.rglob("*.py")) if folder.is_dir() else [SOURCE / f"{name}.py"]
    trees = [ast.parse(file.read_text(encoding="utf-8")) for file in files]
    first = folder / "__init__.py" if folder.is_dir() else files[0]
    what = ast.get_docstring(ast.parse(first.read_text(encoding="utf-8"))) or ""
    found = {used for tree in trees for used in _imported(tree)}
    return Room(
        name=name,
        what=what.splitlines()[0],
        modules=sum(file.name != "__init__.py" for file in files),
        uses=frozenset(found & set(names) - {name}),
    )


def _imported(tree: ast.Module) -> set[str]:
    """Return the first part of every module of the package that is imported, wherever."""
    imports = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    found = {
        node.module.split(".")[1]
        for node in imports
        if node.module and node.module.startswith("rotorfit.")
    }
    # `from rotorfit import version` names the room itself.
    return found | {
        alias.name for node in imports if node.module == "rotorfit" for alias in node.names
    }


def reduced(uses: Mapping[str, frozenset[str]]) -> dict[str, set[str]]:
    """Return the arrows without those that others imply."""
    reach: dict[str, set[str]] = {}

    def reachable(name: str) -> set[str]:
        if name not in reach:
            reach[name] = set(uses[name]).union(*(reachable(n) for n in uses[name]))
        return reach[name]

    return {
        name: {n for n in used if not any(n in reachable(other) for other in used - {n})}
        for name, used in uses.items()
    }


def picture() -> str:
    """Return the drawing."""
    found = rooms()
    places = _places(layers())
    arrows = reduced({name: room.uses for name, room in found.items()})
    parts = [
        _arrow(places[a], places[b], places.values())
        for a, used in arrows.items()
        for b in sorted(used)
    ]
    parts += [_box(room, *places[name]) for name, room in found.items()]
    height = TOP + len(layers()) * (HEIGHT + GAP)
    ground = tag("rect", {"width": WIDTH, "height": height, "fill": "#ffffff"})
    return f"{drawing(WIDTH, height, {'xmlns': NAMESPACE}, ground, *parts)}\n"


def _places(rows: Sequence[Sequence[str]]) -> dict[str, tuple[float, float]]:
    """Return the middle of the upper edge of each box; the simulator stands aside."""
    places: dict[str, tuple[float, float]] = {}
    for i, row in enumerate(rows):
        y = TOP + i * (HEIGHT + GAP)
        columns = ASIDE if row == ["simulation"] else COLUMNS[len(row)]
        places |= {name: (WIDTH * x, y) for name, x in zip(row, columns, strict=True)}
    return places


def _arrow(
    above: tuple[float, float], below: tuple[float, float], boxes: Collection[tuple[float, float]]
) -> str:
    """Return an arrow between two boxes, past those that stand between them."""
    (x1, y1), (x2, y2) = above, below
    y1 += HEIGHT
    middles = [(x, (y + HEIGHT / 2 - y1) / (y2 - y1)) for x, y in boxes if y1 < y < y2 - HEIGHT]
    hit = [x for x, s in middles if abs(x1 + s * (x2 - x1) - x) < BOX / 2 + 8]
    ends = [f"{x1:.0f} {y1:.0f}", f"{x1:.0f} {y1 + GAP:.0f}", f"{x2:.0f} {y2 - GAP:.0f}"]
    if hit:
        side = max(hit) + BOX if x1 + x2 >= 2 * max(hit) else min(hit) - BOX
        ends[1:] = [f"{side:.0f} {y1 + GAP:.0f}", f"{side:.0f} {y2 - GAP:.0f}"]
    path = f"M{ends[0]} C{ends[1]} {ends[2]} {x2:.0f} {y2:.0f}"
    head = f"M{x2 - 4:.0f} {y2 - 7:.0f} L{x2:.0f} {y2:.0f} L{x2 + 4:.0f} {y2 - 7:.0f}"
    style = {"stroke": EDGE, "stroke-width": 1.3, "fill": "none", "opacity": 0.75}
    return tag("path", {"d": path, **style}) + tag("path", {"d": head, **style})


def _box(room: Room, x: float, y: float) -> str:
    fill = WITNESS if room.name == "simulation" else FILL
    frame = {"x": x - BOX / 2, "y": y, "width": BOX, "height": HEIGHT, "rx": 5}
    lines = wrap(room.what.rstrip("."), 46)[:3]
    count = "1 module" if room.modules == 1 else f"{room.modules} modules"
    font = {"font-family": "sans-serif", "text-anchor": "middle", "x": x}
    parts = [
        tag("rect", {**frame, "fill": fill, "stroke": EDGE, "stroke-width": 1}),
        label(f"{room.name}", {**font, "y": y + 17, "font-size": 14, "fill": INK,
                               "font-weight": "bold"}),
        label(count, {"font-family": "sans-serif", "x": x + BOX / 2 - 6, "y": y + 15,
                      "font-size": 9, "fill": FAINT, "text-anchor": "end"}),
    ]  # fmt: skip
    parts += [
        label(line, {**font, "y": y + 31 + 12 * i, "font-size": 10, "fill": FAINT})
        for i, line in enumerate(lines)
    ]
    return "".join(parts)


def main() -> None:
    PICTURE.write_text(picture(), encoding="utf-8", newline="\n")


if __name__ == "__main__":
    main()
