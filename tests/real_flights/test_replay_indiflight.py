"""The replay of a real log: identified parameters beside those of the bench."""

import pytest
from benchmarks.replay import LOGS_SHOWN, fitted, replayed, table

from rotorfit.results.validation.replay import HOLD, error_growth, force_errors

pytestmark = pytest.mark.flights
LIVELY = LOGS_SHOWN[0]


@pytest.fixture(scope="module")
def replays(indiflight_logs, tmp_path_factory):
    result = fitted([indiflight_logs / LIVELY], tmp_path_factory.mktemp("replay"))
    return replayed(result, indiflight_logs / LIVELY)


def test_it_beats_the_bench_where_the_bench_knows_no_com(replays):
    assert len(replays[0].time) == 61
    own, plain = (
        error_growth(replays, name)[-1] for name in ("identified", "bench, CoM in the middle")
    )
    assert (own[:2] < 0.6 * plain[:2]).all()
    assert own[2] < 1.1 * plain[2]


def test_bench_inertia_is_no_better_with_the_identified_com(replays):
    early = int(0.2 * replays[0].time.shape[1])
    own, bench = (error_growth(replays, name) for name in ("identified", "bench"))
    assert (own[-1] < 1.1 * bench[-1]).all()
    assert own[early, 0] < 0.85 * bench[early, 0]
    assert own[early, 2] < 0.85 * bench[early, 2]


def test_100_ms_are_predicted_far_better_than_by_a_held_rate(replays):
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
