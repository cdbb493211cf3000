"""Motors listed in a wrong order: refused at the lag that the fit finds, or without any inertia."""

import pytest

import flown
from rotorfit.errors import FrameError
from rotorfit.model.parameters import INERTIA
from rotorfit.model.vehicle import Rotor, Vehicle

pytestmark = pytest.mark.flights

PLACES = (
    ((-0.0455, -0.0635, 0.0), "cw"),
    ((0.0455, -0.0635, 0.0), "ccw"),
    ((-0.0455, 0.0635, 0.0), "ccw"),
    ((0.0455, 0.0635, 0.0), "cw"),
)
"""Of the CineRat, in the order of its logs."""
REFUSED = [
    ("271", "2134"),  # crazyflie
    *(pytest.param(log, order, marks=pytest.mark.slow) for log, order in (
        ("271", "4123"), ("230", "1243"), ("230", "2134"), ("340", "1243"), ("340", "4312"),
    )),
]  # fmt: skip
"""Of lags that are tried before the fit, 0.1 s allows the first, third and fourth."""


def declared(order):
    return Vehicle(
        rotors=tuple(Rotor(position=p, spin=s) for p, s in (PLACES[int(i) - 1] for i in order))
    )


@pytest.fixture
def identified(indiflight_logs, tmp_path):
    """Identify a log by its commands, with the motors in some order."""

    def result(log, order):
        path = tmp_path / "experiment.toml"
        flight = indiflight_logs / f"LOG00{log}.BFL"
        extra = '[motors]\nspeed = "commanded"\n'
        flown.experiment_file(path, declared(order), [flight], mass=0.428, extra=extra)
        return flown.quietly_identified(path)

    return result


@pytest.mark.parametrize(("log", "order"), REFUSED)
def test_a_wrong_order_is_refused_with_the_right_one(identified, log, order):
    with pytest.raises(FrameError, match="with your rotors listed in the order") as refused:
        identified(log, order)
    assert 'layout = "quad-x", order = "betaflight"' in str(refused.value)


@pytest.mark.slow
@pytest.mark.parametrize(("log", "order"), [("340", "2134"), ("230", "1432")])
def test_what_is_not_refused_has_no_inertia(identified, log, order):
    """A calm throw hardly shows an order."""
    result = identified(log, order)
    for name in INERTIA:
        assert result.parameter(name, "A").value is None


@pytest.mark.parametrize(
    "log", ["271", *(pytest.param(n, marks=pytest.mark.slow) for n in ("230", "340"))]
)
def test_the_right_order_stands(identified, log):
    result = identified(log, "1234")
    # The motors are strong: the thrust at full command is far from that of any flight.
    kt = result.parameter("kt")
    assert kt.verdict in ("identified", "weak")
    assert kt.interval[0] > 0.0
    assert result.parameter("Ixx", "A").value > 0.0
