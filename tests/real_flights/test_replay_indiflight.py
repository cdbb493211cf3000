"""The replay of a real log: identified parameters beside those of the bench."""

import pytest
from benchmarks.replay import LOGS_SHOWN, fitted, replayed, table

from rotorfit.errors import ExperimentError
from rotorfit.identification.replay import HOLD, error_growth, force_errors

pytestmark = pytest.mark.flights
LIVELY, SHORT, CALM = LOGS_SHOWN


@pytest.fixture(scope="module")
def logs(flight_data_dir):
    folder = flight_data_dir / "tudelft-indiflight"
    if not folder.is_dir():
        pytest.skip(f"no {folder}")
    return folder


@pytest.fixture(scope="module")
def replays(logs, tmp_path_factory):
    result = fitted([logs / LIVELY], tmp_path_factory.mktemp("replay"))
    return replayed(result, logs / LIVELY)


def test_it_beats_the_bench_in_roll_and_pitch_and_equals_it_in_yaw(replays):
    assert len(replays[0].time) == 61
    own, bench, plain = (
        error_growth(replays, name)[-1]
        for name in ("identified", "bench", "bench, CoM in the middle")
    )
    assert own[0] < 0.6 * bench[0]
    assert own[1] < 0.85 * bench[1]
    assert own[2] < 1.15 * bench[2]
    assert (own[:2] < 0.6 * plain[:2]).all()
    assert own[2] < 1.05 * plain[2]


def test_a_tenth_of_a_second_is_predicted_far_better_than_by_holding_the_rate(replays):
    early = int(0.2 * replays[0].time.shape[1])
    own, held = (error_growth(replays, name)[early] for name in ("identified", HOLD))
    assert (own < 0.45 * held).all()


def test_thrust_is_predicted(replays):
    own, held = (force_errors(replays, name) for name in ("identified", HOLD))
    assert own[2] < 1.0
    assert own[2] < 0.25 * held[2]


def test_the_table_has_them_all(replays):
    lines = table(replays)
    assert len(lines) == 7
    assert [line[:10] for line in lines[2:4]] == ["identified", "bench     "]


def test_a_com_that_the_flights_do_not_give_is_not_taken_as_none(logs, tmp_path):
    result = fitted([logs / SHORT, logs / CALM], tmp_path)
    if result.derived_value("com_x").value is None:
        with pytest.raises(ExperimentError, match="com_x"):
            replayed(result, logs / LIVELY)
    else:
        assert error_growth(replayed(result, logs / LIVELY), "identified")[-1].max() < 15.0
