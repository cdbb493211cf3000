"""Newton-Euler by vectors, about the CoM, and random vehicles to compare the regressor with.

Written without a look at the tensors: the body is a mass, a CoM and an inertia about the CoM, each
rotor is a wrench and a spinning wheel at its own place.
"""

from dataclasses import dataclass, replace

import numpy as np

from rotorfit.flight.flight_data import FlightData, Segment
from rotorfit.model.vehicle import Rotor, Vehicle

INERTIA_NAMES = ("Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")
CHI = ("msx", "msy", "msz", *INERTIA_NAMES)


@dataclass(frozen=True, kw_only=True)
class Body:
    """A rigid body with rotors; all vectors from the body origin, body axes."""

    mass: float
    com: np.ndarray
    inertia_com: np.ndarray
    kt: np.ndarray
    kd: float
    Jr: float
    rotor_shift: np.ndarray
    constant: np.ndarray
    twist: float = 0.0
    drag: np.ndarray | float = 0.0
    drag_position: np.ndarray | float = 0.0
    rotor_drag: float = 0.0
    kd_linear: float = 0.0
    turn_damping: tuple[float, float] = (0.0, 0.0)
    inflow: float = 0.0
    translational_lift: float = 0.0

    @property
    def inertia_origin(self):
        c = self.com
        return self.inertia_com + self.mass * (c @ c * np.eye(3) - np.outer(c, c))


def theta_of(body, shared_kt=0.0):
    """Return the parameters by name; the rotors' coefficients as deviations from `shared_kt`."""
    I = tensor_elements(body.inertia_origin)
    theta = {"mass": body.mass, "kt": shared_kt, "kd": body.kd, "Jr": body.Jr}
    theta |= dict(zip(("msx", "msy", "msz"), body.mass * body.com, strict=True))
    theta |= I
    theta |= {f"kt_{i + 1}": k - shared_kt for i, k in enumerate(body.kt)}
    theta |= {f"kt_rotor_center_{a}": body.kt[0] * body.rotor_shift[i] for i, a in enumerate("xyz")}
    theta |= {"kt_twist": body.kt[0] * body.twist, "rotor_drag": body.rotor_drag}
    theta |= dict(zip(("turn_damping_x", "turn_damping_y"), body.turn_damping, strict=True))
    theta |= {"kd_linear": body.kd_linear}
    theta |= {"inflow": body.inflow, "translational_lift": body.translational_lift}
    theta |= dict(zip(("drag_x", "drag_y", "drag_z"), body.drag * np.ones(3), strict=True))
    # Column k: the torque about the origin of the drag at unit velocity along k.
    torque = np.cross(body.drag_position * np.ones(3), -np.diag(body.drag * np.ones(3))).T
    theta |= {
        f"drag_moment_{a}{b}": torque[i, k]
        for i, a in enumerate("xyz")
        for k, b in enumerate("xyz")
        if a != b
    }
    names = ("Fx_0", "Fy_0", "Fz_0", "Mx_0", "My_0", "Mz_0")
    return theta | dict(zip(names, body.constant, strict=True))


def tensor_elements(I):
    """Return the six elements of a symmetric tensor by name."""
    places = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    return {name: I[place] for name, place in zip(INERTIA_NAMES, places, strict=True)}


def body_wrench(body, alpha, w, dw):
    """Return force and torque about the origin that the motion needs, sample by sample."""
    m, c, I = body.mass, body.com, body.inertia_com
    at_com = alpha + np.cross(dw, c) + np.cross(w, np.cross(w, c))
    force = m * at_com
    torque = dw @ I + np.cross(w, w @ I) + np.cross(c, force)
    return np.concatenate([force, torque], axis=1)


def rotor_wrench(body, vehicle, w, O, dO):
    """Return force and torque about the origin that the rotors give, wheel by wheel."""
    force, torque = np.zeros((2, len(w), 3))
    for i, rotor in enumerate(vehicle.rotors):
        n = np.array(rotor.axis)
        s = {"ccw": 1.0, "cw": -1.0}[rotor.spin]
        place = np.array(rotor.position) + body.rotor_shift
        thrust = body.kt[i] * O[:, i, None] ** 2 * n
        force += thrust
        torque += np.cross(place, thrust) - s * body.kd * O[:, i, None] ** 2 * n
        torque -= s * body.kd_linear * O[:, i, None] * n
        torque += body.twist * body.kt[0] * O[:, i, None] ** 2 * [0.0, 0.0, 1.0]
        wheel = s * body.Jr * O[:, i, None] * n
        torque -= s * body.Jr * dO[:, i, None] * n + np.cross(w, wheel)
        carried = np.cross(w * [0.0, 0.0, 1.0], rotor.position)
        held_back = np.cross(rotor.position, -body.rotor_drag * O[:, i, None] * carried)
        torque += held_back * [0.0, 0.0, 1.0]
    return np.concatenate([force, torque], axis=1)


def drag_wrench(body, v, w):
    """Return force and torque about the origin of the air that the body moves through.

    The point of the drag moves with v + w x r; of its torque, the part of the origin's velocity.
    """
    r = body.drag_position * np.ones(3)
    torque = np.cross(r, -body.drag * v)
    return np.concatenate([-body.drag * (v + np.cross(w, r)), torque], axis=1)


def air_wrench(body, vehicle, v, w, O):
    """Return force and torque of the air beside drag: on the turning body, and rotor by rotor.

    A rotor that moves along its axis loses thrust; one that moves across z gains it, of which each
    has the same share and whose torques are taken to cancel.
    """
    force, torque = np.zeros((2, len(w), 3))
    torque -= w * np.append(body.turn_damping, 0.0)
    for i, rotor in enumerate(vehicle.rotors):
        n, place = np.array(rotor.axis), np.array(rotor.position)
        climb = (v + np.cross(w, place)) @ n
        lost = -body.inflow * (O[:, i] * climb)[:, None] * n
        force += lost
        torque += np.cross(place, lost)
    force[:, 2] += body.translational_lift * (v[:, 0] ** 2 + v[:, 1] ** 2)
    return np.concatenate([force, torque], axis=1)


def at_point(alpha, w, dw, p):
    """Return the specific force at `p` of a body with the specific force `alpha` at its origin."""
    return alpha + np.cross(dw, p) + np.cross(w, np.cross(w, p))


def random_body(rng, rotors, *, equal_kt=False):
    """Return a physical body: inertia of random point masses about their CoM."""
    mass = rng.uniform(0.03, 5.0)
    points = rng.normal(size=(8, 3)) * rng.uniform(0.02, 0.3)
    points -= points.mean(axis=0)
    squares = points.T @ points * mass / 8
    kt = 3e-6 * rng.uniform(0.5, 2.0, 1 if equal_kt else rotors)
    return Body(
        mass=mass,
        com=rng.normal(size=3) * 0.02,
        inertia_com=np.trace(squares) * np.eye(3) - squares,
        kt=np.broadcast_to(kt, rotors).copy(),
        kd=rng.uniform(1e-8, 2e-7),
        Jr=rng.uniform(1e-6, 5e-5),
        rotor_shift=np.zeros(3),
        constant=np.zeros(6),
    )


def random_vehicle(rng, rotors, *, tilted=False, imu=None):
    """Return rotors anywhere, spinning anyhow, with axes anywhere if `tilted`."""
    axes = np.tile([0.0, 0.0, 1.0], (rotors, 1))
    if tilted:
        axes += rng.normal(size=(rotors, 3)) * 0.5
        axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    return Vehicle(
        rotors=tuple(
            Rotor(
                position=tuple(map(float, rng.normal(size=3) * 0.25)),
                spin="ccw" if rng.random() < 0.5 else "cw",
                axis=tuple(map(float, n)),
            )
            for n in axes
        ),
        imu_position=None if imu is None else tuple(map(float, imu)),
    )


PAPER_ARM = 0.2


def paper_vehicle(arm=PAPER_ARM):
    """Return the plus frame of Six et al. 2020, eq. 9: rotors 1, 2 ccw on y, 3, 4 cw on x."""
    places = ((0.0, -arm, 0.0), (0.0, arm, 0.0), (arm, 0.0, 0.0), (-arm, 0.0, 0.0))
    spins = ("ccw", "ccw", "cw", "cw")
    return Vehicle(
        rotors=tuple(Rotor(position=p, spin=s) for p, s in zip(places, spins, strict=True))
    )


def paper_body():
    """Return configuration A of THEORY section 0 with a rotor inertia."""
    com = np.array([-4.5e-3, -1.9e-3, -8.3e-3]) / 1.285
    origin = np.array([[182.0, 0.5, 1.0], [0.5, 186.0, -1.0], [1.0, -1.0, 288.0]]) * 1e-4
    return Body(
        mass=1.285,
        com=com,
        inertia_com=origin - 1.285 * (com @ com * np.eye(3) - np.outer(com, com)),
        kt=np.full(4, 3.63e-6),
        kd=5.11e-8,
        Jr=2e-5,
        rotor_shift=np.zeros(3),
        constant=np.zeros(6),
    )


def random_motion(rng, n, rotors):
    """Return alpha, w, dw, O, dO without any relation between them."""
    alpha = rng.normal(size=(n, 3)) * 3.0 + [0.0, 0.0, 9.8]
    w, dw = rng.normal(size=(n, 3)) * 2.0, rng.normal(size=(n, 3)) * 8.0
    O, dO = rng.uniform(300.0, 1200.0, (n, rotors)), rng.normal(size=(n, rotors)) * 800.0
    return alpha, w, dw, O, dO


def flight_of(alpha, w, dw, O, dO, *, rate=200.0, differentiation="exact", margin=0, velocity=None):
    """Return the arrays as a flight of one segment, `margin` rows inside at both ends."""
    n = len(w)
    return FlightData(
        sample_rate=rate,
        time=np.arange(n) / rate,
        specific_force=alpha,
        angular_velocity=w,
        angular_acceleration=dw,
        rotor_speed=O,
        rotor_acceleration=dO,
        differentiation=differentiation,
        segments=(Segment(start=margin, stop=n - margin),),
        velocity=velocity,
    )


def balanced_motion(body, vehicle, w, O, dO):
    """Return alpha and dw with which the rotors' wrench is exactly what the motion needs."""
    unit = np.eye(6)
    still = np.zeros((6, 3))
    # Column k: the wrench that a unit of acceleration k needs.
    M = body_wrench(body, unit[:, :3], still, unit[:, 3:]).T
    at_rest = body_wrench(body, np.zeros_like(w), w, np.zeros_like(w))
    needed = rotor_wrench(body, vehicle, w, O, dO) + body.constant - at_rest
    acceleration = np.linalg.solve(M, needed.T).T
    return acceleration[:, :3], acceleration[:, 3:]


def smooth(rng, n, columns, *, rate=200.0, upto=4.0):
    """Return random smooth signals of unit size: sines up to `upto` Hz."""
    t = np.arange(n)[:, None] / rate
    total = np.zeros((n, columns))
    for _ in range(6):
        f, phase = rng.uniform(0.1, upto, columns), rng.uniform(0, 2 * np.pi, columns)
        total += np.sin(2 * np.pi * f * t + phase)
    return total / np.sqrt(3.0)


def flown(body, vehicle, n, *, seed=0, noise=0.0):
    """Return a flight whose samples obey Newton-Euler; with sensor noise if asked.

    The rates are not the integral of the accelerations: no equation asks that they be.
    """
    rng = np.random.default_rng(seed)
    N = len(vehicle.rotors)
    w = smooth(rng, n, 3) * [0.8, 0.6, 0.4]
    hover = np.sqrt(body.mass * 9.81 / body.kt.sum())
    O = hover * (1.0 + 0.08 * smooth(rng, n, N))
    dO = hover * smooth(rng, n, N)
    alpha, dw = balanced_motion(body, vehicle, w, O, dO)
    if vehicle.imu_position is not None:
        alpha = at_point(alpha, w, dw, vehicle.imu_position)
    if noise:
        alpha = alpha + noise * 0.4 * rng.normal(size=alpha.shape)
        dw = dw + noise * 0.5 * rng.normal(size=dw.shape)
        w = w + noise * 0.02 * rng.normal(size=w.shape)
        O = O + noise * 5.0 * rng.normal(size=O.shape)
    return flight_of(alpha, w, dw, O, dO)


def without_margin(flight, margin):
    """Return the flight with its one segment pulled in at both ends."""
    n = len(flight.time)
    return replace(flight, segments=(Segment(start=margin, stop=n - margin),))
