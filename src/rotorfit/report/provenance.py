"""Sections 6 and 7: what of each flight was used and why not more; settings, versions, hashes."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, cast

from rotorfit.logs.files import file_name
from rotorfit.report.svg import drawing, label, labelled_ticks, tag, text
from rotorfit.results.result import FlightRecord, IdentificationResult
from rotorfit.validation.wrench_comparison import WrenchComparison

WIDTH, HEIGHT, BAR = 920.0, 56.0, 22.0
MARGIN = 12.0
MOST_LISTED = 6


@dataclass(frozen=True, slots=True, kw_only=True)
class Cut:
    """Why something was cut, how much in all, and where."""

    reason: str
    shade: int
    seconds: float
    places: str


@dataclass(frozen=True, slots=True, kw_only=True)
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
            cuts=_cuts(flight, shades),
            warnings=flight.warnings,
        )
        for flight in result.flights
    )


def _cuts(flight: FlightRecord, shades: dict[str, int]) -> tuple[Cut, ...]:
    """Group the cuts by reason."""
    by_reason: dict[str, list[tuple[float, float]]] = {}
    for start, end, reason in flight.cuts:
        by_reason.setdefault(reason, []).append((start, end))
    return tuple(
        Cut(
            reason=reason,
            shade=shades[reason],
            seconds=sum(end - start for start, end in places),
            places=_places(places),
        )
        for reason, places in by_reason.items()
    )


def _places(places: list[tuple[float, float]]) -> str:
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


METHODS = {
    "ols": "equation by equation, weighted by frequency band",
    "tls": "total least squares of all equations (Six et al. 2020)",
    "banded": "all equations and configurations at once, weighted by frequency band",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Provenance:
    """Everything needed to do it again."""

    settings: tuple[tuple[str, str], ...]
    versions: tuple[tuple[str, str], ...]
    hashes: tuple[tuple[str, str, str], ...]


def provenance_of(
    result: IdentificationResult, comparisons: Sequence[WrenchComparison]
) -> Provenance:
    """Collect settings as key and value, versions, and hashes of every flight shown."""
    hashes = [(file_name(f.file), f.sha256, "fitted") for f in result.flights]
    fitted = {f.sha256 for f in result.flights}
    hashes += [
        (file_name(c.flight), c.sha256, "validated") for c in comparisons if c.sha256 not in fitted
    ]
    return Provenance(
        settings=tuple(_leaves(result.settings, "")),
        versions=tuple((name, str(version)) for name, version in result.versions.items()),
        hashes=tuple(hashes),
    )


def _leaves(value: Any, path: str) -> list[tuple[str, str]]:
    """Flatten nested tables to lines; a list of small tables has one line for each."""
    if isinstance(value, Mapping):
        table = cast("Mapping[str, Any]", value)
        if path and not any(isinstance(v, Mapping | list | tuple) for v in table.values()):
            shown = {key: _shortened(key, v) for key, v in table.items()}
            return [(path, ", ".join(f"{key} = {_text(v)}" for key, v in shown.items()))]
        return [
            line
            for key, v in table.items()
            for line in _leaves(_shortened(key, v), f"{path}.{key}".lstrip("."))
        ]
    if isinstance(value, list | tuple) and any(
        isinstance(v, Mapping) for v in cast("list[Any]", value)
    ):
        items = cast("list[Any]", value)
        return [line for i, v in enumerate(items, 1) for line in _leaves(_flat(v), f"{path} {i}")]
    return [(path, _text(value))]


def _flat(value: Any) -> Any:
    """Write the short lists of a table as text, so that a rotor takes one line."""
    if not isinstance(value, Mapping):
        return value
    table = cast("Mapping[str, Any]", value)
    return {k: _json(v) if _is_vector(v) else v for k, v in table.items()}


def _is_vector(value: Any) -> bool:
    return isinstance(value, list | tuple) and all(
        isinstance(v, int | float) for v in cast("list[Any]", value)
    )


def _text(value: Any) -> str:
    return value if isinstance(value, str) else _json(value)


def _shortened(key: str, value: Any) -> Any:
    """Strip a file's folders: they are nobody else's business."""
    return file_name(value) if key == "file" and isinstance(value, str) else value


def _json(value: Any) -> str:
    return json.dumps(value, default=str, ensure_ascii=False)
