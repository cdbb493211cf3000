"""What the flight says of a gyro whose scale is off, and how it enters the intervals."""

import numpy as np

from rotorfit.checks.sensors.gyro_scale import scale_finding
from rotorfit.fit.dataset.gyro_by_velocity import GyroScale


def test_the_axes_that_are_off_are_named(assert_text) -> None:
    value = np.array([0.041, 0.002, -0.03])
    found = scale_finding(GyroScale(value=value, std=np.full(3, 0.004), degrees=9))
    assert found.severity == "doubt"
    assert_text(found.sentence)
    assert found.diagnostics == {
        "gyro_scale_roll": 0.041, "gyro_scale_pitch": 0.002, "gyro_scale_yaw": -0.03
    }  # fmt: skip


def test_a_scale_that_chance_makes_is_not_said() -> None:
    found = scale_finding(GyroScale(value=np.full(3, 0.02), std=np.full(3, 0.012), degrees=9))
    assert found.severity == "passed"
    assert found.evidence[0].interval is not None
    assert found.evidence[0].interval[1] > 0.04
