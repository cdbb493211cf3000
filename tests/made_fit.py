"""Small made-up problems with known answers: no flight is simulated, nothing is fitted."""

from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np

from rotorfit.estimation.banded import BandedEstimate
from rotorfit.estimation.estimate import Estimate
from rotorfit.estimation.factors import Factors, triangular_factors
from rotorfit.estimation.feedback import ClosedLoopResponses, Feedback
from rotorfit.fit.dataset.dataset import ConfigurationData, LoadedFlight
from rotorfit.fit.experiment.airframe_table import AirframeEntry
from rotorfit.fit.experiment.experiment import ConfigurationEntry, Experiment, MotorsEntry
from rotorfit.fit.experiment.flight_entries import FlightEntry
from rotorfit.fit.fit import Fit
from rotorfit.fit.intervals.interval_terms import IntervalTerm
from rotorfit.fit.intervals.numbers import Numbers
from rotorfit.fit.joint.joint_problem import JointConfiguration, joint_problem
from rotorfit.fit.joint.term_choice import Choice
from rotorfit.fit.timing.timed_dataset import TimedDataset
from rotorfit.flight.decimate import as_recorded
from rotorfit.flight.flight_data import FlightData, Segment
from rotorfit.flight.prepare import PreparedFlight
from rotorfit.logs.flight_log import FlightLog
from rotorfit.model.regressor import regressor
from rotorfit.model.vehicle import Rotor, Vehicle

ARM = 0.25
SQUARE = (1.0, 1.0), (-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0)
QUAD = Vehicle(
    rotors=tuple(
        Rotor(
            position=(ARM * x / 2**0.5, ARM * y / 2**0.5, 0.0),
            spin="ccw" if number < 2 else "cw",
        )
        for number, (x, y) in enumerate(SQUARE)
    ),
    imu_position=(0.0, 0.0, 0.0),
)
"""Arms of 0.25 m."""
BODY = {
    "kt": 2e-6, "kd": 3e-8, "Jr": 2e-5, "rotor_drag": 1e-4,
    "msx": 1e-3, "msy": -2e-3, "msz": 4e-3,
    "Ixx": 0.01, "Iyy": 0.012, "Izz": 0.02, "Ixy": 1e-4, "Ixz": 2e-4, "Iyz": -1e-4,
}  # fmt: skip


def blocks(bands, *, rows=30, source=None, width=None):
    """Return factors with these bands, of which only the sizes matter."""
    width = len(regressor(QUAD).layout) if width is None else width
    return Factors(
        R=np.tile(np.eye(width), (len(bands), 1, 1)),
        rows=np.broadcast_to(np.asarray(rows), len(bands)).astype(np.int64),
        segment=np.zeros(len(bands), dtype=np.int64),
        band=np.array(bands, dtype=float).reshape(-1, 2),
        source=None if source is None else np.asarray(source),
    )


def turned(*ratios, bands=((1.0, 2.0),)):
    """Return blocks whose roll, pitch and yaw are explained by so much over the residual power.

    The residual is orthogonal to all that the rows are explained by.
    """
    model = regressor(QUAD)
    layout = model.layout.names
    turns = [layout.index(name) for name in ("dwx", "dwy", "dwz")]
    rng = np.random.default_rng(0)
    Z = rng.normal(size=(400, len(layout)))
    Z[:, [i for i, name in enumerate(layout) if name.startswith("O2_")]] *= 1e5
    body = {**BODY, "mass": 1.4, "msx": 0.0, "msy": 0.0, "msz": 0.0}
    body |= dict.fromkeys(("Ixy", "Ixz", "Iyz", "rotor_drag"), 0.0)
    body["Iyy"] = body["Izz"] = body["Ixx"]
    theta = np.array([body.get(name, 0.0) for name in model.names])
    B = np.einsum("p,pjz->jz", theta, model.tensor)
    Z[:, turns] = 0.0
    Z[:, turns] = -np.linalg.solve(B[3:][:, turns], B[3:] @ Z.T).T
    Q = np.linalg.qr(np.column_stack([Z, rng.normal(size=(400, 3))]))[0][:, -3:]
    made = []
    for ratio in ratios:
        noisy = Z.copy()
        noisy[:, turns] += Q * np.linalg.norm(Z[:, turns], axis=0) / np.sqrt(ratio)
        made.append(noisy)
    return Factors(
        R=triangular_factors(np.array(made)),
        rows=np.full(len(ratios), 400),
        segment=np.zeros(len(ratios), dtype=int),
        band=np.array(bands),
    )


def configuration(name="A", *, mass=1.4, vehicle=QUAD, factors=None, **more):
    return JointConfiguration(
        name=name,
        mass=mass,
        factors=blocks([(1.0, 2.0)] * 12) if factors is None else factors,
        model=regressor(vehicle),
        vehicle=vehicle,
        **more,
    )


def fit_of(configurations, *, std, influence=None, terms=("rotor_inertia",), powers=None):
    """Return an estimate at `BODY` whose deviations and influences are those that are given.

    `std` and `influence` are by name; a number that is not named has 1e-9 of its value, and no
    influence. Every block explains 100 times what it leaves, unless `powers` (signal, residual)
    says otherwise.
    """
    problem = joint_problem(configurations, terms=terms)
    names = problem.map.names
    values = np.array([BODY.get(name.partition("@")[0], 0.0) for name in names])
    small = {n: 1e-9 * (abs(v) or 1.0) for n, v in zip(names, values, strict=True)}
    deviations = np.array([{**small, **std}[name] for name in names])
    count = sum(len(c.factors) for c in configurations)
    pulls = np.zeros((count, len(names)))
    for name, column in (influence or {}).items():
        pulls[:, names.index(name)] = column
    signal, residual = powers or (np.full((count, 6), 101.0), np.ones((count, 6)))
    return BandedEstimate(
        estimate=Estimate(
            names=names,
            values=values,
            covariance=np.diag(deviations**2),
            condition_number=1.0,
        ),
        influence=pulls,
        variance=np.ones((count, 6)),
        signal_power=signal,
        residual_power=residual,
        log_likelihood=0.0,
        iterations=1,
        problem=problem,
        residual=np.zeros((count, 1, 6)),
    )


def with_known_variances(fit):
    """Return a fit without equations, so that no estimated variance adds to its covariance."""
    times = len(fit.problem.moving)
    factors = tuple(
        replace(f, slopes=np.zeros((len(f), times, *f.R.shape[1:])) if times else None)
        for f in fit.problem.factors
    )
    return replace(
        fit,
        variance=np.full_like(fit.variance, np.inf),
        problem=replace(fit.problem, factors=factors),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class MovingFeedback(Feedback):
    """An autopilot of whose errors the scores are known, by the parameters of the one part."""

    scores: np.ndarray

    def slope(self, c, G, dG):
        """Give all of the scores to the first block."""
        every = np.zeros((len(self.responses[c].rows), *self.scores.shape))
        every[0] = self.scores
        return every


def moved_by_responses(fit, shifts):
    """Return the fit of one part with an autopilot whose errors move the parameters so far."""
    scores = np.linalg.solve(fit.estimate.covariance, np.transpose(shifts)).T
    errors, blocks = len(scores), len(fit.influence)
    (part,) = fit.problem.every_part
    nothing = np.zeros((blocks, errors), dtype=complex)
    response = ClosedLoopResponses(
        rows=np.zeros((blocks, errors), dtype=int),
        moves=nothing[:, :, None],
        complementary_sensitivity=nothing,
        uncertainty=nothing,
        log_effect_slopes=np.zeros((blocks, errors, len(fit.problem.moving)), dtype=complex),
    )
    feedback = MovingFeedback(
        errors=tuple(range(errors)),
        inputs=(),
        responses=(response,),
        scores=scores[:, part.moved],
    )
    return replace(fit, problem=replace(fit.problem, feedback=feedback))


def prepared(*, seconds=20.0, rate=100.0, motor_rate=100.0, speed=500.0, force=None, segments=None):
    """Return a flight that does not turn, all rotors at one speed."""
    n = round(seconds * rate)
    still = np.zeros((n, 3))
    data = FlightData(
        sample_rate=rate,
        time=np.arange(n) / rate,
        specific_force=np.tile([0.0, 0.0, 9.80665], (n, 1)) if force is None else force,
        angular_velocity=still,
        angular_acceleration=still,
        rotor_speed=np.full((n, 4), speed),
        rotor_acceleration=np.zeros((n, 4)),
        differentiation="exact",
        segments=(Segment(start=0, stop=n),) if segments is None else segments,
    )
    return as_prepared(data, motor_rate=motor_rate)


def as_prepared(data, *, motor_rate):
    """Return data as a flight that was used whole, without doubts; all channels had its rate."""
    return PreparedFlight(
        data=data,
        phases=data.segments,
        motor_channel=data.rotor_speed,
        gyro_bias=None,
        spikes={},
        slowest_rate=data.sample_rate,
        motor_rate=motor_rate,
        cuts=(),
        findings=(),
    )


def dataset(*flights, mass=1.4, motors=None, vehicle=QUAD, **more):
    """Return what was flown, each of `flights` (prepared) a flight of one configuration, A."""
    used = [
        LoadedFlight(
            entry=FlightEntry(file=f"A{number}.csv"),
            log=FlightLog(
                path=Path(f"A{number}.csv"), sha256="0", format="table", channels={}, seconds=1.0
            ),
            prepared=flight,
            recorded=as_recorded(flight),
        )
        for number, flight in enumerate(flights)
    ]
    entry = ConfigurationEntry(name="A", mass=mass, flights=(FlightEntry(file="A0.csv"),))
    return TimedDataset(
        vehicle=vehicle,
        model=regressor(vehicle),
        motors=motors or MotorsEntry(),
        configurations=(ConfigurationData(entry=entry, flights=used),),
        **more,
    )


def as_kind(kind, flights, **more):
    """Return a dataset as one of a subclass that makes its bands otherwise."""
    return kind(**{one.name: getattr(flights, one.name) for one in fields(TimedDataset)}, **more)


def known_to(half_width):
    """Return the interval terms of numbers that are known to these half-widths by chance."""
    half = np.array(half_width, dtype=float)
    return (IntervalTerm(name="noise", half_width=half, source="made up"),)


def no_numbers(*names, values=(), half_width=(), excitation=None):
    """Return numbers of these names, uncorrelated."""
    return Numbers(
        names=names,
        values=np.array(values, dtype=float),
        terms=known_to(half_width),
        correlation=np.eye(len(names)),
        excitation=excitation or {},
    )


def fit(flights, numbers=None, *, bodies=None, estimate=None):
    """Return a fit of a dataset with made-up numbers; without `bodies` nothing was fitted."""
    bodies = [configuration()] if bodies is None else bodies
    return Fit(
        dataset=flights,
        terms=(),
        choice=Choice(terms=()),
        estimate=fit_of(bodies, std={}) if estimate is None else estimate,
        configurations=tuple(bodies),
        numbers=no_numbers() if numbers is None else numbers,
    )


def experiment(entry=None, motors=None, **identification):
    """Return an experiment of one configuration, A."""
    entry = entry or ConfigurationEntry(name="A", mass=1.4, flights=(FlightEntry(file="A0.csv"),))
    return Experiment(
        airframe=AirframeEntry(layout="quad-x", arm=ARM),
        motors=motors or MotorsEntry(),
        identification=identification,
        configuration=(entry,),
    )


def only(findings):
    """Return the one finding of a check; None where it found nothing to object to."""
    objections = [one for one in findings if one.severity != "passed"]
    assert len(objections) < 2
    return objections[0].sentence if objections else None
