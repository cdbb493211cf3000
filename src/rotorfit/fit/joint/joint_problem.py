"""All equations of all configurations at once: the parameter map of the default estimator.

Free parameters: kt, kd, Jr, one spread per rotor or group of rotors (all shared); and per
configuration the first moments, the inertia at the origin, the accelerometer's bias, the twist of
the motors, drag and a constant torque where those terms are asked for, and, where the IMU's place
is unknown and so is the origin itself, the centre of the rotors. The names of a configuration's
parameters end in ``@`` and its name.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from rotorfit.errors import EstimationError
from rotorfit.estimation.banded import (
    SMALLEST_STEP,
    BandedEstimate,
    BandedProblem,
    banded,
    log_likelihood,
)
from rotorfit.estimation.banded_problem import LateErrors
from rotorfit.estimation.factors import flights_of, of_even_rows
from rotorfit.estimation.feedback import ClosedLoopResponses, Feedback
from rotorfit.fit.experiment.payload import tolerances
from rotorfit.fit.joint.joint_map import JointConfiguration as JointConfiguration
from rotorfit.fit.joint.joint_map import force_delay_names, joint_map
from rotorfit.fit.joint.trims import (
    are_trims,
    trim_prior,
    with_trims,
)
from rotorfit.fit.row_fits import RowFits, fit_rows
from rotorfit.model.terms.registry import DEFAULT_TERMS, TERMS
from rotorfit.model.terms.rotors import DRAG_OF_ROTORS, spread_std
from rotorfit.model.terms.term import Size

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

    from jaxtyping import Bool, Complex, Float, Int

    from rotorfit.estimation.parameter_map import ParameterMap
    from rotorfit.fit.reduction.motor_timing import FreeTiming
    from rotorfit.flight.motors.motor_model import MotorResponse
    from rotorfit.model.vehicle import Vehicle

NOISY = ("ax", "ay", "az", "dwx", "dwy", "dwz")
"""The signals that carry the noise: what accelerometer and gyro measure."""
FORCE_ERRORS = (0, 1, 2)
"""Places of the errors of the forces among those."""
TURN_ERRORS = ("dwx", "dwy", "dwz")
"""The errors of the turns, to which an autopilot responds."""
RESPONSE_ERRORS = (*TURN_ERRORS, "az")
"""Those, and the error of the climb for an altitude hold: its accelerometer's noise, too."""
BANDWIDTH = 25.0
"""[rad/s] up to which an autopilot responds to roll and pitch errors: as the simulated rate loops,
and usual ones."""
ATTITUDE = 6.0
"""Rate per angle that an attitude loop asks for [1/s]: 6.5 in PX4 and 4.5 in ArduPilot by default.
Such a loop delays the response; not every pilot flies with one."""
YAW_BANDWIDTH = 3.0
"""[rad/s], of yaw errors: PX4 and ArduCopter by default, others are quicker."""
CLIMB_BANDWIDTH = 4.0
"""[rad/s] up to which an altitude hold responds to climb errors: PX4 by default, ArduCopter 5."""
SLOW_YAW = 0.3
"""[Hz] up to which that is taken for granted: every autopilot does so. Its response further up
depends on its gains, on filters and on the rotors' reaction."""
COM_HEIGHT: Final = "CoM height"
"""Interval term, and tolerance of a vehicle, of a CoM whose height the flights cannot show [m]."""
HELD_STD: Final = 1e-4
"""Deviation at which such a CoM is held at the height of the origin [m]."""
PUSHED_STD = 1.0
"""Known of how far an acceleration from without, over the arm, turns a vehicle: of a body whose
radius of gyration is half its arm, pushed a quarter of an arm beside its centre of mass."""


def joint_estimate(
    configurations: Sequence[JointConfiguration],
    starts: Sequence[RowFits],
    *,
    known: Mapping[str, tuple[float, float]] | None = None,
    terms: Collection[str] = DEFAULT_TERMS,
    begin: Mapping[str, float] | None = None,
    close: float = SMALLEST_STEP,
) -> BandedEstimate:
    """Estimate all configurations together.

    - `configurations`: their factors per stretch and frequency band.
    - `starts`: the row fits of each, from which the iteration begins, or from those of the
      liveliest flight for each row where that is likelier; empty if `begin` has all values.
    - `known`: mean and standard deviation of free parameters from elsewhere, by name.
    - `terms`: optional terms of the model.
    - `begin`: better values to begin with, of free parameters that have them.
    - `close`: the iteration ends when no parameter moves by more than this share of its deviation.
    """
    problem = joint_problem(configurations, known=known, terms=terms)
    start = np.zeros(len(problem.map.names))
    if starts:
        start = _likeliest_start(problem, configurations, starts)
    return banded(problem, at_values(problem, begin or {}, start), close=close)


def at_values(
    problem: BandedProblem, known: Mapping[str, float], rest: Float[np.ndarray, " f"]
) -> Float[np.ndarray, " f"]:
    """Return the free parameters, known ones by their names and the rest as given."""
    names = problem.map.names
    return np.array([known.get(n, s) for n, s in zip(names, rest.tolist(), strict=True)])


def _likeliest_start(
    problem: BandedProblem, configurations: Sequence[JointConfiguration], starts: Sequence[RowFits]
) -> Float[np.ndarray, " f"]:
    """Select the better of two starts: every row from all flights, or from its liveliest one."""
    # Flights in which an axis is calm bias its row fit towards no response at all, and an iteration
    # that begins there may end there.
    lively = [liveliest_rows(c, rows) for c, rows in zip(configurations, starts, strict=True)]
    options = [joint_start(problem.map, configurations, rows) for rows in (starts, lively)]
    return max(options, key=lambda start: log_likelihood(problem, start))


def liveliest_rows(configuration: JointConfiguration, rows: RowFits) -> RowFits:
    """Return the row fits, each of roll, pitch and yaw from the flight that moves it most."""
    factors, source = configuration.factors, configuration.factors.source
    if source is None or len(np.unique(source)) < 2:
        return rows
    best, fits = dict(rows.excitation), dict(rows.fits)
    for number in np.unique(source):
        try:
            one = fit_rows(
                factors.select(source == number), configuration.model, mass=configuration.mass
            )
        except EstimationError:
            continue  # too short or too still to be informative by itself
        for row in best:
            if one.excitation[row] > best[row]:
                best[row], fits[row] = one.excitation[row], one.fits[row]
    return replace(rows, fits=fits)


def joint_problem(
    configurations: Sequence[JointConfiguration],
    *,
    known: Mapping[str, tuple[float, float]] | None = None,
    terms: Collection[str] = DEFAULT_TERMS,
    of_many: bool = False,
) -> BandedProblem:
    """Return the problem that `joint_estimate` solves: a theta for each of `separate_flights`.

    `of_many`: a flight that is alone here is one of many elsewhere, from which it differs.
    """
    owners, flights = separate_flights(configurations)
    counts = [
        [len(f.factors) for o, f in zip(owners, flights, strict=True) if o == c]
        for c in range(len(configurations))
    ]
    layout = configurations[0].model.layout
    mapped = joint_map(configurations, terms=terms)
    masses = [f.mass for f in flights]
    names = configurations[0].model.names
    mapped = with_trims(mapped, names, owners, masses, of_many=of_many)
    prior = joint_prior(configurations)
    moments = [f.mass * f.vehicle.arm for f in flights]
    prior |= trim_prior(mapped, [f.scatter for f in flights], moments)
    timing = configurations[0].timing
    forces = force_delay_names(configurations)
    known = {**(known or {}), **({} if timing is None else timing.prior(forces))}
    return BandedProblem(
        factors=of_even_rows([c.factors for c in configurations]),
        tensors=tuple(c.model.tensor for c in configurations),
        parts=tuple(tuple(own) for own in counts),
        map=mapped,
        noisy=tuple(layout.index(name) for name in NOISY),
        prior_mean={**prior_means(configurations), **{n: mean for n, (mean, _) in known.items()}},
        prior_std={**prior, **{name: std for name, (_, std) in known.items()}},
        moving=() if timing is None else timing.names,
        late=() if timing is None else _late_forces(timing, forces),
        counted=tuple(c.counted for c in configurations if c.counted is not None),
        error_correlation=tuple(
            c.error_correlation for c in configurations if c.error_correlation is not None
        ),
        error_correlation_std=tuple(
            error_correlation_std(c.vehicle)
            for c in configurations
            if c.error_correlation is not None
        ),
        feedback=_collect_feedback(flights),
    )


def _late_forces(timing: FreeTiming, names: Sequence[str]) -> tuple[LateErrors, ...]:
    """Return the delays of each flight's forces, by these names: beside that of the motors."""
    slope = timing.delay_slope
    if slope is None:
        return ()
    return tuple(
        LateErrors(name=name, part=k, errors=FORCE_ERRORS, slope=slope)
        for k, name in enumerate(names)
    )


def separate_flights(
    configurations: Sequence[JointConfiguration],
) -> tuple[list[int], list[JointConfiguration]]:
    """Return each flight with its configuration's place."""
    owners: list[int] = []
    flights: list[JointConfiguration] = []
    for place, c in enumerate(configurations):
        parts = flights_of(c.factors)
        owners += [place] * len(parts)
        flights += [c] if len(parts) == 1 else [only(c, own) for own in parts]
    return owners, flights


def only(configuration: JointConfiguration, blocks: Bool[np.ndarray, " b"]) -> JointConfiguration:
    """Return some blocks of a configuration."""
    counted, with_response = configuration.counted, configuration.with_response
    reach = configuration.reach
    return replace(
        configuration,
        factors=configuration.factors.select(blocks),
        counted=None if counted is None else counted[blocks],
        with_response=None if with_response is None else with_response[blocks],
        reach=None if reach is None else reach[blocks],
    )


def theta_of(
    fit_map: ParameterMap,
    phi: Float[np.ndarray, " f"],
    configurations: Sequence[JointConfiguration],
) -> Float[np.ndarray, "c p"]:
    """Return theta of every configuration: of its flights, without their trims."""
    without_trims = np.where(are_trims(fit_map), 0.0, phi)
    return fit_map.theta(without_trims)[_first_flights(configurations)]


def theta_jacobian(
    fit_map: ParameterMap,
    phi: Float[np.ndarray, " f"],
    configurations: Sequence[JointConfiguration],
) -> Float[np.ndarray, "c p f"]:
    """Differentiate `theta_of` by the free parameters; trims have no part in it."""
    trims = are_trims(fit_map)
    jacobian = fit_map.jacobian(np.where(trims, 0.0, phi))[_first_flights(configurations)]
    jacobian[:, :, trims] = 0.0
    return jacobian


def _first_flights(configurations: Sequence[JointConfiguration]) -> Int[np.ndarray, " c"]:
    """Return where the first flight of each configuration stands in a map to all flights."""
    counts = [len(flights_of(c.factors)) for c in configurations]
    return np.cumsum([0, *counts[:-1]])


def _collect_feedback(configurations: Sequence[JointConfiguration]) -> Feedback | None:
    """Collect where the autopilot responds by the rotors; None if that is not known."""
    if any(c.with_response is None for c in configurations):
        return None
    layout = configurations[0].model.layout
    inputs = [i for i, name in enumerate(layout.names) if name.startswith("O2_")]
    inputs.append(layout.index("dHz"))
    return Feedback(
        errors=tuple(NOISY.index(name) for name in RESPONSE_ERRORS),
        inputs=tuple(inputs),
        responses=tuple(closed_loop_responses(c) for c in configurations),
    )


def closed_loop_responses(configuration: JointConfiguration) -> ClosedLoopResponses:
    """Compute the autopilot's responses to roll, pitch, yaw and climb errors in every block."""
    factors, counted = configuration.factors, configuration.counted
    with_response = configuration.with_response
    assert with_response is not None and counted is not None
    turn = 2.0 * np.pi * factors.band.mean(axis=1)
    counted_errors = counted[:, [NOISY.index(name) for name in RESPONSE_ERRORS]]
    moving = factors.rows - (factors.band[:, 0] == 0.0)  # trim is nobody's answer
    rate, climb = nominal_response(turn), first_order(turn, CLIMB_BANDWIDTH)
    slow_yaw = (turn < 2.0 * np.pi * SLOW_YAW) * first_order(turn, YAW_BANDWIDTH)
    usual = np.stack([rate, rate, rate, climb], axis=1)
    taken = np.stack([rate, rate, slow_yaw, climb], axis=1)
    taken[:, : len(TURN_ERRORS)] *= with_response
    return ClosedLoopResponses(
        rows=moving[:, None] * counted_errors,
        moves=_mixed_rotors(configuration, turn),
        complementary_sensitivity=taken + usual * np.array(configuration.response.beyond),
        uncertainty=usual * np.array(configuration.response.open),
        log_effect_slopes=_slopes_by_times(configuration.timing, turn),
    )


def _slopes_by_times(
    timing: FreeTiming | None, turn: Float[np.ndarray, " b"]
) -> Complex[np.ndarray, "b e t"]:
    """Return the slopes by the times for each error: only turns show them, as pilots hold climbs.

    The delay of the forces is the last; an altitude hold answers them as they come.
    """
    if timing is None:
        return np.zeros((len(turn), len(RESPONSE_ERRORS), 0), dtype=complex)
    late = [lateness(name, turn, timing.at)[:, None] for name in timing.names]
    count = len(late) + (timing.force_std is not None)
    slopes = np.zeros((len(turn), len(RESPONSE_ERRORS), count), dtype=complex)
    for place, slope in enumerate(late):
        slopes[:, : len(TURN_ERRORS), place] = slope
    if count > len(late):
        slopes[:, RESPONSE_ERRORS.index("az"), -1] = lateness("motor_delay", turn, timing.at)
    return slopes


def first_order(turn: Float[np.ndarray, " b"], bandwidth: float) -> Complex[np.ndarray, " b"]:
    """Return T of a loop that integrates: L / (1 + L), L = w / s."""
    return bandwidth / (1j * turn + bandwidth)


def nominal_response(turn: Float[np.ndarray, " b"]) -> Complex[np.ndarray, " b"]:
    """Return T of a rate loop inside an attitude loop: L / (1 + L), L = w / s (1 + w_a / s)."""
    s = 1j * turn
    through = BANDWIDTH * (s + ATTITUDE)
    return through / (s**2 + through)


def lateness(
    name: str, turn: Float[np.ndarray, " b"], at: MotorResponse
) -> Complex[np.ndarray, " b"]:
    """Differentiate the logarithm of the motors' response by one of their times."""
    if name == "motor_delay":
        return -1j * turn
    if name == "motor_lag":
        return -1j * turn / (1.0 + 1j * turn * at.mean_lag)
    return np.zeros(len(turn), dtype=complex)


def _mixed_rotors(
    configuration: JointConfiguration, turn: Float[np.ndarray, " b"]
) -> Complex[np.ndarray, "b e u"]:
    """Return how an autopilot moves the rotors to roll, pitch, yaw and climb."""
    vehicle = configuration.vehicle
    torque = vehicle.levers[:, :2].T
    alike = np.ones(len(vehicle.rotors))
    # As the arms, the spins, and all alike, by a unit of squared speed.
    mixer = np.vstack([torque - torque.mean(axis=1, keepdims=True), vehicle.spins, alike])
    squares = np.repeat(mixer[None].astype(complex), len(turn), axis=0)
    speed = (mixer * vehicle.spins / (2.0 * rotor_speeds(configuration))).sum(axis=1)
    spin_up = 1j * turn[:, None] * speed * ("dHx" not in configuration.model.layout)
    return np.concatenate([squares, spin_up[:, :, None]], axis=2)


def joint_prior(configurations: Sequence[JointConfiguration]) -> dict[str, float]:
    """Return the deviations of free parameters that are known before the flight, about zero.

    Of parameters whose sizes go with the rotors' speeds only where something was flown.
    """
    first = configurations[0]
    prior = {f"spread_{i}": spread_std(r) for i, r in enumerate(first.vehicle.rotors, start=1)}
    shared = _known_before("shared", size_of(first))
    prior |= {name: std for name, std in shared.items() if np.isfinite(std)}
    for configuration in configurations:
        at, size = f"@{configuration.name}", size_of(configuration)
        own = _known_before("configuration", size)
        prior |= {f"{name}{at}": std for name, std in own.items()}
        if COM_HEIGHT in configuration.vehicle.tolerances:
            # Held there: what it leaves open is an interval term of its own.
            prior[f"msz{at}"] = configuration.mass * HELD_STD
        prior |= {f"{name}{at}": std for name, std, _ in tolerances(configuration.payload)}
    return prior


def prior_means(configurations: Sequence[JointConfiguration]) -> dict[str, float]:
    """Return the means before the flight of the free parameters for which it is not zero."""
    means: dict[str, float] = {}
    for term in TERMS:
        known = {n: info.prior_mean for n, info in term.parameters.items() if info.prior_mean}
        for c in configurations if term.owner == "configuration" else configurations[:1]:
            at = f"@{c.name}" if term.owner == "configuration" else ""
            sizes = {f"{name}{at}": mean(size_of(c)) for name, mean in known.items()}
            means |= {name: size for name, size in sizes.items() if np.isfinite(size)}
    return means


def _known_before(owner: str, size: Size) -> dict[str, float]:
    """Return the deviations before the flight of the parameters that belong to all, or to one."""
    return {
        name: info.prior(size)
        for term in TERMS
        if term.owner == owner
        for name, info in term.parameters.items()
        if info.prior is not None
    }


def size_of(configuration: JointConfiguration) -> Size:
    """Return the size of a vehicle, with its rotors' speeds where something was flown."""
    flown = len(configuration.factors) > 0
    speeds = float(rotor_speeds(configuration).sum()) if flown else np.nan
    vehicle = configuration.vehicle
    return Size(
        mass=configuration.mass,
        arm=vehicle.arm,
        speeds=speeds,
        disk_area=vehicle.disk_area,
        rotors_dragged=DRAG_OF_ROTORS in configuration.model.layout.added,
    )


def error_correlation_std(vehicle: Vehicle) -> float:
    """Compute the prior deviation of the turn that comes with a push [(rad/s^2) / (m/s^2)]."""
    return PUSHED_STD / vehicle.arm


def rotor_speeds(configuration: JointConfiguration) -> Float[np.ndarray, " N"]:
    """Compute the root mean square of each rotor's speed [rad/s]."""
    factors, layout = configuration.factors, configuration.model.layout
    lowest = factors.R[factors.band[:, 0] == factors.band[:, 0].min()]
    squares = [layout.index(f"O2_{i + 1}") for i in range(len(configuration.vehicle.rotors))]
    one = np.linalg.norm(lowest[:, :, layout.index("one")])
    size: Float[np.ndarray, " N"] = np.linalg.norm(lowest[:, :, squares], axis=(0, 1)) / one
    return np.sqrt(size)


def joint_start(
    mapped: ParameterMap,
    configurations: Sequence[JointConfiguration],
    starts: Sequence[RowFits],
) -> Float[np.ndarray, " f"]:
    """Compute the start of the iteration: the row fits, yaw inertia as of a flat body."""
    kt = float(np.mean([s.fits["force"].estimate.value("kt") for s in starts]))
    values: dict[str, float] = {"kt": kt}
    for configuration, rows in zip(configurations, starts, strict=True):
        if configuration.payload_of is not None:
            continue
        at = f"@{configuration.name}"
        Ixx = kt / rows.fits["roll"].estimate.value("kt")
        Iyy = kt / rows.fits["pitch"].estimate.value("kt")
        yaw = rows.fits["yaw"].estimate
        values |= {f"Ixx{at}": Ixx, f"Iyy{at}": Iyy, f"Izz{at}": Ixx + Iyy}
        values["kd"] = (Ixx + Iyy) * yaw.value("kd")
        values["Jr"] = (Ixx + Iyy) * yaw.value("Jr")
        if "kt_twist" in yaw.names:
            values[f"twist{at}"] = (Ixx + Iyy) * yaw.value("kt_twist") / kt
    return np.array([values.get(name, 0.0) for name in mapped.names])
