"""rotorfit validate: whether a result predicts flights that its fit has not seen."""

import json
import textwrap
import warnings
from pathlib import Path

from rotorfit.cli.progress import steps
from rotorfit.cli.terminal import show, terminal_width
from rotorfit.errors import RotorfitWarning
from rotorfit.report.number_words import NOTHING_PREDICTED, PREDICTED_WELL
from rotorfit.results.sound_result import load_sound
from rotorfit.validation.validate import validate_file, validation_rows
from rotorfit.validation.wrench_comparison import SHOWN, WrenchComparison


def run(
    result_path: Path,
    flights: list[Path],
    *,
    configuration: str | None,
    log_number: int | None = None,
    window: tuple[float | None, float | None] = (None, None),
    as_json: bool,
) -> None:
    """Compare, and print the errors of every flight."""
    result = load_sound(result_path)
    comparisons: list[WrenchComparison] = []
    with warnings.catch_warnings(), steps() as tell:
        warnings.simplefilter("ignore", RotorfitWarning)
        for flight in flights:
            tell(f"reading {flight.name}")
            comparisons.append(
                validate_file(
                    result,
                    flight,
                    configuration=configuration,
                    log_number=log_number,
                    start=window[0],
                    end=window[1],
                )
            )
    if as_json:
        show(json.dumps(list(validation_rows(comparisons)), indent=1, allow_nan=False))
    else:
        show(validation_text(comparisons))


def validation_text(comparisons: list[WrenchComparison]) -> str:
    """Return the relative errors as a table, in percent."""
    width = max(len(c.flight) for c in comparisons)
    lines = [
        "Thrust and moments below 3 Hz: what the motion needs against what the rotors",
        "produce; norm of the difference, in % of the rotors' own",
        f"  {'':<{width}}  configuration" + "".join(f"{name:>8}" for name in SHOWN),
    ]
    for c in comparisons:
        numbers = "".join(_percent(c.relative_error.get(name)) for name in SHOWN)
        lines.append(f"  {c.flight:<{width}}  {c.configuration:<13}{numbers}")
    if any(len(c.relative_error) < len(SHOWN) for c in comparisons):
        lines.append("  -: the result does not know the parameters of that component")
    lines += textwrap.wrap(PREDICTED_WELL, terminal_width())
    if any(error >= 1.0 for c in comparisons for error in c.relative_error.values()):
        lines += textwrap.wrap(NOTHING_PREDICTED, terminal_width())
    return "\n".join(lines)


def _percent(error: float | None) -> str:
    return f"{'-':>8}" if error is None else f"{100 * error:>8.2f}"
