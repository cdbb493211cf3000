"""Units, axes and signs of the columns that names point to, by their values."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.errors import LogError
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.column_names import COMPRESSED_RATES
from rotorfit.logs.columns import NAMES, TIME, ColumnSpec, unit_of
from rotorfit.logs.filled_rows import sampled_rows
from rotorfit.logs.units import STANDARD_GRAVITY, UNITS, Axes, Quantity, attitude_from_euler

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from jaxtyping import Float

    from rotorfit.logs.column_names import Candidate

    Numbers = Mapping[str, Float[np.ndarray, " n"]]

_FASTEST_GYRO: Final = 70.0
"""Twice what the usual gyro can measure [rad/s]: more than this is no rad/s."""
_LEAST_RATES: Final = 0.7
"""Correlation of gyro and attitude from which the attitude says something of an axis."""
STATED: Final[Mapping[str, Quantity]] = {
    "time": "time",
    "gyro": "angular velocity",
    "accel": "acceleration",
    "angle": "angle",
    "reference": "angular velocity",
    "position": "position",
    "velocity": "velocity",
}
"""Channels whose unit may be stated, besides those of motors."""
MOTORS: Final = ("motors", "rotor", "command")
"""The same of motors: of columns that do not show it, of speeds, of commands."""
MOTOR_UNITS: Final = ("rad/s", "rpm", "erpm", "Hz", "1", "%", "us", "counts")


@frozen_dataclass
class Question:
    """A unit that neither names nor values of the table show.

    - `channel`: ``gyro`` or ``motors``, or ``clock`` where the choices are columns.
    - `choices`: units of which one is right, the likeliest first.
    """

    channel: str
    words: str
    choices: tuple[str, ...]

    @property
    def option(self) -> str:
        """The option of ``rotorfit airframe`` that answers it."""
        is_column = self.channel == "clock"
        return "--column time=NAME" if is_column else f"--unit {self.channel}=UNIT"


@frozen_dataclass
class Found:
    """What one channel adds to a proposal."""

    columns: Mapping[str, ColumnSpec]
    reasons: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()
    questions: tuple[Question, ...] = ()


def stacked(names: Iterable[str], numbers: Numbers) -> Float[np.ndarray, "n k"]:
    """Stack columns side by side."""
    return np.stack([numbers[name] for name in names], axis=1)


def known_rows(values: Float[np.ndarray, "n k"]) -> Float[np.ndarray, "m k"]:
    """Select the rows in which every column holds a number."""
    return values[np.isfinite(values).all(axis=1)]


def chosen_of(kind: str, candidates: Sequence[Candidate], numbers: Numbers) -> Candidate | None:
    """Select the first whole group of a kind whose columns hold numbers, by index from 0.

    Of accelerometers the one that is named by hand, or feels gravity: accelerations without it, as
    of an estimate or a set point, may come first.
    """
    whole = list(_whole_groups(kind, candidates, numbers))
    first = whole[0] if whole else None
    if kind != "accel":
        return first
    return next((one for one in whole if one.stem == "" or _feels_gravity(one, numbers)), first)


def _feels_gravity(one: Candidate, numbers: Numbers) -> bool:
    """Return whether the median of a group is gravity along z, in some unit."""
    values = known_rows(stacked(one.by_index.values(), numbers))
    try:
        _gravity_unit(float(np.median(np.linalg.norm(values, axis=1))), one.unit)
    except LogError:
        return False
    return int(np.argmax(np.abs(np.median(values, axis=0)))) == 2


def _whole_groups(
    kind: str, candidates: Sequence[Candidate], numbers: Numbers
) -> Iterator[Candidate]:
    """Iterate over the whole groups of a kind whose columns hold numbers, by index from 0."""
    wanted = len(NAMES[kind])
    for one in candidates:
        held = {i: n for i, n in sorted(one.by_index.items()) if n in numbers}
        whole = len(held) >= wanted and len(known_rows(stacked(held.values(), numbers))) > 1
        if one.kind == kind and whole:
            yield replace(one, by_index=dict(enumerate(list(held.values())[:wanted])))


def _column_specs(
    kind: str, chosen: Candidate, unit: str | None, *, scale: Sequence[float] | float = 1.0
) -> dict[str, ColumnSpec]:
    factors = np.broadcast_to(np.asarray(scale, float), len(NAMES[kind])).tolist()
    return {
        canonical: ColumnSpec(name=chosen.by_index[i], unit=unit, scale=factors[i])
        for i, canonical in enumerate(NAMES[kind])
    }


def accelerometer_found(
    chosen: Candidate | None, numbers: Numbers, stated: str | None, stated_axes: Axes | None
) -> tuple[Found, Axes]:
    """Find the accelerometer's unit by gravity, and the axes by its sign; both may be stated."""
    assert chosen is not None
    values = known_rows(stacked(chosen.by_index.values(), numbers))
    length = float(np.median(np.linalg.norm(values, axis=1)))
    along = np.median(values, axis=0)
    if stated is not None or stated_axes is not None:
        return _set_accelerometer(chosen, length, float(along[2]), stated, stated_axes)
    unit, factor = _gravity_unit(length, chosen.unit)
    axis = int(np.argmax(np.abs(along)))
    if abs(along[axis]) < 0.5 * length:
        shown = ", ".join(f"{one:.3g}" for one in along)
        raise LogError(
            f"no axis of {chosen.by_index[0]} ... holds gravity (medians {shown}): record the "
            "accelerometer with gravity in it, or turn its columns into body axes"
        )
    if axis != 2:
        raise LogError(
            f"gravity lies along {chosen.by_index[axis]} (median {along[axis]:.3g}), expected "
            "along z: put the columns into the order forward, left, up with --column accel_z=NAME"
        )
    axes: Axes = "FLU" if along[2] > 0 else "FRD"
    words = (
        f"accelerometer: {length:.4g} in the median is gravity in {unit}"
        f"{'' if factor == 1 else f' / {1 / factor:.0f}'}; {chosen.by_index[2]} of "
        f"{along[2]:+.4g} says axes {axes} (z {'up' if axes == 'FLU' else 'down'})"
    )
    doubts = (
        (f"the accelerometer is named in {chosen.unit}, but gravity says {unit}",)
        if chosen.unit in UNITS["acceleration"] and chosen.unit != unit
        else ()
    )
    columns = _column_specs("accel", chosen, unit, scale=factor)
    return Found(columns=columns, reasons=(words,), doubts=doubts), axes


def _set_accelerometer(
    chosen: Candidate, length: float, up: float, unit: str | None, axes: Axes | None
) -> tuple[Found, Axes]:
    """Take unit or axes of the accelerometer as stated; doubt them where gravity says otherwise."""
    factor = 1.0
    if unit is None:
        unit, factor = _gravity_unit(length, chosen.unit)
    felt = length * factor * UNITS["acceleration"][unit]
    seen: Axes = "FLU" if up > 0 else "FRD"
    doubts: list[str] = []
    if not 0.75 < felt / STANDARD_GRAVITY < 1.35:
        doubts.append(
            f"the accelerometer in {unit} feels {felt:.4g} m/s^2 in the median: gravity is 9.81"
        )
    if axes not in (None, seen):
        doubts.append(
            f"axes {axes}, as stated, but {chosen.by_index[2]} of {up:+.4g} says {seen}: "
            "gravity would lie upside down"
        )
    words = f"accelerometer: {felt:.4g} m/s^2 in the median, axes {axes or seen}"
    found = Found(
        columns=_column_specs("accel", chosen, unit, scale=factor),
        reasons=() if doubts else (words,),
        doubts=tuple(doubts),
    )
    return found, axes or seen


def _gravity_unit(length: float, named: str | None) -> tuple[str, float]:
    """Find the unit in which a length is gravity, with the factor of raw counts before it.

    The unit of the name first: 981 is gravity in cm/s^2 and nearly so in mg.
    """
    known = UNITS["acceleration"]
    by_name = [named] if named is not None and named in known else []
    for unit in (*by_name, "m/s^2", "g", "mg"):
        if 0.75 < length * known[unit] / STANDARD_GRAVITY < 1.35:
            return unit, 1.0
    for counts in (512, 2048, 4096, 8192, 16384):
        if 0.85 < length / counts < 1.15:
            return "g", 1.0 / counts
    if 0.75 < length * known["mm/s^2"] / STANDARD_GRAVITY < 1.35:
        return "mm/s^2", 1.0
    raise LogError(
        f"the accelerometer's median length is {length:.4g}, gravity in no unit (9.81 m/s^2, 1 g): "
        "record the accelerometer itself, gravity included, and look at its columns"
    )


def attitude_found(
    chosen: Mapping[str, Candidate | None], numbers: Numbers, stated: str | None
) -> Found:
    """Find the attitude: a quaternion of length 1, else Euler angles; their unit may be stated."""
    quaternion, angles = chosen["quaternion"], chosen["angle"]
    if quaternion is not None:
        values = known_rows(stacked(quaternion.by_index.values(), numbers))
        if abs(np.median(np.linalg.norm(values, axis=1)) - 1.0) < 0.05:
            return Found(
                columns=_column_specs("quaternion", _order_quaternion(quaternion, values), None)
            )
    if angles is None:
        return Found(columns={})
    values = known_rows(stacked(angles.by_index.values(), numbers))
    by_value = "deg" if float(np.abs(values).max()) > 2 * np.pi else "rad"
    unit = stated or (angles.unit if angles.unit in UNITS["angle"] else by_value)
    return Found(columns=_column_specs("angle", angles, unit))


def _order_quaternion(chosen: Candidate, values: Float[np.ndarray, "n 4"]) -> Candidate:
    """Put numbered quaternions into the order w, x, y, z: a flight tilts little about x and y."""
    if "lettered" in chosen.stem or chosen.stem == "":
        return chosen
    size = np.sqrt(np.mean(values**2, axis=0))
    w_first = size[1] ** 2 + size[2] ** 2 <= size[0] ** 2 + size[1] ** 2
    order = (0, 1, 2, 3) if w_first else (3, 0, 1, 2)
    return replace(chosen, by_index={i: chosen.by_index[k] for i, k in enumerate(order)})


def attitude_rate(
    attitude: Found, clock: ColumnSpec, numbers: Numbers
) -> Float[np.ndarray, "n 3"] | None:
    """Differentiate the attitude: body rates in its own axes [rad/s]; None if there is none."""
    if not attitude.columns:
        return None
    values = stacked((spec.name for spec in attitude.columns.values()), numbers)
    if "roll" in attitude.columns:
        unit = unit_of("roll", attitude.columns["roll"])
        values = attitude_from_euler(values * UNITS["angle"][unit])
    time = numbers[clock.name] * UNITS["time"][unit_of(TIME, clock)]
    rate = np.full((len(values), 3), np.nan)
    # A slower attitude has empty cells between its rows.
    known = np.isfinite(values).all(axis=1) & np.isfinite(time)
    if known.sum() < 2:
        return rate
    # Or its last sample in them.
    sampled = sampled_rows(time[known], values[known])
    if sampled is not None:
        known[known] = sampled
    w, u = values[known, :1], values[known, 1:]
    with np.errstate(divide="ignore", invalid="ignore"):
        turn = np.gradient(values[known], time[known], axis=0)
    dw, du = turn[:, :1], turn[:, 1:]
    # 2 conj(q) dq, which a change of sign of q from row to row spoils: its median does not see it.
    rate[known] = 2.0 * (w * du - u * dw - np.cross(u, du))
    return rate


def gyro_found(
    chosen: Candidate | None,
    rate: Float[np.ndarray, "n 3"] | None,
    numbers: Numbers,
    stated: str | None,
    *,
    usual: str | None = None,
    accel_unit: str | None = None,
) -> Found:
    """Find the gyro's unit: by the attitude, else by name, else by its peaks, else ask.

    `usual`: of the program that wrote the table, where that is known; `accel_unit`: of its
    accelerometer.
    """
    assert chosen is not None
    values = stacked(chosen.by_index.values(), numbers)
    # "gyro_rad" is what PX4 calls it: of a turn that is rad/s.
    unit = f"{chosen.unit}/s" if chosen.unit in UNITS["angle"] else chosen.unit
    named = unit if unit in UNITS["angular velocity"] else usual
    slopes = None if rate is None else _fit_slopes(values, rate)
    found = slopes if slopes is not None and np.isfinite(slopes).any() else None
    if stated is not None:
        return _with_unit(chosen, stated, f"gyro: {stated}, as stated")
    if found is not None:
        factor = float(np.nanmedian(np.abs(found)))
        si = {u: s for u, s in UNITS["angular velocity"].items() if 0.8 < factor * s < 1.25}
        if si:
            unit = next(iter(si))
            words = f"gyro: {factor:.3g} times the rate of the attitude in rad/s, so {unit}"
            doubts = (
                (f"the gyro is named in {named}, but the attitude says {unit}",)
                if named not in (None, unit)
                else ()
            )
            return replace(_with_unit(chosen, unit, words), doubts=doubts)
    peak = float(np.nanmax(np.abs(values)))
    if named is not None:
        found = _with_unit(chosen, named, f"gyro: {named} by its name")
        too_fast = peak * UNITS["angular velocity"][named] > _FASTEST_GYRO
        doubt = f"the gyro is named in {named}, but reaches {peak:.3g}: no gyro turns so fast"
        return replace(found, doubts=(doubt,)) if too_fast else found
    choices = ("rad/s", "deg/s")
    if peak > _FASTEST_GYRO and accel_unit == "mg":  # so MAVLink and Crazyflies send them
        choices = ("mrad/s", "deg/s")
    elif peak > _FASTEST_GYRO:
        return _with_unit(chosen, "deg/s", f"gyro: up to {peak:.3g}, too fast for rad/s: deg/s")
    words = f"Unit of the gyro ({', '.join(chosen.by_index.values())}, up to {peak:.3g})"
    question = Question(channel="gyro", words=words, choices=choices)
    guess = f"gyro: perhaps in {choices[0]}, neither name nor values say"
    return replace(_with_unit(chosen, choices[0], guess), questions=(question,))


def _with_unit(chosen: Candidate, unit: str, words: str) -> Found:
    signs = (1.0, -1.0, 1.0) if chosen.stem == COMPRESSED_RATES else 1.0
    columns = _column_specs("gyro", chosen, unit, scale=signs)
    return Found(columns=columns, reasons=(words,))


def _fit_slopes(
    values: Float[np.ndarray, "n 3"], rate: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, " 3"]:
    """Fit gyro = slope * rate of the attitude, an axis each; NaN if they do not go together."""
    slopes = np.full(3, np.nan)
    good = np.isfinite(values).all(axis=1) & np.isfinite(rate).all(axis=1)
    for i in range(3):
        x, y = rate[good, i], values[good, i]
        # Jumps of the attitude (yaw over a turn, a quaternion's sign) are no rates.
        if len(x) == 0:
            continue
        kept = np.abs(x) < 20.0 * float(np.median(np.abs(x))) + 1e-9
        x, y = _smooth_values(x[kept]), _smooth_values(y[kept])
        if len(x) < 10 or np.std(x) == 0.0 or np.std(y) == 0.0:
            continue
        if abs(float(np.corrcoef(x, y)[0, 1])) > _LEAST_RATES:
            slopes[i] = float(np.cov(x, y)[0, 1] / np.var(x, ddof=1))
    return slopes


def _smooth_values(values: Float[np.ndarray, " n"]) -> Float[np.ndarray, " m"]:
    return np.convolve(values, np.full(9, 1 / 9), mode="valid") if len(values) > 9 else values


def attitude_signed(
    attitude: Found, gyro: Found, rate: Float[np.ndarray, "n 3"] | None, numbers: Numbers
) -> Found:
    """Turn the attitude into the gyro's axes where it has the other ones; doubt other signs."""
    if rate is None:
        return attitude
    values = stacked((spec.name for spec in gyro.columns.values()), numbers)
    signs = np.nan_to_num(np.sign(_fit_slopes(values, rate)))
    seen = signs != 0
    if not seen.any():
        words = "the gyro does not follow the attitude on any axis: look at both"
        return replace(attitude, doubts=(words,))
    if (signs[seen] > 0).all():
        shown = ", ".join(axis for axis, one in zip("xyz", seen, strict=True) if one)
        return replace(attitude, reasons=(f"attitude: turns as the gyro does about {shown}",))
    if seen[0] and signs[0] > 0 and (signs[1:][seen[1:]] < 0).all():
        flip = {"quat_y", "quat_z", "pitch", "yaw"}
        turned = {
            name: replace(spec, scale=-spec.scale) if name in flip else spec
            for name, spec in attitude.columns.items()
        }
        words = "attitude: in the other axes (y and z against the gyro), turned by scale = -1"
        return Found(columns=turned, reasons=(words,))
    against = ", ".join(axis for axis, sign in zip("xyz", signs, strict=True) if sign < 0)
    words = f"gyro and attitude turn against each other about {against}: one has a wrong sign"
    return replace(attitude, doubts=(words,))


def battery_found(chosen: Mapping[str, Candidate | None], numbers: Numbers) -> Found:
    """Find the battery's voltage, in V, hundredths or thousandths."""
    battery = chosen["battery"]
    if battery is None:
        return Found(columns={})
    high = float(np.nanmedian(numbers[battery.by_index[0]]))
    scale = 1.0 if 2.5 < high < 100 else 1e-3 if 2500 < high < 100_000 else 1e-2
    if not 2.5 < high * scale < 100:
        return Found(columns={})
    words = f"battery: {high * scale:.3g} V in the median"
    return Found(columns=_column_specs("battery", battery, "V", scale=scale), reasons=(words,))


def others_found(
    chosen: Mapping[str, Candidate | None], gyro: Found, units: Mapping[str, str]
) -> Found:
    """Find reference and position; a velocity only where its name says body axes."""
    columns: dict[str, ColumnSpec] = {}
    reasons: list[str] = []
    doubts: list[str] = []
    reference = chosen["reference"]
    if reference is not None:
        unit = reference.unit if reference.unit in UNITS["angular velocity"] else None
        unit = units.get("reference") or unit or gyro.columns["gyro_x"].unit
        columns |= _column_specs("reference", reference, unit)
        reasons.append(f"set point of the rates: in {unit}")
    position = chosen["position"]
    if position is not None:
        unit = units.get("position") or (
            position.unit if position.unit in UNITS["position"] else "m"
        )
        columns |= _column_specs("position", position, unit)
        reasons.append(f"position: in {unit}")
    velocity = chosen["velocity"]
    if velocity is not None:
        if "body" in velocity.stem.split():
            unit = units.get("velocity") or (
                velocity.unit if velocity.unit in UNITS["velocity"] else "m/s"
            )
            columns |= _column_specs("velocity", velocity, unit)
        else:
            shown = ", ".join(velocity.by_index.values())
            doubts.append(f"{shown}: a velocity is left out unless its name says body axes")
    return Found(columns=columns, reasons=tuple(reasons), doubts=tuple(doubts))
