"""Find where the accelerometer is from the centre of mass, where the joint fit cannot.

A turn moves an accelerometer that is beside the centre of mass: m alpha + dw x ms + w x (w x ms) is
the force of the rotors, ms the first moments from the accelerometer. The joint fit takes dw from
the rotors' torques. Where the accelerometer is so smoothed that it ends below the frequencies at
which rotors explain turns (accelerations of a motion capture), that dw is mostly the air's, and
the fit finds the centre of mass at the accelerometer, wherever that is. The measured dw shows it.
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.findings import Evidence, Finding, doubt
from rotorfit.fit.experiment.airframe_table import ImuEntry
from rotorfit.fit.experiment.declared_vehicle import vehicle_of
from rotorfit.fit.joint.joint_problem import COM_HEIGHT
from rotorfit.fit.reduction.bandwidth import ON_BOARD, SHAPES
from rotorfit.fit.reduction.frequency_bands import PILOT_BAND, retimed
from rotorfit.fit.timing.sensor_bandwidth import PLACES, flight_reach
from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.model.parameters import FIRST_MOMENTS
from rotorfit.model.regressor import regressor
from rotorfit.model.signals import signal_matrix
from rotorfit.model.terms.rotors import DRAG_OF_ROTORS

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from jaxtyping import Float

    from rotorfit.fit.dataset.dataset import LoadedFlight
    from rotorfit.fit.experiment.experiment import Experiment
    from rotorfit.fit.reduction.bandwidth import Bandwidth
    from rotorfit.fit.timing.timed_dataset import TimedDataset

    Window = tuple[Float[np.ndarray, "l 3 q"], Float[np.ndarray, "l 3"]]
    """Lines of the force equations of a window."""

WINDOW: Final = 4.0
"""Length of the windows of a flight, whose scatter gives the deviation [s]."""
LOWEST: Final = 1.0
"""Frequency below which errors of the attitude and of the air outweigh the turn's part [Hz]."""
LEAST_FRACTION: Final = 0.1
"""Least distance from the centre of mass that matters, over the arm."""
LEAST_DEVIATIONS: Final = 5.0
"""The same over its deviation."""
FORM_ERROR: Final = 0.1
"""Share of the distance by which it may be off beyond chance: the filter of the accelerometer is
not quite known."""
COM_HEIGHT_STD: Final = 0.2
"""Usual deviation of the centre of mass's height over the rotors, over the arm: batteries under the
frame or on top of it."""
LEAST_EXPLAINED: Final = 0.2
"""Least share of what the rotors leave of the forces that the place explains."""
FREE: Final = ("kt", "rotor_drag", "inflow", *FIRST_MOMENTS)
FORCES: Final = slice(0, 3)
FEWEST_WINDOWS: Final = 4
PASSES: Final = 4
TINY: Final = 1e-9
UNSHOWN: Final = (
    "the accelerometer ends below the frequencies at which the rotors explain turns: the height of "
    "the CoM over the rotors cannot be told from the air's torques"
)


@frozen_dataclass
class SensorPlace:
    """Where the accelerometer is from the centre of mass, FLU [m].

    - `position`, `std`: along each axis, with the deviation by the scatter of the windows.
    - `explained`: share of what the rotors leave of the forces that it explains, 1 to 3 Hz or so.
    """

    position: Float[np.ndarray, " 3"]
    std: Float[np.ndarray, " 3"]
    explained: float

    @property
    def distance(self) -> float:
        """Distance from the centre of mass [m]."""
        return float(np.linalg.norm(self.position))

    @property
    def position_std(self) -> float:
        """Deviation of a coordinate, with the error of the form [m]."""
        return float(np.hypot(np.sqrt(np.mean(self.std**2)), FORM_ERROR * self.distance))


def place_sensor(
    experiment: Experiment, dataset: TimedDataset
) -> tuple[Experiment, TimedDataset, tuple[Finding, ...]]:
    """Declare the place of the accelerometer where it is unknown and the flights show it alone."""
    if experiment.airframe.imu is not None or not has_separate_bands(dataset):
        return experiment, dataset, ()
    place = measure_place(dataset)
    if place is None or not is_off_centre(place, dataset.vehicle.arm):
        return experiment, dataset, ()
    x, y, z = np.round(place.position, 4).tolist()
    flip = 1.0 if experiment.airframe.axes == "FLU" else -1.0
    entry = ImuEntry(position=(x, flip * y, flip * z), position_std=place.position_std)
    airframe = experiment.airframe.model_copy(update={"imu": entry})
    experiment = experiment.model_copy(update={"airframe": airframe})
    vehicle = vehicle_of(airframe, dataset.source)
    held = {COM_HEIGHT: COM_HEIGHT_STD * vehicle.arm}
    vehicle = dataclasses.replace(vehicle, tolerances={**vehicle.tolerances, **held})
    model = regressor(vehicle, added=dataset.model.layout.added)
    moved = dataclasses.replace(dataset, vehicle=vehicle, model=model)
    return experiment, moved, (_describe_place(place),)


def has_separate_bands(dataset: TimedDataset) -> bool:
    """Return whether every accelerometer ends below the bands in which rotors explain turns."""
    flights = dataset.flights
    return (
        dataset.source == "imu"
        and len(dataset.configurations) == 1
        and DRAG_OF_ROTORS in dataset.model.layout.added
        and all(is_smoothed(f.bandwidths.get("accel")) for f in flights)
        and all(flight_reach(f)[PLACES["accel"]].max() < PILOT_BAND[1] for f in flights)
    )


def is_smoothed(found: Bandwidth | None) -> bool:
    """Return whether an acceleration is smoothed without delay: made of a motion capture."""
    # A low-pass on board is of an IMU, which sits near the centre of the rotors; and its delay is
    # not known well enough.
    return found is not None and found.shape not in ON_BOARD


def is_off_centre(place: SensorPlace, arm: float) -> bool:
    """Return whether the accelerometer is surely beside the centre of mass."""
    sure = float(np.linalg.norm(place.position / place.std)) > LEAST_DEVIATIONS
    return sure and place.distance > LEAST_FRACTION * arm and place.explained > LEAST_EXPLAINED


def measure_place(dataset: TimedDataset) -> SensorPlace | None:
    """Regress the forces of all flights on the measured turns; None where the flights are short.

    Each axis of each window counts by the variance that the pass before leaves. The deviation is
    that of a jackknife over the windows.
    """
    (configuration,) = dataset.configurations
    windows = [w for flight in configuration.flights for w in _force_lines(dataset, flight)]
    free = tuple(name for name in FREE if name in dataset.model.names)
    if len(windows) < FEWEST_WINDOWS:
        return None
    # Columns of order one: their units are of very different sizes.
    scale = np.sqrt(np.sum([(X**2).sum(axis=(0, 1)) for X, _ in windows], axis=0))
    if not (scale > 0.0).all():
        return None
    squares, shared, power = _weighed_equations([(X / scale, y) for X, y in windows])
    H, asked = squares.sum(axis=0), shared.sum(axis=0)
    own = [free.index(name) for name in FIRST_MOMENTS]
    rest = [k for k in range(len(free)) if k not in own]
    others: Float[np.ndarray, "w q"] = np.array(
        [_solve_normal(H - S, asked - c) for S, c in zip(squares, shared, strict=True)]
    )[:, own]
    metres = scale[own] * configuration.mass
    scatter: Float[np.ndarray, " 3"] = len(windows) * np.var(others, axis=0)
    without = power - float(asked[rest] @ _solve_normal(H[np.ix_(rest, rest)], asked[rest]))
    return SensorPlace(
        position=-_solve_normal(H, asked)[own] / metres,
        std=np.sqrt((1.0 - 1.0 / len(windows)) * scatter) / metres,
        explained=1.0 - (power - float(asked @ _solve_normal(H, asked))) / without,
    )


def _force_lines(dataset: TimedDataset, flight: LoadedFlight) -> Iterator[Window]:
    """Yield lines of the force equations of each window: columns of `FREE`, and mass times force.

    All but the accelerometer go behind its low-pass, which leaves the equations exact.
    """
    data, model = retimed(flight.prepared, dataset.timing), dataset.model
    free = tuple(name for name in FREE if name in model.names)
    found = flight.bandwidths["accel"]
    count = round(WINDOW * data.sample_rate)
    frequency = np.fft.rfftfreq(count, 1.0 / data.sample_rate)
    kept = np.flatnonzero((frequency >= LOWEST) & (frequency <= found.cutoff))
    gain = np.ones((len(kept), len(model.layout)), dtype=complex)
    gain *= SHAPES[found.shape](frequency[kept] / found.cutoff)[:, None]
    gain[:, [model.layout.index(name) for name in ("ax", "ay", "az")]] = 1.0
    taper = np.hanning(count)[:, None]
    for segment in data.segments:
        for start in range(segment.start, segment.stop - count + 1, count // 2):
            Z = signal_matrix(data, dataset.vehicle, start, start + count, added=model.layout.added)
            lines = gain * np.fft.rfft((Z - Z.mean(axis=0)) * taper, axis=0)[kept]
            rows = np.vstack([lines.real, lines.imag])
            mass = dataset.configurations[0].mass * model.rows(rows, ("mass",))[:, FORCES, 0]
            yield model.rows(rows, free)[:, FORCES], -mass


def _weighed_equations(
    windows: Sequence[Window],
) -> tuple[Float[np.ndarray, "w q q"], Float[np.ndarray, "w q"], float]:
    """Compute the normal equations of each window, and the squares of all that is explained."""
    count = int(windows[0][0].shape[2])
    theta: Float[np.ndarray, " q"] = np.zeros(count)
    squares: Float[np.ndarray, "w q q"] = np.zeros((0, count, count))
    shared: Float[np.ndarray, "w q"] = np.zeros((0, count))
    power = 0.0
    for _ in range(PASSES):
        pairs = [(X, y, _inverse_squares(y - X @ theta)) for X, y in windows]
        squares = np.array([np.einsum("lak,laj,a->kj", X, X, w) for X, _, w in pairs])
        shared = np.array([np.einsum("lak,la,a->k", X, y, w) for X, y, w in pairs])
        power = sum(float(((y**2) @ w).sum()) for _, y, w in pairs)
        theta = _solve_normal(squares.sum(axis=0), shared.sum(axis=0))
    return squares, shared, power


def _solve_normal(
    squares: Float[np.ndarray, "q q"], shared: Float[np.ndarray, " q"]
) -> Float[np.ndarray, " q"]:
    found: Float[np.ndarray, " q"] = np.asarray(np.linalg.solve(squares, shared))
    return found


def _inverse_squares(left: Float[np.ndarray, "l 3"]) -> Float[np.ndarray, " 3"]:
    """Return the inverse of the mean square of each axis."""
    mean: Float[np.ndarray, " 3"] = np.mean(left**2, axis=0)
    return 1.0 / np.maximum(mean, TINY)


def _describe_place(place: SensorPlace) -> Finding:
    x, y, z = place.position.tolist()
    words = (
        f"{abs(x) * 1e3:.0f} mm {'before' if x > 0.0 else 'behind'}, "
        f"{abs(y) * 1e3:.0f} mm {'left' if y > 0.0 else 'right'} of and "
        f"{abs(z) * 1e3:.0f} mm {'above' if z > 0.0 else 'below'}"
    )
    return doubt(
        "sensor-place",
        f"the logged acceleration is of a point {words} the centre of mass: turns move it so. "
        "rotorfit takes the place as measured; declare it under [airframe] "
        f"(imu = {{ position = [{x:.3f}, {y:.3f}, {z:.3f}] }})",
        numbers=("com_z", "msz"),
        evidence=(
            Evidence(name="sensor_distance", value=place.distance),
            Evidence(name="sensor_place_explains", value=place.explained),
        ),
        withheld_because=UNSHOWN,
    )
