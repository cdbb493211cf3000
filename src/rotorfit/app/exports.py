"""The targets of `rotorfit export` on the page, and a result as their files.

The engine offers the targets at once; the exporters are imported only when a file is made.
"""

import base64
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rotorfit.errors import MissingNumbersError, OutputError
from rotorfit.export.targets import OFFERED, RANDOM_TARGETS


def exported(folder: Path, argument: Mapping[str, Any]) -> dict[str, Any]:
    """Make the file of a target from the page's result.

    The argument holds ``target``, and where wanted ``configuration``, ``assume`` and ``project``.
    """
    from rotorfit.export.result_numbers import number_warnings
    from rotorfit.export.write import drawn_sentence, export, randomised
    from rotorfit.results.sound_result import load_sound

    target = argument["target"]
    if target not in OFFERED:
        raise OutputError(f"no target {target!r}; targets: {', '.join(OFFERED)}")
    path = folder / "result.json"
    if not path.exists():
        raise OutputError("there is no result yet: identify first")
    result = load_sound(path)
    assumed = _assumed(argument.get("assume") or {})
    configuration = argument.get("configuration")
    name = f"{target}{OFFERED[target].suffix}"
    if target in RANDOM_TARGETS:
        content, found = randomised(
            result, target, Path(name), configuration=configuration, assumed=assumed
        )
        data = base64.b64encode(content).decode()
        return {"name": name, "base64": data, "notes": [drawn_sentence(found)]}
    made = export(
        result,
        target,
        configuration=configuration,
        assumed=assumed,
        project=argument.get("project") is True,
    )
    return {
        "name": name,
        "text": made.text,
        "notes": [*number_warnings(made.model.numbers), *made.model.notes],
    }


def missing_numbers(error: MissingNumbersError) -> list[dict[str, str]]:
    """List the numbers that the user may supply, with their units."""
    from rotorfit.export.result_numbers import unit_of

    return [{"name": name, "unit": unit_of(name)} for name in error.names]


def _assumed(given: Mapping[str, Any]) -> dict[str, float]:

    from rotorfit.export.result_numbers import parse_assumptions

    try:
        return parse_assumptions([f"{name}={value}" for name, value in given.items()])
    except ValueError as error:
        raise OutputError(str(error)) from error
