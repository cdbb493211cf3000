"""Section 7: settings, versions, and fingerprints of the flights."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, cast

from rotorfit.logs.files import file_name
from rotorfit.results.result import IdentificationResult
from rotorfit.validation.wrench_comparison import WrenchComparison

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
    result: IdentificationResult, comparisons: tuple[WrenchComparison, ...]
) -> Provenance:
    """Return settings as key and value, versions, and hashes of every flight shown."""
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


def method_words(method: str) -> str:
    """Return what a method does."""
    return METHODS.get(method, method)


def _leaves(value: Any, path: str) -> list[tuple[str, str]]:
    """Return nested tables as lines; a list of small tables has one line for each."""
    if isinstance(value, Mapping):
        table = cast("Mapping[str, Any]", value)
        if path and not any(isinstance(v, Mapping | list | tuple) for v in table.values()):
            words = (f"{key} = {_word(key, v)}" for key, v in table.items())
            return [(path, ", ".join(words))]
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
    return [(path, value if isinstance(value, str) else _json(value))]


def _flat(value: Any) -> Any:
    """Return a table with its short lists as words, so that a rotor takes one line."""
    if not isinstance(value, Mapping):
        return value
    table = cast("Mapping[str, Any]", value)
    return {k: _json(v) if _is_vector(v) else v for k, v in table.items()}


def _is_vector(value: Any) -> bool:
    return isinstance(value, list | tuple) and all(
        isinstance(v, int | float) for v in cast("list[Any]", value)
    )


def _word(key: str, value: Any) -> str:
    shown = _shortened(key, value)
    return shown if isinstance(shown, str) else _json(shown)


def _shortened(key: str, value: Any) -> Any:
    """Return a file without its folders: they are nobody else's business."""
    return file_name(value) if key == "file" and isinstance(value, str) else value


def _json(value: Any) -> str:
    return json.dumps(value, default=str, ensure_ascii=False)
