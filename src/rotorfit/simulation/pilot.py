"""The pilot: band-limited sticks, manoeuvres, and the plan of a flight from ground to ground."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final, Literal, NamedTuple

import numpy as np

from rotorfit.errors import ExperimentError
from rotorfit.frozen_dataclass import frozen_dataclass

if TYPE_CHECKING:
    from collections.abc import Mapping

    from jaxtyping import Float

SPOOL_SECONDS: Final = 1.0
CLIMB_SECONDS: Final = 4.0
LAND_SECONDS: Final = 5.0
FLIGHT_HEIGHT: Final = 1.0
FADE_SECONDS: Final = 1.0
COURSE_FADE_SECONDS: Final = 3.0
EDGE_SECONDS: Final = 0.5
"""How long a pilot takes from one side to the other of a turn."""

Shape = Literal["noise", "turns", "doublets"]


@frozen_dataclass
class Stick:
    """One stick of the pilot.

    - `band`: lowest and highest frequency of its movement [Hz].
    - `rms`: of its movement, in the unit of what it commands.
    - `shape`: ``"noise"``: anything within the band. ``"turns"``: to one side and to the other,
      half a period of the band's lowest frequency each. ``"doublets"``: out and back to the other
      side within a period of the highest frequency, again after each period of the lowest.
    """

    band: tuple[float, float]
    rms: float
    shape: Shape = "noise"


@frozen_dataclass
class Sticks:
    """The pilot's four sticks; the defaults fill a hall of 6 x 4 x 4 m.

    - `roll`, `pitch`: angles in the heading's axes [rad].
    - `yaw`: rate about the vertical [rad/s].
    - `climb`: vertical acceleration [m/s^2].
    """

    roll: Stick = Stick(band=(0.2, 1.3), rms=0.16)
    pitch: Stick = Stick(band=(0.2, 1.1), rms=0.12)
    yaw: Stick = Stick(band=(0.1, 0.6), rms=0.35)
    climb: Stick = Stick(band=(0.3, 1.5), rms=1.3)


STILL: Final = Sticks(
    roll=Stick(band=(0.2, 1.3), rms=0.0),
    pitch=Stick(band=(0.2, 1.1), rms=0.0),
    yaw=Stick(band=(0.1, 0.6), rms=0.0),
    climb=Stick(band=(0.3, 1.5), rms=0.0),
)
"""Hands off: hover."""


Route = Literal["to-and-fro", "circles", "eights"]


@frozen_dataclass
class Course:
    """A course over ground that is flown fast, next to what the sticks do.

    - `route`: ``"to-and-fro"``: along world x. ``"circles"``: to the left. ``"eights"``: to
      alternate sides.
    - `speed`: the largest, over ground [m/s].
    - `size`: half of a straight or radius of a circle [m].
    - `lean`: acceleration for which the pilot leans against the drag, per speed [1/s].
    """

    route: Route
    speed: float
    size: float
    lean: float = 0.5


class Reference(NamedTuple):
    """What the pilot asks for at one instant.

    - `roll`, `pitch`, `yaw_rate`, `climb`: the sticks, see `Sticks`.
    - `height`, `height_rate`: where the origin should be above the start, and how fast it should
      rise [m, m/s].
    - `throttle`: factor of the thrust: 0 with the motors off, 1 in flight, between in spooling up.
    - `landing`: 1 from the end of the flight on: touching the ground stops the motors.
    - `x`, `y`, `velocity_x`, `velocity_y`: where the origin should be, world axes from the start
      [m], and its velocity [m/s].
    - `push_x`, `push_y`: horizontal acceleration for which the pilot leans in advance [m/s^2].
    """

    roll: float
    pitch: float
    yaw_rate: float
    climb: float
    height: float
    height_rate: float
    throttle: float
    landing: float
    x: float = 0.0
    y: float = 0.0
    velocity_x: float = 0.0
    velocity_y: float = 0.0
    push_x: float = 0.0
    push_y: float = 0.0


def plan_flight(
    sticks: Sticks,
    *,
    seconds: float,
    ground_seconds: float,
    sample_rate: float,
    rng: np.random.Generator,
    course: Course | None = None,
) -> list[Reference]:
    """Plan the pilot's references at each sample, with rest on the ground before and after [s]."""
    rows = plan_rows(
        sticks, seconds=seconds, ground_seconds=ground_seconds, sample_rate=sample_rate, rng=rng
    )
    if course is None:
        return [Reference(*row) for row in rows.tolist()]
    n = round(seconds * sample_rate)
    before = len(_take_off(ground_seconds, sample_rate)) if ground_seconds > 0 else 0
    along = np.zeros((len(rows), 6))
    along[before : before + n] = follow_course(course, samples=n, sample_rate=sample_rate)
    along[before + n :, :2] = along[before + n - 1, :2]  # it lands where it ends
    return [Reference(*row) for row in np.hstack([rows, along]).tolist()]


def follow_course(course: Course, *, samples: int, sample_rate: float) -> Float[np.ndarray, "n 6"]:
    """Compute place, velocity and push along a course, in the last six columns of `Reference`.

    The phase runs evenly but for the fading in and out, from and to rest.
    """
    time = np.arange(samples) / sample_rate
    edge = np.minimum(np.minimum(time, time[::-1]) / COURSE_FADE_SECONDS, 1.0)
    # Speed of the phase, and the phase by the trapezoidal rule.
    rate = course.speed / (course.size * _LONGEST[course.route]) * np.sin(np.pi / 2 * edge) ** 2
    phase = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) / sample_rate)])
    growth = np.gradient(rate, 1.0 / sample_rate)
    place, slope, bend = (course.size * row for row in _trace_route(course.route, phase))
    velocity = slope * rate[:, None]
    push = bend * rate[:, None] ** 2 + slope * growth[:, None] + course.lean * velocity
    return np.hstack([place, velocity, push])


_LONGEST: Final[Mapping[Route, float]] = {"to-and-fro": 1.0, "circles": 1.0, "eights": 2.0**0.5}
"""The largest slope of each route of size 1."""


def _trace_route(
    route: Route, phase: Float[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "n 2"], Float[np.ndarray, "n 2"]]:
    """Return the places of a route of size 1, and their first and second derivative by phase."""
    s, c, none = np.sin(phase), np.cos(phase), np.zeros_like(phase)
    match route:
        case "to-and-fro":
            rows = (s, none), (c, none), (-s, none)
        case "circles":
            rows = (s, 1.0 - c), (c, s), (-s, c)
        case "eights":
            twice, other = np.sin(2.0 * phase), np.cos(2.0 * phase)
            rows = (s, 0.5 * twice), (c, other), (-s, -2.0 * twice)
    place, slope, bend = (np.column_stack(row) for row in rows)
    return place, slope, bend


def plan_rows(
    sticks: Sticks,
    *,
    seconds: float,
    ground_seconds: float,
    sample_rate: float,
    rng: np.random.Generator,
) -> Float[np.ndarray, "n 8"]:
    """Plan the pilot's references as rows, with the columns of `Reference`."""
    n = round(seconds * sample_rate)
    # A generator for each stick, so that changing one leaves the others as they were.
    moved = [
        movement(stick, samples=n, sample_rate=sample_rate, rng=child)
        for stick, child in zip(
            (sticks.roll, sticks.pitch, sticks.yaw, sticks.climb), rng.spawn(4), strict=True
        )
    ]
    flown = np.column_stack([*moved, np.zeros((n, 2)), np.ones(n), np.zeros(n)])
    if ground_seconds > 0:
        before, after = (
            _take_off(ground_seconds, sample_rate),
            _plan_landing(ground_seconds, sample_rate),
        )
        flown[:, 4] = FLIGHT_HEIGHT
        flown = np.vstack([before, flown, after])
    return flown


def movement(
    stick: Stick, *, samples: int, sample_rate: float, rng: np.random.Generator
) -> Float[np.ndarray, " n"]:
    """Generate the movement of a stick, faded in and out, at its root mean square."""
    time = np.arange(samples) / sample_rate
    match stick.shape:
        case "noise":
            moved = _band_noise(stick, samples=samples, sample_rate=sample_rate, rng=rng)
        case "turns":
            moved = _alternate_turns(time, stick.band[0])
        case "doublets":
            moved = _sine_doublets(time + rng.uniform(0.0, 1.0 / stick.band[0]), stick.band)
    edge = np.minimum(time, time[::-1]) / FADE_SECONDS
    moved = moved * np.sin(np.pi / 2 * np.minimum(edge, 1.0)) ** 2
    rms = float(np.sqrt(np.mean(moved**2)))
    if rms == 0.0:
        raise ExperimentError(
            f"a flight of {samples / sample_rate:g} s is too short for a stick between "
            f"{stick.band[0]:g} and {stick.band[1]:g} Hz: fly longer"
        )
    return moved * (stick.rms / rms)


def _band_noise(
    stick: Stick, *, samples: int, sample_rate: float, rng: np.random.Generator
) -> Float[np.ndarray, " n"]:
    """Generate Gaussian noise of a flat spectrum within a band; zeros if it holds no line."""
    frequency = np.fft.rfftfreq(samples, 1 / sample_rate)
    inside = (frequency >= stick.band[0]) & (frequency <= stick.band[1])
    spectrum = rng.normal(size=(2, frequency.size)) * inside
    return np.fft.irfft(spectrum[0] + 1j * spectrum[1], samples)


def _alternate_turns(time: Float[np.ndarray, " n"], frequency: float) -> Float[np.ndarray, " n"]:
    """Alternate +1 and -1, with ramps between them."""
    # A triangle wave, cut off where a ramp should end.
    phase = time * frequency
    triangle = 1.0 - 4.0 * np.abs((phase + 0.25) % 1.0 - 0.5)
    return np.clip(triangle / (2.0 * EDGE_SECONDS * frequency), -1.0, 1.0)


def _sine_doublets(
    time: Float[np.ndarray, " n"], band: tuple[float, float]
) -> Float[np.ndarray, " n"]:
    """Generate whole sine periods of the highest frequency with rests between them."""
    since = time % (1.0 / band[0])
    return np.where(since * band[1] < 1.0, np.sin(2.0 * np.pi * band[1] * since), 0.0)


def _take_off(ground_seconds: float, sample_rate: float) -> Float[np.ndarray, "n 8"]:
    """Plan rest, spooling up and climbing to the height of the flight."""
    t = np.arange(round((ground_seconds + SPOOL_SECONDS + CLIMB_SECONDS) * sample_rate))
    t = t / sample_rate - ground_seconds
    climb = np.clip((t - SPOOL_SECONDS) / (CLIMB_SECONDS - 1.0), 0.0, 1.0)
    rows = np.zeros((t.size, 8))
    rows[:, 4] = FLIGHT_HEIGHT * climb
    rows[:, 5] = np.where((climb > 0) & (climb < 1), FLIGHT_HEIGHT / (CLIMB_SECONDS - 1.0), 0.0)
    rows[:, 6] = np.clip(t / SPOOL_SECONDS, 0.0, 1.0)
    return rows


def _plan_landing(ground_seconds: float, sample_rate: float) -> Float[np.ndarray, "n 8"]:
    """Plan a descent through the ground, and rest."""
    t = np.arange(round((LAND_SECONDS + ground_seconds) * sample_rate)) / sample_rate
    rate = 2 * FLIGHT_HEIGHT / LAND_SECONDS  # the ground is met half-way
    rows = np.zeros((t.size, 8))
    rows[:, 4] = FLIGHT_HEIGHT - rate * t
    rows[:, 5] = -rate
    rows[:, 6] = t < LAND_SECONDS
    rows[:, 7] = 1.0
    return rows


Manoeuvre = Literal[
    "hover", "roll", "pitch", "yaw", "climb", "sticks", "doublets", "wiggles", "turns"
]

_FREE: Final = Sticks()
_GENTLE_CLIMB: Final = Stick(band=(0.3, 1.5), rms=0.8)

MANOEUVRES: Final[Mapping[Manoeuvre, Sticks]] = {
    "hover": STILL,
    "roll": replace(STILL, roll=_FREE.roll),
    "pitch": replace(STILL, pitch=_FREE.pitch),
    "yaw": replace(STILL, yaw=_FREE.yaw),
    "climb": replace(STILL, climb=_FREE.climb),
    "sticks": _FREE,
    "doublets": Sticks(
        roll=Stick(band=(0.4, 1.2), rms=0.13, shape="doublets"),
        pitch=Stick(band=(0.35, 1.2), rms=0.12, shape="doublets"),
        yaw=Stick(band=(0.2, 0.5), rms=0.45, shape="doublets"),
        climb=_GENTLE_CLIMB,
    ),
    "wiggles": Sticks(
        roll=Stick(band=(1.0, 2.0), rms=0.13),
        pitch=Stick(band=(1.0, 2.0), rms=0.11),
        yaw=Stick(band=(0.1, 0.6), rms=0.5, shape="turns"),
        climb=_GENTLE_CLIMB,
    ),
    "turns": Sticks(
        roll=Stick(band=(0.3, 1.3), rms=0.16),
        pitch=Stick(band=(0.3, 1.2), rms=0.14),
        yaw=Stick(band=(0.1, 0.6), rms=1.2, shape="turns"),
        climb=_GENTLE_CLIMB,
    ),
}
"""``hover``: hands off. ``roll``, ``pitch``, ``yaw``, ``climb``: that stick alone. ``sticks``: all
four at once, as a pilot who fills a hall of 6 x 4 m. ``doublets``: short kicks out and back.
``wiggles``: roll and pitch once or twice a second during slow turns to alternating sides, 5 s each.
``turns``: turns at 1.2 rad/s to alternating sides, 5 s each, while rolling and pitching."""
