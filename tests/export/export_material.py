"""A result with fixed numbers to export, and the same vehicle for an independent Newton-Euler."""

import datetime
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rotorfit.export.write import export
from rotorfit.model.parameters import DERIVED, INERTIA, PARAMETERS
from rotorfit.model.vehicle import Rotor, Vehicle
from rotorfit.results.result import (
    Derived,
    FlightRecord,
    IdentificationResult,
    Parameter,
)

sys.path.append(str(Path(__file__).parents[1] / "model"))
from newton_euler import Body, balanced_motion

DATE = datetime.date(2026, 11, 21)
MASS = 1.285
COM = np.array([0.004, -0.003, 0.012])
INERTIA_COM = np.array(
    [[0.0182, 0.00035, 0.0009], [0.00035, 0.0196, -0.0004], [0.0009, -0.0004, 0.0288]]
)
KT = 3.63e-6
KT_EACH = KT * np.array([1.02, 0.98, 1.01, 0.99])
KD = 5.11e-8
JR = 2.1e-5
LAG = 0.035
IMU = np.array([0.01, 0.0, -0.02])
ROTORS = (  # front right ccw, rear left ccw, front left cw, rear right cw, not quite square
    ((0.15, -0.16, 0.03), "ccw"),
    ((-0.14, 0.16, 0.03), "ccw"),
    ((0.15, 0.16, 0.03), "cw"),
    ((-0.14, -0.16, 0.03), "cw"),
)
LINEAR_LAW = {"linear": [60.0, 1040.0]}
UNKNOWN: dict[str, Any] = {"value": None, "std": None, "interval": None}


def steiner(mass, com):
    return mass * (com @ com * np.eye(3) - np.outer(com, com))


def elements(tensor):
    places = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    return dict(zip(INERTIA, (float(tensor[place]) for place in places), strict=True))


def interval_of(value):
    half = 0.01 * abs(value) + 1e-12
    return value - half, value + half


def parameter(name, value, configuration=None, **changes):
    fields: dict[str, Any] = {
        "name": name,
        "configuration": configuration,
        "value": value,
        "std": abs(value) * 0.005,
        "interval": interval_of(value),
        "unit": PARAMETERS[name].unit,
        "verdict": "identified",
    }
    return Parameter(**(fields | changes))


def derived(name, value, configuration=None, **changes):
    fields: dict[str, Any] = {
        "name": name,
        "configuration": configuration,
        "value": value,
        "std": abs(value) * 0.005,
        "interval": interval_of(value),
        "unit": DERIVED[name].unit,
    }
    return Derived(**(fields | changes))


def a_result(
    *,
    rotors=ROTORS,
    imu=IMU,
    law=LINEAR_LAW,
    mass=MASS,
    com=COM,
    inertia_com=INERTIA_COM,
    configuration="A",
    axes=None,
):
    """A result in which everything is identified; change it with `with_parameter`."""
    count = len(rotors)
    kt_each = [KT_EACH[i % 4] for i in range(count)]
    origin = elements(inertia_com + steiner(mass, com))
    shared = [
        parameter("kt", KT),
        *(parameter(f"kt_{i + 1}", float(k)) for i, k in enumerate(kt_each)),
        parameter("kd", KD),
        parameter("Jr", JR),
    ]
    shared += [parameter("motor_lag", LAG)] if law is not None else []
    own = [
        parameter("mass", mass, configuration, std=None, interval=None, verdict="given"),
        *(
            parameter(f"ms{a}", float(mass * c), configuration)
            for a, c in zip("xyz", com, strict=True)
        ),
        *(parameter(name, value, configuration) for name, value in origin.items()),
    ]
    about = {f"{name}_com": value for name, value in elements(inertia_com).items()}
    numbers = [
        *(derived(f"com_{a}", float(c), configuration) for a, c in zip("xyz", com, strict=True)),
        *(derived(name, value, configuration) for name, value in about.items()),
        derived("kd_over_Izz", KD / float(inertia_com[2, 2]), configuration),
        derived("Jr_over_Izz", JR / float(inertia_com[2, 2]), configuration),
    ]
    axes = axes or [(0.0, 0.0, 1.0)] * count
    airframe: dict[str, Any] = {
        "axes": "FLU",
        "rotors": [
            {"position": list(p), "spin": s, "axis": list(n)}
            for (p, s), n in zip(rotors, axes, strict=True)
        ],
        "order": "px4",
    }
    if imu is not None:
        airframe["imu"] = {"position": [float(v) for v in imu], "position_std": 0.0}
    motors: dict[str, Any] = {"speed": "measured" if law is None else "commanded"}
    if law is not None:
        motors["law"] = law
    return IdentificationResult(
        name="export me",
        method="banded",
        parameters=(*shared, *own),
        derived=tuple(numbers),
        flights=(
            FlightRecord(
                file="/home/someone/logs/A1--long.csv",
                sha256="0123456789abcdef" * 4,
                configuration=configuration,
                seconds_used=61.2,
                samples_used=12240,
                used=((3.0, 64.2),),
                cuts=(),
            ),
        ),
        covariance_names=(),
        covariance=np.zeros((0, 0)),
        settings={
            "name": "export me",
            "airframe": airframe,
            "motors": motors,
            "identification": {"source": "imu", "method": "banded"},
            "configuration": [
                {"name": configuration, "mass": mass, "flights": [{"file": "A1--long.csv"}]}
            ],
        },
        versions={"rotorfit": "0.1.0", "numpy": "2.0.0"},
    )


def changed(result, **by_name):
    """Return the result with fields of parameters and derived numbers changed, None: left out."""

    def edit(entries):
        out = []
        for entry in entries:
            change = by_name.get(entry.name, {})
            if change is not None:
                out.append(replace(entry, **change))
        return tuple(out)

    return replace(result, parameters=edit(result.parameters), derived=edit(result.derived))


def not_identified(verdict="not-identified", reason="the interval is wider than the value itself"):
    return {**UNKNOWN, "verdict": verdict, "reason": reason}


YAW_LOST = {
    "kd": {**UNKNOWN, "verdict": "ratio-only", "partner": "Izz", "reason": "only ratios"},
    "Izz": {**UNKNOWN, "verdict": "ratio-only", "partner": "kd", "reason": "only ratios"},
    "Izz_com": UNKNOWN,
}
"""What a flight without yaw leaves: the ratio alone."""


def flat(**changes):
    """The same vehicle with equal rotors and without rotor inertia, as some tools have it."""
    result = a_result(**changes)
    unequal = {f"kt_{i}": None for i in range(1, 17)}
    return changed(result, Jr=None, Jr_over_Izz=None, **unequal)


def body_of(*, kt=KT_EACH, Jr=JR, com=COM, inertia_com=INERTIA_COM, shift=(0.0, 0.0, 0.0)):
    """The vehicle for `newton_euler`."""
    return Body(
        mass=MASS,
        com=np.asarray(com),
        inertia_com=np.asarray(inertia_com),
        kt=np.asarray(kt),
        kd=KD,
        Jr=Jr,
        rotor_shift=np.asarray(shift),
        constant=np.zeros(6),
    )


def vehicle(rotors=ROTORS, axes=None):
    axes = axes or [(0.0, 0.0, 1.0)] * len(rotors)
    return Vehicle(
        rotors=tuple(
            Rotor(position=p, spin=s, axis=n) for (p, s), n in zip(rotors, axes, strict=True)
        )
    )


RATES = np.array([0.7, -0.4, 0.9])
SPEEDS = np.array([900.0, 880.0, 955.0, 930.0])
"""Rates and rotor speeds of a moment of flight [rad/s]."""


def motion(body, rotors, *, rates=RATES, speeds=SPEEDS, spin_up=None):
    """Return specific force at the origin and angular acceleration by `newton_euler`."""
    w, O = np.asarray(rates)[None], np.asarray(speeds)[None]
    dO = np.zeros_like(O) if spin_up is None else np.asarray(spin_up)[None]
    alpha, dw = balanced_motion(body, rotors, w, O, dO)
    return alpha[0], dw[0]


def com_acceleration(body, alpha, dw, rates=RATES):
    """Return the specific force at the CoM of one at the origin."""
    c, w = body.com, np.asarray(rates)
    return alpha + np.cross(dw, c) + np.cross(w, np.cross(w, c))


def text_of(result, target, **options):
    return export(result, target, date=DATE, **options).text


def saved(tmp_path, result, target, name, **options):
    path = tmp_path / name
    path.write_text(text_of(result, target, **options), encoding="utf-8")
    return path
