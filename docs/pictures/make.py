"""Draw the picture of the first page:  rotorfit demo -o DIR && python docs/pictures/make.py DIR

95 % intervals of the demo's configuration A, by the default method and by ordinary least squares as
in the paper, in percent of the truth.
"""

import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from rotorfit.report.pages import NAMESPACE, drawing, label, tag

TITLES: Final = {
    "kt": "thrust, k_t",
    "kd": "drag torque, k_d",
    "Ixx": "roll inertia, I_xx",
    "Iyy": "pitch inertia, I_yy",
    "Izz": "yaw inertia, I_zz",
}
TITLE: Final = (
    "A simulated flight, its truth known: 95 % intervals (bars) should cross the black line"
)
LEFT, RIGHT, TOP, ROW = 150.0, 690.0, 92.0, 40.0
LOW, HIGH = -100.0, 25.0
OURS, PAPERS, INK, FAINT = "#1a5fa3", "#b5471b", "#22303c", "#c5ccd3"


def errors(result: Mapping[str, Any], truth: Mapping[str, float], name: str) -> list[float] | None:
    """Return low end, value and high end of an interval, in percent of the truth."""
    for number in result["parameters"]:
        if number["name"] == name and number["configuration"] in (None, "A"):
            if number["value"] is None or number["interval"] is None:
                return None
            low, high = number["interval"]
            return [100.0 * (v / truth[name] - 1.0) for v in (low, number["value"], high)]
    return None


def x(percent: float) -> float:
    return LEFT + (RIGHT - LEFT) * (min(max(percent, LOW), HIGH) - LOW) / (HIGH - LOW)


def words(text: str, at: tuple[float, float], **style: str | float) -> str:
    given = {"x": at[0], "y": at[1], "font-size": 13, "fill": INK, "font-family": "sans-serif"}
    return label(text, given | {key.replace("_", "-"): value for key, value in style.items()})


def bar(span: list[float], y: float, colour: str) -> str:
    low, value, high = (x(v) for v in span)
    line = {"x1": low - 0.5, "x2": high + 0.5, "y1": y, "y2": y}
    dot = {"cx": value, "cy": y, "r": 3.5, "fill": "#ffffff", "stroke": colour, "stroke-width": 2}
    return tag("line", line | {"stroke": colour, "stroke-width": 10}) + tag("circle", dot)


def grid(bottom: float) -> list[str]:
    parts: list[str] = []
    for percent in (-100, -75, -50, -25, 0, 25):
        ends = {"x1": x(percent), "x2": x(percent), "y1": TOP - 14, "y2": bottom}
        stroke = {"stroke": INK if percent == 0 else FAINT, "stroke-width": 1}
        parts.append(tag("line", ends | stroke))
        shown = "truth" if percent == 0 else f"{percent:+d} %"
        parts.append(words(shown, (x(percent), bottom + 18), text_anchor="middle"))
    return parts


def picture(folder: Path) -> str:
    """Return the drawing from the files of a demo."""
    ours, papers, truths = (
        json.loads((folder / name).read_text(encoding="utf-8"))
        for name in ("result.json", "result-paper.json", "truth.json")
    )
    truth = {**truths["shared"], **truths["configurations"]["A"]}
    bottom = TOP + ROW * len(TITLES)
    parts = [
        tag("rect", {"x": 0, "y": 0, "width": 720, "height": bottom + 34, "fill": "#ffffff"}),
        *grid(bottom),
        words(TITLE, (LEFT - 130, 24), font_weight="bold"),
        tag("circle", {"cx": LEFT + 6, "cy": 48, "r": 5, "fill": OURS}),
        words("rotorfit", (LEFT + 16, 52)),
        tag("circle", {"cx": LEFT + 106, "cy": 48, "r": 5, "fill": PAPERS}),
        words("ordinary least squares (as in Six et al. 2020)", (LEFT + 118, 52)),
    ]
    for row, (name, title) in enumerate(TITLES.items()):
        y = TOP + ROW * (row + 0.5) - 8
        parts.append(words(title, (LEFT - 14, y + 8), text_anchor="end"))
        for result, colour, offset in ((ours, OURS, 0.0), (papers, PAPERS, 14.0)):
            span = errors(result, truth, name)
            if span is not None:
                parts.append(bar(span, y + offset, colour))
    return drawing(720.0, bottom + 34, {"xmlns": NAMESPACE}, *parts)


def main() -> None:
    out = Path(__file__).parent / "intervals.svg"
    out.write_text(picture(Path(sys.argv[1])) + "\n", encoding="utf-8", newline="\n")


if __name__ == "__main__":
    main()
