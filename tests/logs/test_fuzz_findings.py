"""What benchmarks/fuzz.py found, one test each."""

import blackbox_encoder as encoder
import pytest

from rotorfit.errors import ExperimentError, LogError
from rotorfit.identification.experiment import load_experiment
from rotorfit.logs import read_log


def test_a_blackbox_clock_that_runs_backwards_gives_no_negative_length(tmp_path):
    recorder = encoder.Recorder(i_interval=1)
    names = [f"gyroADC[{axis}]" for axis in range(3)]
    recorder.main_fields = [*encoder.MAIN_FIELDS[:2], *[(name, 1, 0, 0, 0, 0) for name in names]]
    times = [*range(5_000_000, 7_000_000, 100_000), *range(1_000_000, 4_000_000, 100_000)]
    for k, time in enumerate(times):
        recorder.record([k, time, k, -k, 7], is_intra=True)
    recorder.end()
    path = tmp_path / "back.bbl"
    path.write_bytes(bytes(recorder.data))
    assert read_log(path).seconds == pytest.approx(5.9)


@pytest.mark.parametrize("content", ["name = " + "9" * 5000, "name = " + "[" * 20_000])
def test_a_toml_that_python_cannot_read_is_no_toml(tmp_path, content):
    path = tmp_path / "experiment.toml"
    path.write_text(content)
    with pytest.raises(ExperimentError, match=r"experiment\.toml is not valid TOML"):
        load_experiment(path)


def test_a_refusal_stays_short_where_names_are_long(tmp_path):
    path = tmp_path / "flight.csv"
    path.write_text("(" * 9000 + "time,gyro_x\n1,2\n")
    with pytest.raises(LogError) as caught:
        read_log(path)
    message = str(caught.value)
    assert 1500 < len(message) < 2000
    assert message.startswith(f"{path}: no column 'time'; the file has ((((")
    assert message.endswith("with a unit where it is not SI")
    assert message.count(" [...] ") == 1
