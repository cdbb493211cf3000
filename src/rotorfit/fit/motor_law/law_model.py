"""Laws from command to rotor speed: their forms, and the speeds they predict with the slopes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, Literal

import numpy as np

from rotorfit.fit.motor_law.command_response import Recording, Timing, speed_response
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.logs.motor_law import Curve, MotorLaw, PowerCurve, SquareRootCurve, VoltageFactor

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from jaxtyping import Float, Int

    Vector = Float[np.ndarray, " _"]

FormName = Literal["linear", "power", "offset power", "sqrt"]
TINY: Final = 1e-6
"""Commands below are as it, in what goes with their logarithm."""


@frozen_dataclass
class Form:
    """A curve of relative speed, 1 at full command.

    - `start`, `lower`, `upper`: of its parameters.
    - `logarithm`: from commands and parameters to log relative speed and its derivatives, in rows.
    - `curve`: with a speed at full command.
    """

    start: tuple[float, ...]
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    logarithm: Callable[[Vector, Vector], tuple[Vector, Float[np.ndarray, "p n"]]]
    curve: Callable[[float, Vector], Curve]


def _offset_power(u: Vector, b: float, p: float) -> tuple[Vector, Vector, Vector]:
    """Compute p log(b + (1 - b) u), and its derivatives by b and p."""
    base = np.maximum(b + (1.0 - b) * u, TINY)
    logarithm = np.log(base)
    return p * logarithm, np.where(base > TINY, p * (1.0 - u) / base, 0.0), logarithm


def _linear_form(u: Vector, x: Vector) -> tuple[Vector, Float[np.ndarray, "p n"]]:
    value, by_offset, _ = _offset_power(u, float(x[0]), 1.0)
    return value, by_offset[None]


def _power_form(u: Vector, x: Vector) -> tuple[Vector, Float[np.ndarray, "p n"]]:
    value, _, by_exponent = _offset_power(u, 0.0, float(x[0]))
    return value, by_exponent[None]


def _offset_power_form(u: Vector, x: Vector) -> tuple[Vector, Float[np.ndarray, "p n"]]:
    value, *slopes = _offset_power(u, float(x[0]), float(x[1]))
    return value, np.array(slopes)


def _sqrt_form(u: Vector, x: Vector) -> tuple[Vector, Float[np.ndarray, "p n"]]:
    u = np.maximum(u, TINY)
    thrust = x[0] * u**2 + (1.0 - x[0]) * u
    return 0.5 * np.log(thrust), (0.5 * (u**2 - u) / thrust)[None]


FORMS: Final[Mapping[FormName, Form]] = {
    "linear": Form(
        start=(0.1,),
        lower=(-0.5,),
        upper=(0.95,),
        logarithm=_linear_form,
        curve=lambda full, x: PowerCurve(full, float(x[0]), 1.0),
    ),
    "power": Form(
        start=(0.7,),
        lower=(0.1,),
        upper=(3.0,),
        logarithm=_power_form,
        curve=lambda full, x: PowerCurve(full, 0.0, float(x[0])),
    ),
    "sqrt": Form(
        start=(0.5,),
        lower=(0.0,),
        upper=(1.0,),
        logarithm=_sqrt_form,
        curve=lambda full, x: SquareRootCurve(full, float(x[0])),
    ),
    "offset power": Form(
        start=(0.05, 0.7),
        lower=(-0.5, 0.1),
        upper=(0.95, 3.0),
        logarithm=_offset_power_form,
        curve=lambda full, x: PowerCurve(full, float(x[0]), float(x[1])),
    ),
}
"""By name, those with fewer parameters first."""


@frozen_dataclass
class Layout:
    """Which parameters a fit has, and where they are.

    - `voltage`, `two_way`: whether there is an exponent of the battery's voltage, and a lag of its
      own when falling.
    - `rotors`, `flights`: how many: all but one have a factor of their own, and each flight a
      drift, where there is no voltage.
    - `on_thrust`: whether the lag acts on the squared speed, not on the speed.
    """

    form: FormName
    voltage: bool
    two_way: bool
    rotors: int
    flights: int
    on_thrust: bool = False

    @property
    def curve(self) -> slice:
        """Parameters of the form, after the logarithm of the full speed."""
        return slice(1, 1 + len(FORMS[self.form].start))

    @property
    def exponent(self) -> int:
        """Where the exponent of the voltage is, where there is one."""
        return self.curve.stop

    @property
    def factors(self) -> slice:
        """Logarithms of the rotors' factors, then of the flights'."""
        first = self.curve.stop + int(self.voltage)
        scales = 0 if self.voltage else self.flights - 1
        return slice(first, first + self.rotors - 1 + scales)

    @property
    def drifts(self) -> slice:
        """Relative change of speed per second, one for each flight without voltage."""
        first = self.factors.stop
        return slice(first, first + (0 if self.voltage else self.flights))

    @property
    def size(self) -> int:
        """How many parameters there are; the last ones are log lag, log ratio (if any), delay."""
        return self.drifts.stop + 2 + int(self.two_way)


def law_of(recording: Recording, layout: Layout, values: Float[np.ndarray, " p"]) -> MotorLaw:
    """Build the law of the mean rotor from parameters."""
    curve = FORMS[layout.form].curve(float(np.exp(values[0])), values[layout.curve])
    if not layout.voltage or recording.nominal_voltage is None:
        return MotorLaw(curve=curve)
    exponent = float(values[layout.exponent])
    return MotorLaw(curve=curve, voltage=VoltageFactor(recording.nominal_voltage, exponent))


def timing_of(layout: Layout, x: Float[np.ndarray, " p"]) -> Timing:
    """Return lag and delay among the parameters."""
    ratio = float(x[-2]) if layout.two_way else 0.0
    lag = float(x[-2 - int(layout.two_way)])
    return Timing(log_lag=lag, log_ratio=ratio, delay=float(x[-1]))


def scales_of(
    layout: Layout, values: Float[np.ndarray, " p"]
) -> tuple[Float[np.ndarray, " N"], Float[np.ndarray, " k"]]:
    """Compute the factor of each rotor's speed, and of each flight's where there is no voltage."""
    rotors, flights = _log_scales(layout, values)
    return np.exp(rotors), np.exp(flights)


def _log_scales(
    layout: Layout, values: Float[np.ndarray, " p"]
) -> tuple[Float[np.ndarray, " N"], Float[np.ndarray, " k"]]:
    x = values[layout.factors]
    rotors = x[: layout.rotors - 1] @ _contrast_columns(np.arange(layout.rotors), layout.rotors)
    flights = np.zeros(layout.flights)
    if not layout.voltage:
        flights = x[layout.rotors - 1 :] @ _contrast_columns(
            np.arange(layout.flights), layout.flights
        )
    return rotors, flights


def predicted(
    recording: Recording, layout: Layout, x: Float[np.ndarray, " p"]
) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, "p m"]]:
    """Predict the speeds by the parameters, with the slopes, one row for each parameter."""
    logarithm, bending = FORMS[layout.form].logarithm(recording.command, x[layout.curve])
    if layout.voltage and recording.voltage is not None:
        bending = np.vstack([bending, np.log(recording.voltage)])
        logarithm = logarithm + x[layout.exponent] * bending[-1]
    if not layout.voltage:
        # One row for the drifts of all flights: a flight's speeds follow its own commands.
        bending = np.vstack([bending, recording.since])
        logarithm = logarithm + x[layout.drifts][recording.flight] * recording.since
    rotors, flights = _log_scales(layout, x)
    logarithm += (x[0] + rotors)[recording.rotor] + flights[recording.flight]
    settled = np.exp(np.minimum(logarithm, 30.0))
    bending *= settled
    speed, slopes = _follow_lag(recording, layout, x, settled, bending)
    return speed, _slopes_by_parameter(recording, layout, speed, slopes)


def _slopes_by_parameter(
    recording: Recording,
    layout: Layout,
    speed: Float[np.ndarray, " m"],
    slopes: Float[np.ndarray, "q m"],
) -> Float[np.ndarray, "p m"]:
    """Arrange the slopes of a response as the parameters of a layout are."""
    rows = np.empty((layout.size, len(speed)))
    curved = layout.factors.start - 1
    rows[0] = speed
    rows[1 : 1 + curved] = slopes[:curved]
    # What multiplies all commands of a stretch multiplies its speeds.
    scaling = [_contrast_columns(recording.speed_rotor, layout.rotors)]
    if not layout.voltage:
        scaling.append(_contrast_columns(recording.speed_flight, layout.flights))
        owned = recording.speed_flight == np.arange(layout.flights)[:, None]
        np.multiply(owned, slopes[curved], out=rows[layout.drifts])
        curved += 1
    np.multiply(np.concatenate(scaling), speed, out=rows[layout.factors])
    rows[layout.drifts.stop :] = slopes[curved:]
    return rows


def _follow_lag(
    recording: Recording,
    layout: Layout,
    x: Float[np.ndarray, " p"],
    settled: Float[np.ndarray, " n"],
    bent: Float[np.ndarray, "q n"],
) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, "r m"]]:
    """Follow settled speeds by a lag that acts on the speed or on its square, with the slopes."""
    timing, two_way = timing_of(layout, x), layout.two_way
    if not layout.on_thrust:
        return speed_response(recording, settled, bent, timing, two_way=two_way)
    square, slopes = speed_response(
        recording, settled**2, 2.0 * settled * bent, timing, two_way=two_way
    )
    speed = np.sqrt(np.maximum(square, TINY))
    return speed, 0.5 * slopes / speed


def _contrast_columns(member: Int[np.ndarray, " n"], count: int) -> Float[np.ndarray, "c n"]:
    """Build rows of factors whose logarithms sum to zero: the last has what the others lack."""
    rows = np.hstack([np.eye(count - 1), -np.ones((count - 1, 1))])
    return np.take(rows, member, axis=1)
