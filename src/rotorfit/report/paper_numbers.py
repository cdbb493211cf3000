"""The numbers of Six, Briot, Erskine and Chriette, ICRA 2020, Tables I to III, as data.

Identification of the Propeller Coefficients and Dynamic Parameters of a Hovering Quadrotor from
Flight Data. Values in SI, each with %sigma (eq. 22), None where the table has none.
"""

from typing import Final

Entry = tuple[float, float | None]

MASSES: Final = {"A": 1.285, "B": 1.452}
"""Weighed [kg]."""

TABLE_1: Final[dict[str, dict[str, Entry]]] = {
    "A": {
        "msx": (-4.32e-3, 2.70),
        "msy": (-1.95e-3, 6.88),
        "msz": (-6.16e-3, 4.55),
        "Ixx": (1.69e-2, 1.52),
        "Iyy": (1.76e-2, 1.45),
        "kt": (3.46e-6, 0.05),
    },
    "B": {
        "msx": (4.30e-2, 0.31),
        "msy": (-2.01e-2, 0.80),
        "msz": (-1.22e-2, 4.20),
        "Ixx": (2.43e-2, 1.95),
        "Iyy": (3.58e-2, 1.63),
        "Izz": (4.75e-2, 7.36),
        "kt": (3.65e-6, 0.04),
        "kd": (5.40e-8, 7.68),
    },
}
"""Each configuration alone, from the IMU."""

TABLE_2: Final[dict[str, dict[str, Entry]]] = {
    "A": {
        "msx": (-4.54e-3, 3.35),
        "msz": (-8.31e-3, 5.62),
        "Ixx": (1.82e-2, 1.84),
        "Iyy": (1.86e-2, 1.79),
        "Izz": (2.88e-2, 4.90),
        "kt": (3.63e-6, 0.03),
        "kd": (5.11e-8, 3.84),
    },
    "B": {
        "msx": (4.28e-2, 0.18),
        "msy": (-1.99e-2, 0.47),
        "msz": (-1.30e-2, 3.20),
        "Ixx": (2.42e-2, 1.11),
        "Iyy": (3.57e-2, 0.93),
        "Izz": (4.76e-2, 3.71),
        "kt": (3.63e-6, 0.03),
        "kd": (5.11e-8, 3.84),
    },
}
"""Both configurations in one estimate, from the IMU; kt and kd are shared."""

TABLE_2_MOCAP: Final[dict[str, dict[str, Entry]]] = {
    "A": {"Ixx": (1.88e-2, 3.49), "Iyy": (1.93e-2, 2.77), "kt": (3.68e-6, None)},
    "B": {
        "msx": (4.25e-2, None),
        "msy": (-1.97e-2, None),
        "msz": (-1.20e-2, None),
        "Ixx": (2.42e-2, None),
        "Iyy": (3.84e-2, None),
        "kt": (3.68e-6, None),
    },
}
"""The same from motion capture, as far as our copy gives it."""

TABLE_3: Final[dict[str, dict[str, float]]] = {
    "A alone, on A": {"Fz": 10.46, "Mx": 46.15, "My": 43.73},
    "B alone, on B": {"Fz": 4.40, "Mx": 20.99, "My": 10.70, "Mz": 45.19},
    "A and B together, on A": {"Fz": 8.47, "Mx": 47.07, "My": 42.96, "Mz": 68.13},
}
"""Relative error norms [%]."""

ILLEGIBLE: Final = {
    "Table I": (
        "For A the paper dropped kd, Izz and the products of inertia as unessential (III-B)."
    ),
    "Table II": (
        "The paper's standard deviations for motion capture, and some of its values, are not "
        "legible in our copy; they are left out here, and so is what the table does not list (–)."
    ),
    "Table III": "The last row (A and B together, on B) is not legible in our copy.",
}
"""What is missing, and why."""
