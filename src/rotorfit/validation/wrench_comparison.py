"""Body wrench against rotor wrench over a flight: what validation yields and figures show."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

COMPONENTS = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")
SHOWN = ("Fz", "Mx", "My", "Mz")
"""The components that rotors of a flat multirotor make (Six et al. 2020, Fig. 3 and 4)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WrenchComparison:
    """Two sides of the equations of motion on one flight, with a result's parameters.

    Attributes
    ----------
    configuration, flight, sha256
        Which configuration the flight was flown in; its file and fingerprint.
    used_in_fit
        Whether the flight's own data made the parameters.
    time
        Since the log's first sample [s]; the steps over cuts are longer.
    body_wrench
        What the motion asks for, force then torque about the body origin [N, N m].
    rotor_wrench
        What the rotors give.
    relative_error
        Norm of the difference over the norm of the rotor wrench, by component, as a fraction
        (Six et al. 2020, Table III).
    whiteness
        Largest autocorrelation of the difference beyond the low-pass's own memory, by component:
        near 0 where nothing of the motion is left in it.
    speeds
        Between which 99.8 % of the rotor speeds in the air were [rad/s]; None where not known.
    """

    configuration: str
    flight: str
    sha256: str
    used_in_fit: bool
    time: Float[np.ndarray, " n"]
    body_wrench: Float[np.ndarray, "n 6"]
    rotor_wrench: Float[np.ndarray, "n 6"]
    relative_error: Mapping[str, float]
    whiteness: Mapping[str, float]
    speeds: tuple[float, float] | None = None
