"""A log too slow for its motors is to be logged faster, whichever command looks at it."""

import pytest

from rotorfit import identify
from rotorfit.fit.experiment.experiment import single_flight_experiment
from rotorfit.logs import read_log
from rotorfit.report.log_report import prospect_messages
from rotorfit.tools.inspection.inspect_log import inspect_log
from rotorfit.tools.planning.next_step import next_step

pytestmark = pytest.mark.flights


@pytest.mark.filterwarnings("ignore::rotorfit.errors.RotorfitWarning")
def test_esc_telemetry_at_4_hz_asks_for_a_faster_log_first(flight_data_dir):
    folder = flight_data_dir / "public-faults"
    log, airframe = folder / "fail-advice-in-vain-esc-4hz.ulg", folder / "airframe-px4-ekf.toml"
    report = inspect_log(read_log(log))
    assert report.next_step is not None
    assert report.next_step.kind == "log"
    assert "SDLOG_PROFILE = 17" in report.next_step.action
    assert not any("well" in words for words in prospect_messages(report.prospects))

    result = identify(single_flight_experiment(log, mass=1.5, airframe=airframe))
    assert next_step(result).kind == "log"
    assert next_step(result).action == report.next_step.action
    times = {p.name: p for p in result.parameters if p.unit == "s"}
    assert times["motor_lag"].value is None
    assert times["command_delay"].value is None
    assert result.command_law is not None
    assert "lag" not in result.command_law.motors
