"""Rotor speeds and commands of an unknown table: which columns, in what unit."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.logs.column_names import ASKED, COMMAND_WORDS, SPEED_WORDS, Candidate, is_by_corner
from rotorfit.logs.columns import ColumnSpec
from rotorfit.logs.motor_outputs import MOTOR_COUNTS
from rotorfit.logs.proposed_channels import Found, Question, known_rows, stacked
from rotorfit.logs.units import UNITS

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from jaxtyping import Float

    from rotorfit.logs.exporters import Exporter
    from rotorfit.logs.proposed_channels import Numbers

_PULSES: Final = (1000.0, 2000.0)
"""Pulse widths of stop and full throttle [us], as a rule."""
_FULL_COUNTS: Final = (255.0, 1023.0, 2047.0, 4095.0, 65535.0)
"""Full scales of 8, 10, 11, 12 and 16 bits: full throttle is the first that the flight stays under,
as a rotor that hovers at a sixteenth of its scale or less is none that anybody builds."""

_DSHOT: Final = (48.0, 2047.0)
"""Least and largest throttle of DShot, which flight controllers log as it is sent."""
_TURNING_SHARE: Final = 0.05
"""Share of the rows with each sign from which a column is no speed and no command of a motor: noise
at rest is far smaller than flight, and signed speeds keep their sign."""
_SLOW: Final = 0.3
"""Share of the rows of the fastest motor columns below which a group is not taken before them."""
_LEAST_PULSE: Final = 900.0
_LARGEST_PULSE: Final = 2000.0
"""Pulse widths that motors are sent [us]."""


def motors_found(
    candidates: Sequence[Candidate],
    numbers: Numbers,
    units: Mapping[str, str],
    exporter: Exporter | None,
) -> Found:
    """Find rotor speeds and commands, and their units."""
    columns: dict[str, ColumnSpec] = {}
    reasons: list[str] = []
    questions: list[Question] = []
    # What a controller computed as thrust [N] stands beside what it sent to the motors, and the
    # speed that it asked for beside the speed that was measured.
    rows = [_count_rows(one, numbers) for one in candidates]
    slow = {one.stem for one, n in zip(candidates, rows, strict=True) if n < _SLOW * max(rows)}
    for one in sorted(candidates, key=lambda one: (*_rank_group(one), one.stem in slow)):
        held, words = _used_columns(one, numbers) if one.kind == "motor" else ([], "")
        values = known_rows(stacked(held, numbers)) if len(held) > 2 else np.empty((0, 0))
        if len(values) < 2 or float(np.ptp(values)) == 0:
            continue
        turning = _list_turning(held, values) if one.stem else []
        if len(turning) > 1:
            reasons.append(
                f"{held[0]} ...: left out, {' and '.join(turning[:2])} change their sign, as "
                "torques do and motors do not"
            )
            continue
        unit, why, choices = _unit_by_exporter(one, values, exporter) or _motor_unit(one, values)
        if unit is None:
            unit, why = units.get("motors"), "as stated"
            asked = f"Unit of {held[0]} to {held[-1]} ({values.min():.6g} to {values.max():.6g})"
            if unit is None:
                questions.append(Question(channel="motors", words=asked, choices=choices))
                unit, why = (
                    choices[0],
                    "(a guess, since names and values do not tell: answer the question about it)",
                )
        if _column_stem(unit) in units:
            unit, why = units[_column_stem(unit)], "as stated"
        stem = _column_stem(unit)
        span = _range_of(unit, values, exporter)
        if unit == "counts" and span is not None and span != _DSHOT:
            why = f"(0 to {span[1]:.0f}: correct range if full is another) {why}"
        if f"{stem}_1" in columns:
            reasons.append(f"{held[0]} ...: left out, {stem}_1 is {columns[f'{stem}_1'].name}")
            continue
        columns |= {
            f"{stem}_{i}": _spec_of(name, unit, span, exporter)
            for i, name in enumerate(held, start=1)
        }
        what = "rotor speed" if stem == "rotor" else "command"
        reasons.append(f"{what}: {held[0]} to {held[-1]} in {unit} {why}{words}")
    return Found(columns=columns, reasons=tuple(reasons), questions=tuple(questions))


def _rank_group(one: Candidate) -> tuple[bool, bool]:
    """Rank groups of motor columns: those of a controller's arithmetic last."""
    words = set(one.stem.split())
    return "thrust" in words, not words.isdisjoint(ASKED)


def _count_rows(one: Candidate, numbers: Numbers) -> int:
    """Count the rows in which a group of motor columns holds numbers."""
    held = [numbers[name] for name in one.by_index.values() if name in numbers]
    is_motor = one.kind == "motor" and len(held) > 2
    return max(int(np.isfinite(values).sum()) for values in held) if is_motor else 0


def _list_turning(held: Sequence[str], values: Float[np.ndarray, "n k"]) -> list[str]:
    """List the columns that are well above zero in some rows, and well below in others."""
    large = 0.1 * np.quantile(np.abs(values), 0.95, axis=0)
    shares = np.minimum((values > large).mean(axis=0), (values < -large).mean(axis=0))
    return [name for name, share in zip(held, shares, strict=True) if share > _TURNING_SHARE]


def _used_columns(one: Candidate, numbers: Numbers) -> tuple[list[str], str]:
    """Select the columns of motors: those with numbers, without outputs that never move."""
    names = [name for _, name in sorted(one.by_index.items())]
    held = [n for n in names if n in numbers and np.isfinite(numbers[n]).any()]
    moving = [n for n in held if float(np.nanmax(numbers[n])) > float(np.nanmin(numbers[n]))]
    # Outputs that stand still are left out only where the others are as many as a multirotor has: a
    # motor that stands still is one of these.
    kept = moving if len(moving) in MOTOR_COUNTS[1:] else held
    words = (
        "" if len(kept) == len(names) else f"; {len(names) - len(kept)} that never move left out"
    )
    if any(is_by_corner(name) for name in kept):
        words += "; numbered by their corners as PX4 does: the motor order is px4"
    numbers_of = sorted(one.by_index)
    between = range(numbers_of[0], numbers_of[-1] + 1) if kept else range(0)
    gone = [str(i) for i in between if i not in one.by_index]
    if gone and len(kept) == len(names):
        words += f"; number {' and '.join(gone)} is missing between them: record it, too"
    return kept, words


def _spec_of(
    name: str, unit: str, span: tuple[float, float] | None, exporter: Exporter | None
) -> ColumnSpec:
    """Return how a motor's column is read."""
    scale = exporter.erpm_scale if exporter is not None and unit == "erpm" else 1.0
    return ColumnSpec(name=name, unit=unit, scale=scale, range=span)


def _range_of(
    unit: str, values: Float[np.ndarray, "n k"], exporter: Exporter | None
) -> tuple[float, float] | None:
    """Return stop and full throttle of a command; None if its unit says them, or of a speed."""
    if unit == "us":
        return _PULSES
    if unit != "counts":
        return None
    if exporter is not None and exporter.dshot:
        return _DSHOT
    high = float(values.max())
    return 0.0, next((full for full in _FULL_COUNTS if high <= full), _FULL_COUNTS[-1])


def _unit_by_exporter(
    one: Candidate, values: Float[np.ndarray, "n k"], exporter: Exporter | None
) -> tuple[str, str, tuple[str, ...]] | None:
    """Find the unit that a program's motor columns have; None if its names do not say."""
    if exporter is None or one.unit in UNITS["rotor speed"] or one.unit in UNITS["command"]:
        return None
    why = "as such tables have it"
    if exporter.dshot and one.stem == "motor":
        low, high = float(values.min()), float(values.max())
        is_pulse = low >= _LEAST_PULSE and high <= _LARGEST_PULSE
        return ("us", why, ()) if is_pulse else ("counts", f"(DShot, 48 to 2047), {why}", ())
    is_speed = any(word in one.stem for word in SPEED_WORDS)
    unit = exporter.units.get("rotor" if is_speed else "command")
    return None if unit is None else (unit, why, ())


def _column_stem(unit: str) -> str:
    """Classify motor columns by their unit: ``rotor`` (speeds) or ``command``."""
    return "rotor" if unit in ("rad/s", "rpm", "erpm", "Hz") else "command"


def _motor_unit(
    one: Candidate, values: Float[np.ndarray, "n k"]
) -> tuple[str | None, str, tuple[str, ...]]:
    """Find the unit of motor columns by name and values; None, and the choices, if unknown."""
    joined, low, high = one.stem.replace(" ", ""), float(values.min()), float(values.max())
    is_speed = any(word in joined for word in SPEED_WORDS if word != "rot") or one.unit in (
        "rpm",
        "erpm",
        "rad/s",
        "Hz",
    )
    is_command = any(word in joined for word in COMMAND_WORDS) and not is_speed
    speeds = ("rpm", "erpm", "rad/s", "Hz") if high > 6000 else ("rad/s", "rpm", "Hz", "erpm")
    is_full_word = 60_000 < high <= 65_535  # 16 bits, all of them used
    if one.unit in ("rpm", "erpm", "rad/s", "Hz"):
        return one.unit, "by its name", speeds
    if not is_speed:
        if low >= -0.1 and high <= 1.5:
            return "1", "as it ends at 1", ()
        if one.unit in ("%", "us"):
            return one.unit, "by its name", ()
        if is_command and low >= 700 and high <= 2300:
            return "us", "as pulse widths are", ()
        commands = ("us", "counts", "%") if high > 100 else ("%", "us", "counts")
        if is_full_word:
            return None, "", ("counts", *speeds)
        if low >= _LEAST_PULSE and high <= 1.1 * _LARGEST_PULSE and (values % 1.0 == 0.0).all():
            return None, "", ("us", *speeds, "counts", "%")
        return None, "", commands if is_command else (*speeds, *commands)
    return None, "", speeds
