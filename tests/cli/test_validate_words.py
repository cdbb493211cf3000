"""What `rotorfit validate` says its percentages are worth."""

import numpy as np
import pytest

from rotorfit.cli.validate import validation_text
from rotorfit.report.parameters import NOTHING_PREDICTED
from rotorfit.results.validation.judgement import judgement
from rotorfit.results.validation.wrench_comparison import WrenchComparison


def flight(**errors: float) -> WrenchComparison:
    return WrenchComparison(
        configuration="A",
        flight="calm.bfl",
        sha256="",
        used_in_fit=False,
        time=np.zeros(1),
        body_wrench=np.zeros((1, 6)),
        rotor_wrench=np.zeros((1, 6)),
        relative_error=errors,
        whiteness={},
    )


@pytest.mark.parametrize(("yaw", "said"), [(0.9999, False), (1.0, True), (1.0193, True)])
def test_a_component_of_which_nothing_is_predicted_is_named(yaw, said, assert_wording):
    flights = [flight(Fz=0.01, Mx=0.1, My=0.2), flight(Fz=0.02, Mz=yaw)]
    text = validation_text(flights, [judgement((), comparisons=[one]) for one in flights])
    words = " ".join(text.split())
    assert (NOTHING_PREDICTED in words) == said
    assert "to 5 %" in words
    assert "to 30 %" in words
    assert_wording(words)
    assert f"{100 * yaw:.0f}\n" in text
    assert max(map(len, text.splitlines())) <= 80
