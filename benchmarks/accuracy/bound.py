r"""The Cramer-Rao bound of flights whose exact signals and noise spectra are known.

The equations B(theta) z = 0 hold for the signals without noise and disturbance. Conditional on the
flight (the signals themselves are unknowns), in Whittle's approximation, line by line,

.. math:: F = \sum_f 2 \operatorname{Re} J_f^H S_f^{-1} J_f, \quad
    J_f = \frac{\partial B}{\partial \phi} \bar z_f, \quad S_f = B N_f B^T + Q_f,

N_f the covariance of the signals' noise and Q_f that of the disturbing wrench; one instead of two
for the mean. In z-bar the accelerations are those that the rotors alone explain: what a disturbance
moves tells of the inertia only to someone who knows the disturbance in N m, and nobody does.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float
from scipy.signal import windows

from rotorfit.estimation.estimate import numerical_jacobian
from rotorfit.estimation.factors import Factors
from rotorfit.estimation.parameter_map import ParameterMap
from rotorfit.fit.intervals.joint_numbers import physical
from rotorfit.fit.joint.joint_map import joint_map
from rotorfit.fit.joint.joint_problem import NOISY, JointConfiguration, joint_prior
from rotorfit.fit.reduction.motor_timing import LAG_PRIOR
from rotorfit.model.regressor import Regressor, regressor
from rotorfit.model.signals import signal_layout, signal_matrix
from rotorfit.model.terms.rotors import rotor_drag_std
from rotorfit.model.terms.term import Size
from rotorfit.model.vehicle import Vehicle
from rotorfit.simulation import SimulatedFlight, sampled_flight_data

TOP = 30.0
"""Lines up to here are counted [Hz], as far as the estimate itself looks."""
TAPER = 0.04
"""Share of the flight in the two cosine ends of the window; a flight begins and ends in hover."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Spectrum:
    """Exact signals of one configuration, line by line, and the spectra of what disturbs them.

    Attributes
    ----------
    weight
        1 for the mean, 2 for every other line (which stands for its negative frequency too).
    frequency
        Of each line [Hz].
    signals
        Windowed, transformed, divided by the root of the number of samples.
    noise
        Covariance of the signals' measurement noise.
    disturbance
        Covariance of the wrench that the equations leave out, force [N] then torque [N m].
    """

    weight: Float[np.ndarray, " l"]
    frequency: Float[np.ndarray, " l"]
    signals: Complex[np.ndarray, "l z"]
    noise: Complex[np.ndarray, "l z z"]
    disturbance: Float[np.ndarray, "l j"]


@dataclass(frozen=True, slots=True, kw_only=True)
class LinearModel:
    """The equations of every configuration: tensors, the map to theta, and the true phi.

    Attributes
    ----------
    noisy
        The signals that the equations are solved for where a disturbance moves them.
    rotors
        Which signals come later by an unknown lag and delay.
    """

    tensors: tuple[Float[np.ndarray, "p j z"], ...]
    map: ParameterMap
    phi: Float[np.ndarray, " f"]
    noisy: tuple[int, ...]
    rotors: tuple[int, ...] = ()


def fisher(
    spectra: Sequence[Spectrum], model: LinearModel, *, lags: Sequence[float | None] = ()
) -> Float[np.ndarray, "g g"]:
    """Return the information of all configurations' lines.

    Parameters
    ----------
    spectra
        One per configuration.
    model
        The equations, and where they are true.
    lags
        Further parameters, after those of the map: None for an unknown delay of the rotor signals,
        a number for the time constant [s] of a first-order lag whose error is unknown.
    """
    theta, dtheta = model.map.theta(model.phi), model.map.jacobian(model.phi)
    total = np.zeros((len(model.phi) + len(lags),) * 2)
    for c, (spectrum, tensor) in enumerate(zip(spectra, model.tensors, strict=True)):
        B = np.einsum("p,pjz->jz", theta[c], tensor)
        z = explained(spectrum.signals, B, model.noisy)
        dB = np.einsum("pf,pjz->fjz", dtheta[c], tensor)
        J = np.einsum("fjz,lz->ljf", dB, z)
        late = [_lagged(spectrum, z, lag) @ _only(B, model.rotors).T for lag in lags]
        J = np.concatenate([J, *(column[:, :, None] for column in late)], axis=2)
        S = np.einsum("jz,lzy,ky->ljk", B, spectrum.noise, B, optimize=True)
        S += spectrum.disturbance[:, :, None] * np.eye(len(B))
        # Rows in N and in N m differ by 1e6 in S: scaled to a unit diagonal before it is solved.
        root = np.sqrt(np.einsum("ljj->lj", S).real)
        scaled = J / root[:, :, None]
        solved = np.linalg.solve(S / (root[:, :, None] * root[:, None, :]), scaled)
        total += np.einsum("l,ljf,ljg->fg", spectrum.weight, scaled.conj(), solved).real
    return total


def explained(
    signals: Complex[np.ndarray, "l z"], B: Float[np.ndarray, "j z"], noisy: Sequence[int]
) -> Complex[np.ndarray, "l z"]:
    """Return the signals with the noisy ones as the others make them: B z = 0 exactly."""
    columns = list(noisy)
    rest = B.copy()
    rest[:, columns] = 0.0
    made = signals.copy()
    made[:, columns] = -signals @ np.linalg.solve(B[:, columns], rest).T
    return made


def _lagged(
    spectrum: Spectrum, z: Complex[np.ndarray, "l z"], lag: float | None
) -> Complex[np.ndarray, "l z"]:
    """Return the derivative of the signals by a delay, or by the time constant of a lag."""
    turn = 2j * np.pi * spectrum.frequency
    return (-turn / (1.0 if lag is None else 1.0 + lag * turn))[:, None] * z


def _only(B: Float[np.ndarray, "j z"], columns: Sequence[int]) -> Float[np.ndarray, "j z"]:
    kept = np.zeros_like(B)
    kept[:, list(columns)] = B[:, list(columns)]
    return kept


def flight_spectrum(
    flight: SimulatedFlight, vehicle: Vehicle, *, rotor_speed_std: float
) -> Spectrum:
    """Return the exact lines of a simulated flight with the spectra of its noise.

    Parameters
    ----------
    flight
        In the air from its first to its last sample.
    vehicle
        What is known of it.
    rotor_speed_std
        Noise of the rotor speeds [rad/s]; 0 where commands stand for them.
    """
    data = sampled_flight_data(flight)
    n, rate = len(data.time) - 2, data.sample_rate
    w = windows.tukey(n, TAPER)
    frequency = np.fft.rfftfreq(n, 1.0 / rate)
    frequency = frequency[frequency <= TOP]
    Z = signal_matrix(data, vehicle, 1, n + 1) * (w / np.sqrt(n))[:, None]
    turn = 2.0 * np.pi * frequency / rate
    average = (4.0 + 2.0 * np.cos(turn)) / 6.0
    # The window's own slope differentiates too: it is what is known of a rate's mean slope.
    edge = float(np.gradient(w, 1.0 / rate) @ np.gradient(w, 1.0 / rate)) / n
    return Spectrum(
        weight=np.where(frequency > 0, 2.0, 1.0),
        frequency=frequency,
        signals=np.fft.rfft(Z, axis=0)[: len(frequency)],
        noise=_signal_noise(flight, vehicle, rotor_speed_std, (turn, average, edge)),
        disturbance=_gusts(flight, turn) * (average**2)[:, None],
    )


def _signal_noise(
    flight: SimulatedFlight,
    vehicle: Vehicle,
    rotor_speed_std: float,
    filters: tuple[Float[np.ndarray, " l"], Float[np.ndarray, " l"], float],
) -> Complex[np.ndarray, "l z z"]:
    """Return the covariance of the signals that white noise of the sensors makes, per line.

    Through the same filters as the signals: [1 4 1]/6, and central differences for derivatives.
    """
    turn, average, edge = filters
    C = _sensitivity(flight, vehicle, rotor_speed_std)
    E = _derivative_sensitivity(vehicle, flight.sensors.gyro_std, rotor_speed_std)
    difference = 1j * np.sin(turn) * flight.sample_rate
    level = np.einsum("nzc,nyc->zy", C, C, optimize=True) / len(C)
    cross = C.mean(axis=0) @ E.T
    return (
        (average**2)[:, None, None] * level
        + (np.abs(difference) ** 2 + edge)[:, None, None] * (E @ E.T)
        + (average * difference.conj())[:, None, None] * cross
        + (average * difference)[:, None, None] * cross.T
    )


def _sensitivity(
    flight: SimulatedFlight, vehicle: Vehicle, rotor_speed_std: float
) -> Float[np.ndarray, "n z c"]:
    """Return what unit noise of gyro, accelerometer and rotors does to each signal, thinned.

    The gyroscopic products with the rotors' spin, whose noise is far below the rest, are left out.
    """
    names = signal_layout(vehicle)
    w, O = flight.angular_velocity[::20], flight.rotor_speed[::20]
    C = np.zeros((len(w), len(names), 6 + O.shape[1]))
    for k, axis in enumerate("xyz"):
        C[:, names.index(f"a{axis}"), 3 + k] = flight.sensors.accel_std
    for i, one in enumerate("xyz"):
        for j, other in list(enumerate("xyz"))[i:]:
            row = names.index(f"w{one}w{other}")
            C[:, row, i] += flight.sensors.gyro_std * w[:, j]
            C[:, row, j] += flight.sensors.gyro_std * w[:, i]
    for r in range(O.shape[1]):
        C[:, names.index(f"O2_{r + 1}"), 6 + r] = 2.0 * O[:, r] * rotor_speed_std
    return C


def _derivative_sensitivity(
    vehicle: Vehicle, gyro_std: float, rotor_speed_std: float
) -> Float[np.ndarray, "z c"]:
    """Return the same for the derivatives of rates and of the rotors' spin."""
    names = signal_layout(vehicle)
    E = np.zeros((len(names), 6 + len(vehicle.rotors)))
    spins = vehicle.spins[:, None] * vehicle.axes
    for k, axis in enumerate("xyz"):
        E[names.index(f"dw{axis}"), k] = gyro_std
        if f"dH{axis}" in names:
            E[names.index(f"dH{axis}"), 6:] = spins[:, k] * rotor_speed_std
    return E


def _gusts(flight: SimulatedFlight, turn: Float[np.ndarray, " l"]) -> Float[np.ndarray, "l 6"]:
    """Return the spectrum of a sampled Gauss-Markov process of every wrench component."""
    truth = flight.truth
    std = np.array(truth.disturbance_force_std + truth.disturbance_torque_std)
    keep = np.exp(-2.0 * np.pi * truth.disturbance_bandwidth / flight.sample_rate)
    shape = (1.0 - keep**2) / np.abs(1.0 - keep * np.exp(-1j * turn)) ** 2
    return shape[:, None] * std**2


@dataclass(frozen=True, slots=True, kw_only=True)
class Bound:
    """Smallest standard deviations that an unbiased estimate can have, and at what truth.

    Attributes
    ----------
    std
        By the names of a result: ``kt``, ``Ixx@A``, ``Ixx_com@A``.
    true
        The same numbers at the true parameters.
    """

    std: Mapping[str, float]
    true: Mapping[str, float]


def flights_bound(flights: Mapping[str, SimulatedFlight], *, commanded: bool) -> Bound:
    """Return the bound of all configurations together, for the default model and its priors.

    Parameters
    ----------
    flights
        One per configuration, by its name.
    commanded
        Whether commands stand for rotor speeds, and the motors' lag is unknown.
    """
    first = next(iter(flights.values()))
    physics = regressor(first.vehicle)
    joint = [joint_configuration(name, f, physics) for name, f in flights.items()]
    mapped = joint_map(joint)
    phi = true_phi(mapped, flights)
    model = LinearModel(
        tensors=(physics.tensor,) * len(joint),
        map=mapped,
        phi=phi,
        noisy=tuple(physics.layout.index(name) for name in NOISY),
        rotors=tuple(
            i for i, name in enumerate(physics.layout.names) if name[0] == "O" or "H" in name
        ),
    )
    spectra = [
        flight_spectrum(
            f, f.vehicle, rotor_speed_std=0.0 if commanded else f.sensors.rotor_speed_std
        )
        for f in flights.values()
    ]
    lags = (None, first.truth.motor_lag) if commanded else (None,)
    information = fisher(spectra, model, lags=lags) + np.diag(
        prior_information(mapped, joint, len(lags), _rotor_drag_std(first))
    )
    return _physical_bound(information, mapped, phi, joint)


def joint_configuration(
    name: str, flight: SimulatedFlight, physics: Regressor
) -> JointConfiguration:
    """Describe the body of a flight for the joint map; no equations are in it."""
    width = len(physics.layout)
    nothing = Factors(
        R=np.zeros((0, width, width)),
        rows=np.zeros(0, dtype=np.int64),
        segment=np.zeros(0, dtype=np.int64),
        band=np.zeros((0, 2)),
    )
    return JointConfiguration(
        name=name,
        mass=flight.truth.mass,
        factors=nothing,
        model=physics,
        vehicle=flight.vehicle,
    )


def _rotor_drag_std(flight: SimulatedFlight) -> float:
    """Return what is known of the rotors' drag before the flight [N s^2/(m rad)]."""
    speeds = np.sqrt((flight.rotor_speed**2).mean(axis=0))
    return rotor_drag_std(
        Size(mass=flight.truth.mass, arm=flight.vehicle.arm, speeds=float(speeds.sum()))
    )


def true_phi(
    mapped: ParameterMap, flights: Mapping[str, SimulatedFlight]
) -> Float[np.ndarray, " f"]:
    """Return the free parameters of what really flew."""
    values: dict[str, float] = {}
    for name, flight in flights.items():
        truth = flight.truth
        own_kt = truth.rotor_kt(flight.rotor_speed.shape[1])
        kt = float(own_kt.mean())
        values |= {"kt": kt, "kd": truth.kd, "Jr": truth.Jr}
        values |= {f"spread_{i}": float(k) / kt - 1.0 for i, k in enumerate(own_kt, start=1)}
        own = zip(
            ("msx", "msy", "msz", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz"),
            (*truth.first_moments, *truth.inertia),
            strict=True,
        )
        values |= {f"{key}@{name}": value for key, value in own}
        bias = zip("xyz", flight.sensors.accel_bias, strict=True)
        values |= {f"accel_bias_{axis}@{name}": value for axis, value in bias}
    return np.array([values.get(name, 0.0) for name in mapped.names])


def prior_information(
    mapped: ParameterMap, joint: Sequence[JointConfiguration], lags: int, drag_std: float
) -> Float[np.ndarray, " g"]:
    """Return 1 / std^2 of what the default model knows before the flight."""
    known = np.zeros(len(mapped.names) + lags)
    prior = joint_prior(joint) | {"rotor_drag": drag_std}
    for i, name in enumerate(mapped.names):
        known[i] = prior.get(name, np.inf) ** -2
    if lags > 1:
        known[-1] = LAG_PRIOR[1] ** -2
    return known


def _physical_bound(
    information: Float[np.ndarray, "g g"],
    mapped: ParameterMap,
    phi: Float[np.ndarray, " f"],
    joint: list[JointConfiguration],
) -> Bound:
    """Return the bound on the numbers of a result."""
    size = 1.0 / np.sqrt(np.diagonal(information))
    covariance = np.linalg.inv(information * np.outer(size, size)) * np.outer(size, size)
    std = np.sqrt(np.diagonal(covariance))
    true = physical(phi, mapped, joint)
    jacobian = numerical_jacobian(
        lambda at: np.array(list(physical(at, mapped, joint).values())), phi, std[: len(phi)]
    )
    spread = jacobian @ covariance[: len(phi), : len(phi)] @ jacobian.T
    numbers = dict(zip(true, np.sqrt(np.diagonal(spread)).tolist(), strict=True))
    numbers["motor_delay"] = float(std[len(phi)])
    return Bound(std=numbers, true=dict(true))
