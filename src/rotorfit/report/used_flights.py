"""Which part of each flight was used, and what was cut out of it, as bars over time."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.files import file_name
from rotorfit.report.pages import drawing, label, labelled_ticks, tag, text

if TYPE_CHECKING:
    from rotorfit.results.result import (
        FlightRecord,
        IdentificationResult,
    )

WIDTH, HEIGHT, BAR = 920.0, 56.0, 22.0
MARGIN = 12.0
MOST_LISTED = 6


@frozen_dataclass
class Cut:
    """Why something was cut, how much in all, and where."""

    reason: str
    shade: int
    seconds: float
    places: str


@frozen_dataclass
class UsedFlightView:
    """One flight as it is shown."""

    name: str
    configuration: str
    seconds: float
    samples: int
    bar: str
    cuts: tuple[Cut, ...]
    warnings: tuple[str, ...]


def used_flights(result: IdentificationResult) -> tuple[UsedFlightView, ...]:
    """Describe every flight with its time bar; equal reasons have equal shades on the page."""
    reasons = list(dict.fromkeys(why for f in result.flights for _, _, why in f.cuts))
    shades = {reason: i % 5 for i, reason in enumerate(reasons)}
    return tuple(
        UsedFlightView(
            name=file_name(flight.file),
            configuration=flight.configuration,
            seconds=flight.seconds_used,
            samples=flight.samples_used,
            bar=time_bar(flight, shades),
            cuts=_group_cuts(flight, shades),
            warnings=flight.warnings,
        )
        for flight in result.flights
    )


def _group_cuts(flight: FlightRecord, shades: dict[str, int]) -> tuple[Cut, ...]:
    by_reason: dict[str, list[tuple[float, float]]] = {}
    for start, end, reason in flight.cuts:
        by_reason.setdefault(reason, []).append((start, end))
    return tuple(
        Cut(
            reason=reason,
            shade=shades[reason],
            seconds=sum(end - start for start, end in places),
            places=_places_text(places),
        )
        for reason, places in by_reason.items()
    )


def _places_text(places: list[tuple[float, float]]) -> str:
    shown = [f"{start:.1f} to {end:.1f} s" for start, end in places[:MOST_LISTED]]
    more = len(places) - MOST_LISTED
    return ", ".join(shown) + (f" and {more} more" if more > 0 else "")


def time_bar(flight: FlightRecord, shades: dict[str, int]) -> str:
    """Draw a flight from its first sample to its last: used parts and cuts."""
    spans = [*flight.used, *((a, b) for a, b, _ in flight.cuts)]
    t0 = min([0.0, *(a for a, _ in spans)])
    t1 = max([t0 + 1e-3, *(b for _, b in spans)])

    def block(start: float, end: float, style: str, words: str) -> str:
        x = MARGIN + (start - t0) / (t1 - t0) * (WIDTH - 2 * MARGIN)
        width = max((end - start) / (t1 - t0) * (WIDTH - 2 * MARGIN), 0.8)
        title = tag("title", {}, text(f"{start:.2f} to {end:.2f} s: {words}"))
        box: dict[str, str | float] = {"x": x, "y": 4, "width": width, "height": BAR}
        return tag("rect", {"class": style, **box}, title)

    parts = [block(a, b, f"cut shade-{shades[why]}", why) for a, b, why in flight.cuts]
    parts += [block(a, b, "used", "used") for a, b in flight.used]
    marks = labelled_ticks(t0, t1, 8)
    for value, number in marks:
        x = MARGIN + (value - t0) / (t1 - t0) * (WIDTH - 2 * MARGIN)
        parts.append(tag("path", {"class": "tick-mark", "d": f"M{x:.2f} {BAR + 4}v5"}))
        words = number + (" s" if value == marks[-1][0] else "")
        parts.append(label(words, {"class": "tick middle", "x": x, "y": BAR + 24}))
    name = f"Time bar of {file_name(flight.file)}"
    return drawing(WIDTH, HEIGHT, {"class": "time-bar", "role": "img", "aria-label": name}, *parts)
