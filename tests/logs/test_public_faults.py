"""Logs of the kinds that people post, each with what is right about it."""

import pytest

from rotorfit.flight.motors.rotor_telemetry import telemetry
from rotorfit.logs import read_log
from rotorfit.logs.proposal import propose_columns

pytestmark = pytest.mark.flights


@pytest.fixture
def fault(flight_data_dir):
    def find(name):
        path = flight_data_dir / "public-faults" / name
        if not path.exists():
            pytest.skip(f"no {name}")
        return path

    return find


def test_a_decoded_blackbox_log(fault):
    columns = propose_columns(fault("fail-blackbox-decode-motors.csv")).columns
    assert (columns["command_4"].name, columns["command_4"].range) == ("motor[3]", (48.0, 2047.0))
    rotor = columns["rotor_4"]
    assert (rotor.name, rotor.unit, rotor.scale) == ("eRPM[3]", "erpm", 100.0)


def test_an_export_of_plotjuggler(fault):
    proposal = propose_columns(fault("fail-plotjuggler-12-controls.csv"))
    assert sum(name.startswith("command") for name in proposal.columns) == 4
    assert any("the log itself (.ulg" in reason for reason in proposal.reasons)


def test_a_converted_flight_record_of_dji(fault):
    proposal = propose_columns(fault("fail-datcon-tick-as-ns.csv"))
    assert proposal.columns["time"].name == "Clock:offsetTime"
    assert proposal.columns["rotor_1"].unit == "rpm"


def test_dataflash_as_text(fault):
    log = read_log(fault("fail-dataflash-text.log"))
    assert log.format == "dataflash"
    assert {"gyro", "accel", "command"} <= set(log.channels)


def test_a_servo_among_the_outputs_of_mavros(fault):
    log = read_log(fault("fail-rcout-moving-servo.mcap"))
    assert log.channels["command"].values.shape[1] == 4
    assert any("Output 5" in note and "columns = {" in note for note in log.notes)


def test_motors_beside_auxiliary_outputs(fault, assert_wording):
    source = read_log(fault("fail-px4-aux-instance.ulg")).channels["command"].source
    assert source.startswith("actuator_outputs.output[0, 1, 2, 3],")
    assert "1000..2000 (PWM_MIN" in source
    assert_wording(source)


def test_commands_with_spikes_go_with_the_speeds(fault):
    found = telemetry(read_log(fault("fail-command-spikes.csv")))
    assert found is not None
    assert [rotor.state for rotor in found.rotors] == ["follows"] * 4
    assert len(found.doubts) == 1


def test_one_cause_is_named(fault):
    found = telemetry(read_log(fault("fail-rotor1-half-speed.csv")))
    assert found is not None
    assert [rotor.state for rotor in found.rotors] == ["unlike", *["follows"] * 3]
    assert found.rotors[0].ratio == pytest.approx(0.5, abs=0.05)
