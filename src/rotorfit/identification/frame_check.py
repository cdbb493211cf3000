"""Do the declared rotors explain the sign of the vehicle's response? Refuse what they contradict.

Roll and pitch must accelerate with the torque of the thrusts, yaw with that of drag and spin-up.
The check looks at the correlation of each angular acceleration with the torque that the declared
rotors would make; where one is clearly negative, or another order of the motors explains the
flight where the declared one does not, the declaration is wrong and every number would be.
"""

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import permutations

import numpy as np
import scipy.linalg
from jaxtyping import Float

from rotorfit.errors import FrameError
from rotorfit.estimation.factors import Factors
from rotorfit.model.regressor import MX, MY, MZ, Regressor, regressor
from rotorfit.model.vehicle import Rotor, Vehicle

CLEAR = 0.3
"""A share of the angular acceleration that is explained beyond doubt."""
BAND = (0.3, 15.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Response:
    """Signed share of each angular acceleration that the rotors explain (1: all, -1: reversed)."""

    roll: float
    pitch: float
    yaw: float

    @property
    def score(self) -> float:
        """Sum over the axes: 3 is perfect."""
        return self.roll + self.pitch + self.yaw

    @property
    def worst(self) -> float:
        """The most contradictory axis."""
        return min(self.roll, self.pitch, self.yaw)


def response(factors: Factors, vehicle: Vehicle) -> Response:
    """Return how the declared rotors explain the response of each axis."""
    inside = (factors.band[:, 1] > BAND[0]) & (factors.band[:, 0] < BAND[1])
    R = factors.select(inside).total if inside.any() else factors.total
    return _response(R, regressor(vehicle, effects=("thrust", "torque", "rotor_inertia")))


def _response(R: Float[np.ndarray, "z z"], model: Regressor) -> Response:
    kt, kd, Jr = (-model.tensor[model.names.index(name)] for name in ("kt", "kd", "Jr"))
    return Response(
        roll=_signed_share(R, model.layout.index("dwx"), [kt[MX]]),
        pitch=_signed_share(R, model.layout.index("dwy"), [kt[MY]]),
        yaw=_signed_share(R, model.layout.index("dwz"), [kd[MZ], Jr[MZ]]),
    )


def _signed_share(
    R: Float[np.ndarray, "z z"], target: int, drives: list[Float[np.ndarray, " z"]]
) -> float:
    """Return the share of a signal that drives with coefficients of one sign explain."""
    y = R[:, target]
    total = float(y @ y)
    if total == 0.0:
        return 0.0
    shares = [0.0]
    for chosen in ([drives[0]], [drives[-1]], drives):
        D = R @ np.array(chosen).T
        if not np.all(np.linalg.norm(D, axis=0) > 0):
            continue
        D = D / np.linalg.norm(D, axis=0)
        coefficients: Float[np.ndarray, " d"] = scipy.linalg.pinv(D) @ y
        if (coefficients > 0).all() or (coefficients < 0).all():
            explained = float(y @ D @ coefficients) / total
            shares.append(explained if coefficients[0] > 0 else -explained)
    return max(shares, key=abs)


def check_frame(factors: Factors, vehicle: Vehicle) -> Response:
    """Return the response of the declared rotors, or refuse their declaration.

    Raises
    ------
    FrameError
        If the data contradict it; the message says which declaration would fit.
    """
    declared = response(factors, vehicle)
    lost = declared.worst < CLEAR
    if not lost:
        return declared
    best, words = max(
        ((response(factors, other), words) for other, words in _alternatives(vehicle)),
        key=lambda pair: pair[0].score,
    )
    contradicted = declared.worst < -CLEAR
    beaten = best.score > declared.score + 1.0 and best.worst > CLEAR
    if not (contradicted or beaten):
        return declared
    seen = (
        f"with the declared rotors roll, pitch and yaw respond {declared.roll:+.2f}, "
        f"{declared.pitch:+.2f}, {declared.yaw:+.2f} (+1: as the model says, -1: reversed)"
    )
    if best.score > declared.score + 0.5:
        raise FrameError(
            f"{seen}; with {words} they would respond {best.roll:+.2f}, {best.pitch:+.2f}, "
            f"{best.yaw:+.2f}: correct the rotors' order and spin, or the log's axes"
        )
    raise FrameError(f"{seen}; check the rotors' order and spin, and the axes of the gyro")


def _alternatives(vehicle: Vehicle) -> Iterator[tuple[Vehicle, str]]:
    """Yield other declarations of the same rotors, the simplest first, in words."""
    for rotors, words in _orders(vehicle.rotors):
        for spins_reversed in (False, True):
            if words is None and not spins_reversed:
                continue
            turned = tuple(_reversed(r) for r in rotors) if spins_reversed else rotors
            parts = [words] if words else []
            parts += ["every spin reversed (props out instead of in)"] if spins_reversed else []
            yield dataclasses.replace(vehicle, rotors=turned), " and ".join(parts)
    yield _mirrored(vehicle), "the gyro's y and z reversed (FRD axes where FLU is declared)"


def _orders(rotors: tuple[Rotor, ...]) -> Iterator[tuple[tuple[Rotor, ...], str | None]]:
    """Yield the rotors in other orders: all of a quadrotor's, else only swaps of two."""
    n = len(rotors)
    identity = tuple(range(n))
    if n <= 4:
        orders = list(permutations(range(n)))
    else:
        orders = [identity]
        for i in range(n):
            for j in range(i + 1, n):
                swapped = list(identity)
                swapped[i], swapped[j] = j, i
                orders.append(tuple(swapped))
    for order in orders:
        named = ", ".join(str(i + 1) for i in order)
        words = None if order == identity else f"your rotors listed in the order {named}"
        yield tuple(rotors[i] for i in order), words


def _reversed(rotor: Rotor) -> Rotor:
    return dataclasses.replace(rotor, spin="cw" if rotor.spin == "ccw" else "ccw")


def _mirrored(vehicle: Vehicle) -> Vehicle:
    """Return the vehicle that answers like this one seen by a gyro with y and z reversed."""
    rotors = tuple(
        dataclasses.replace(_reversed(r), position=(-r.position[0], r.position[1], r.position[2]))
        for r in vehicle.rotors
    )
    return dataclasses.replace(vehicle, rotors=rotors)
