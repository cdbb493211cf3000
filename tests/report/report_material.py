"""Results and comparisons to report on, without a flight behind them."""

from typing import Any

import numpy as np

from rotorfit.findings import doubt
from rotorfit.results.command_law import CommandLaw, LawNumber, LawPoint
from rotorfit.results.result import Derived, FlightRecord, IdentificationResult, Parameter
from rotorfit.results.validation.wrench_comparison import COMPONENTS, WrenchComparison

ROTORS = [
    {"position": [0.1, -0.2, 0.01], "spin": "ccw"},
    {"position": [-0.1, 0.2, 0.01], "spin": "ccw"},
    {"position": [0.1, 0.2, 0.01], "spin": "cw"},
    {"position": [-0.1, -0.2, 0.01], "spin": "cw"},
]
VERDICTS = ("identified", "weak", "ratio-only", "not-identified", "given", "removed")
FOUND = CommandLaw(
    form="power",
    numbers=(
        LawNumber(name="full_speed", value=1000.0, interval=(990.0, 1010.0), unit="rad/s"),
        LawNumber(name="exponent", value=1.0, interval=(0.99, 1.01), unit="1"),
    ),
    nominal_voltage=None,
    known=True,
    commands=(0.2, 0.8),
    relative_error=0.05,
    held_out={"power": 1.0},
    rotor_factors=(None,) * 4,
    points=(LawPoint(command=0.5, low=480.0, median=500.0, high=520.0),),
    motors={},
    estimator="",
)
"""A law between commands and measured speeds."""
NAMES = ("msx", "msy", "msz", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")


def parameter(name: str, configuration: str | None, **changes: Any) -> Parameter:
    fields: dict[str, Any] = {
        "name": name,
        "configuration": configuration,
        "value": 0.0123,
        "std": 0.0001,
        "interval": (0.0121, 0.0125),
        "unit": "kg m^2",
        "verdict": "identified",
    }
    return Parameter(**(fields | changes))


UNKNOWN: dict[str, Any] = {"value": None, "std": None, "interval": None}


def a_result(
    *,
    name: str = "two payloads",
    configurations: tuple[str, ...] = ("A", "B"),
    file: str = "/home/someone/logs/A1.csv",
    words: str = "yaw while rolling: fly 20 s of alternating turns",
    **changes: Any,
) -> IdentificationResult:
    """A result with every verdict in it."""
    parameters = [
        parameter(
            "kt", None, value=3.63e-6, std=1e-8, interval=(3.61e-6, 3.65e-6), unit="N s^2/rad^2"
        ),
        parameter(
            "kd",
            None,
            **UNKNOWN,
            verdict="ratio-only",
            partner="Izz",
            reason="only ratios",
            advice=words,
        ),
        parameter("Jr", None, **UNKNOWN, verdict="removed", reason="unessential"),
    ]
    derived = [
        Derived(
            name="kd_over_kt",
            configuration=None,
            value=0.0141,
            std=1e-4,
            interval=(0.0139, 0.0143),
            unit="m",
        )
    ]
    for c in configurations:
        parameters.append(
            parameter("mass", c, value=1.285, std=None, interval=None, unit="kg", verdict="given")
        )
        for n in NAMES:
            parameters.append(parameter(n, c))
        parameters[-4] = parameter(
            "Izz", c, **UNKNOWN, verdict="not-identified", reason=words, advice=words
        )
        parameters[-1] = parameter(
            "Iyz", c, verdict="weak", reason="known only to +-30 %", advice=words
        )
        derived += [
            Derived(
                name=f"com_{a}",
                configuration=c,
                value=0.01,
                std=5e-4,
                interval=(0.009, 0.011),
                unit="m",
            )
            for a in "xyz"
        ]
        derived += [
            Derived(
                name=f"{n}_com",
                configuration=c,
                value=v,
                std=1e-4,
                interval=(0.0119, 0.0123),
                unit="kg m^2",
            )
            if n != "Izz"
            else Derived(name="Izz_com", configuration=c, **UNKNOWN, unit="kg m^2")
            for n, v in zip(NAMES[3:], [0.0121] * 6, strict=True)
        ]
    names = ("kt", *(f"{n}@{c}" for c in configurations for n in NAMES if n != "Izz"))
    root = np.random.default_rng(1).normal(size=(len(names), len(names)))
    settings = {
        "name": name,
        "airframe": {
            "axes": "FLU",
            "rotors": ROTORS,
            "order": "px4",
            "imu": {"position": [0.03, 0.0, 0.02], "position_std": 0.0},
        },
        "motors": {"speed": "measured"},
        "identification": {"source": "imu", "preset": "paper"},
        "configuration": [
            {
                "name": c,
                "mass": 1.285,
                "flights": [{"file": file}],
                "payload": [{"mass": 0.125, "position": [0.375, 0.0, -0.02]}],
            }
            for c in configurations
        ],
    }
    fields: dict[str, Any] = {
        "name": name,
        "method": "ols",
        "parameters": tuple(parameters),
        "derived": tuple(derived),
        "flights": tuple(
            FlightRecord(
                file=file,
                sha256="ab" * 32,
                configuration=c,
                seconds_used=61.2,
                samples_used=12240,
                used=((3.0, 30.0), (31.0, 65.2)),
                cuts=((0.0, 3.0, "not airborne"), (30.0, 31.0, "gap in the log")),
                findings=(doubt("made", words),),
            )
            for c in configurations
        ),
        "covariance_names": names,
        "covariance": root @ root.T,
        "settings": settings,
        "versions": {"rotorfit": "0.1.0", "numpy": "2.0.0"},
        "findings": (doubt("made", words),),
        "diagnostics": {"excitation_roll": 23.0, "excitation_yaw": 2.0, "condition_roll": 112.0},
    }
    return IdentificationResult(**(fields | changes))


def a_comparison(
    *,
    configuration: str = "A",
    flight: str = "logs/A2.csv",
    seconds: float = 75.0,
    rate: float = 200.0,
    seed: int = 1,
) -> WrenchComparison:
    """Lively wrenches with a cut of two seconds in the middle."""
    rng = np.random.default_rng(seed)
    time = np.arange(round(seconds * rate)) / rate
    time = np.where(time > seconds / 2, time + 2.0, time)
    turns = np.sin(2 * np.pi * np.outer(time, [0.3, 0.4, 0.5, 1.1, 1.3, 0.7]))
    rotor = turns * [0.1, 0.1, 3.0, 0.3, 0.3, 0.05] + [0, 0, 12.6, 0, 0, 0]
    body = rotor + rng.normal(size=rotor.shape) * [0.05, 0.05, 0.2, 0.01, 0.01, 0.005]
    error = np.linalg.norm(body - rotor, axis=0) / (np.linalg.norm(rotor, axis=0) + 1e-9)
    return WrenchComparison(
        configuration=configuration,
        flight=flight,
        sha256="cd" * 32,
        used_in_fit=False,
        time=time,
        body_wrench=body,
        rotor_wrench=rotor,
        relative_error=dict(zip(COMPONENTS, error.tolist(), strict=True)),
        whiteness=dict.fromkeys(COMPONENTS, 0.05),
    )
