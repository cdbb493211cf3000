"""A motor that is at the end of its range for a part of the flight is named."""

from dataclasses import replace

import numpy as np
import pytest

import made_fit
from rotorfit.diagnostics.changed_rotor import motors_at_limit


@pytest.mark.parametrize(("largest", "share"), [(np.inf, 0.001), (0.5, 0.333)])
def test_a_clipped_motor_is_named(largest, share):
    prepared = made_fit.prepared()
    swing = np.sin(np.linspace(0.0, 60.0, len(prepared.data.time)))[:, None] * np.ones(4)
    prepared = replace(prepared, motor_channel=0.5 + 0.5 * np.minimum(swing, largest))
    [found] = motors_at_limit(made_fit.fit(made_fit.dataset(prepared)))
    assert found.diagnostics["motors_at_limit@A0.csv"] == pytest.approx(share, abs=0.02)
    assert (found.severity == "doubt") is (share > 0.05)
