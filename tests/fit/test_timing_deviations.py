"""The deviations of the motors' timing, and the way to it, from fits that are made up."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

import made_fit
from rotorfit.errors import UnsettledError
from rotorfit.estimation.factors import Factors
from rotorfit.fit.experiment.experiment import MotorsEntry
from rotorfit.fit.reduction.motor_timing import (
    FreeTiming,
    MotorTiming,
    is_time_identifiable,
    skew_of,
)
from rotorfit.fit.sensors.lateness import Lateness
from rotorfit.fit.timing import timing_fit, timing_search
from rotorfit.fit.timing.timed_dataset import TimedDataset
from rotorfit.fit.timing.timed_fit import TimedFit
from rotorfit.fit.timing.timing_faults import hold_fault, shape_fault
from rotorfit.fit.timing.timing_fit import (
    find_timing,
    first_fit,
    fitted_timing,
    settled_fit,
    timed_again,
    timing_with_deviations,
    unidentifiable_timing,
)
from rotorfit.fit.timing.timing_search import coarse_timing, gust_bias, liveliest
from rotorfit.flight.motors.motor_model import MotorResponse

MS = 1e-3
COMMANDED = MotorsEntry(speed="commanded")
AT = MotorResponse(lag=0.040, delay=0.010)
TRIED = MotorResponse(lag=0.040)
"""Where the search begins that finds all trials alike."""
BOTH = ("motor_lag", "motor_delay")


def norm(*parts):
    return MS * np.sqrt(np.sum(np.square(parts)))


@dataclass(frozen=True, kw_only=True)
class BandedFlights(TimedDataset):
    """Flights whose bands are given, one per configuration, at any timing of the motors."""

    given: tuple[Factors, ...]

    def bands(self, response=None, **more):
        return self.given

    @property
    def timed_bands(self):
        times = 0 if self.free_timing is None else len(self.free_timing.names)
        return tuple(
            replace(one, slopes=np.zeros((len(one), times, *one.R.shape[1:]))) if times else one
            for one in self.given
        )

    def moved_along_lines(self, response):
        return self.at(response, self.free_timing.names)


def dataset(*flights, motors=COMMANDED, given=None, **more):
    """Return flights that turn so much above the pilot's band that no gusts matter."""
    flights = flights or (made_fit.prepared(),)
    made = made_fit.dataset(*flights, motors=motors, **more)
    return made_fit.as_kind(BandedFlights, made, given=(STEERED,) if given is None else given)


STEERED = made_fit.turned([9.0] * 3, [9.0] * 3, bands=[(1.0, 2.0), (3.0, 4.0)])


def fit_at(free, *, moved, covariance=None, influence=None):
    """Return a fit that has moved the times by so much [ms], with their covariance [ms^2]."""
    body = made_fit.configuration(timing=free)
    fit = made_fit.fit_of([body], std={}, influence=influence)
    at = [fit.estimate.names.index(name) for name in free.names]
    values, spread = fit.estimate.values.copy(), fit.estimate.covariance.copy()
    values[at] = MS * np.asarray(moved, dtype=float)
    if covariance is not None:
        spread[np.ix_(at, at)] = MS**2 * np.asarray(covariance)
    # What was known before, and what blocks' estimated variances add, is tested elsewhere.
    unknown = replace(fit.problem, prior_mean={}, prior_std={})
    estimate = replace(fit.estimate, values=values, covariance=spread)
    moved = replace(fit, estimate=estimate, problem=unknown)
    return made_fit.with_known_variances(moved)


def chance(times):
    """Of 12 blocks of 6 equations, those are left that 12 parameters and the times do not cost.

    Student's t of those over 1.96, and more by the root of how many were lost.
    """
    left = 12 - (12 + times) / 6
    return stats.t.ppf(0.975, left) / 1.96 * np.sqrt(12 / left)


COVARIANCE = [[16.0, -6.0], [-6.0, 9.0]]
"""Of lag and delay: 4 and 3 ms, and 13 ms^2 of their sum."""


def deviations(*, names=BOTH, hold=0.0, shifts=None, motors=COMMANDED, influence=None, gusts=0.0):
    """Return the timing where a command may hold longer by `hold` [ms]."""
    free = FreeTiming(at=AT, names=names)
    covariance = COVARIANCE if len(names) == 2 else [[16.0 if names[0] == "motor_lag" else 9.0]]
    fit = fit_at(free, moved=[0.5] * len(names), covariance=covariance, influence=influence)
    if shifts is not None:
        rows = np.zeros((len(shifts), len(fit.estimate.names)))
        rows[:, [fit.estimate.names.index(name) for name in names]] = MS * np.array(shifts)
        fit = made_fit.moved_by_responses(fit, rows)
    flight = made_fit.prepared(motor_rate=0.25 / (hold * MS) if hold else np.inf)
    timed = dataset(flight, motors=motors).at(free.at, free.names)
    return timing_with_deviations(TimedFit(timed, fit), gusts=gusts * MS)


def test_lag_and_delay_deviations_add_fit_and_model_faults():
    """.1 ms of the sum and .3 ms of the split that no curvature shows."""
    found = deviations(hold=1.5)
    c = chance(2)
    assert c == pytest.approx(1.27, abs=0.01)
    assert found.lag_std == pytest.approx(norm(4 * c, 0.3), rel=1e-6)
    assert found.delay_std == pytest.approx(norm(3 * c, 0.3, 1.5), rel=1e-6)
    assert found.total_std == pytest.approx(norm(13**0.5 * c, 0.1, 1.5), rel=1e-6)
    assert (found.response.lag, found.response.delay) == pytest.approx((0.0405, 0.0105))
    assert found.free == BOTH


def test_what_is_assumed_of_the_autopilot_is_in_the_deviations():
    """Its answers' shifts over 1.96: of each time their sum, of lag plus delay that of both."""
    found = deviations(shifts=[[1.96, 3.92], [-1.96, 0.98]])
    c = chance(2)
    assert found.lag_std == pytest.approx(norm(4 * c, 2, 0.3), rel=1e-6)
    assert found.delay_std == pytest.approx(norm(3 * c, 2.5, 0.3), rel=1e-6)
    assert found.total_std == pytest.approx(norm(13**0.5 * c, 3.5, 0.1), rel=1e-6)


def test_block_scatter_above_the_covariance_replaces_it():
    """12 blocks that pull by 2 ms either way: a deviation of sqrt(12 * 12/11) * 2 ms."""
    pulls = {"motor_delay": 2.0 * MS * np.tile([1.0, -1.0], 6)}
    found = deviations(influence=pulls)
    scatter = 2.0 * np.sqrt(144 / 11) * chance(2)
    assert found.delay_std == pytest.approx(norm(scatter, 0.3), rel=1e-6)
    assert found.lag_std == pytest.approx(norm(4 * chance(2), 0.3), rel=1e-6)
    assert found.total_std == pytest.approx(norm(scatter, 0.1), rel=1e-6)


def test_a_lag_alone_has_the_faults_of_the_sum_and_of_the_hold():
    """With the delay given, what a command held longer than logged is taken for lag."""
    found = deviations(names=("motor_lag",), hold=1.5)
    assert (
        found.lag_std == found.total_std == pytest.approx(norm(4 * chance(1), 0.1, 1.5), rel=1e-6)
    )
    assert found.delay_std is None


def test_a_delay_alone_has_the_faults_of_the_sum_and_of_the_hold():
    found = deviations(names=("motor_delay",), hold=1.5)
    assert (
        found.delay_std == found.total_std == pytest.approx(norm(3 * chance(1), 0.1, 1.5), rel=1e-6)
    )
    assert found.lag_std is None


def test_what_gusts_leave_open_is_in_the_delay_or_in_a_lag_alone():
    found, c = deviations(gusts=10.0), chance(2)
    assert found.lag_std == pytest.approx(norm(4 * c, 0.3), rel=1e-6)
    assert found.delay_std == pytest.approx(norm(3 * c, 0.3, 10.0), rel=1e-6)
    assert found.total_std == pytest.approx(norm(13**0.5 * c, 0.1, 10.0), rel=1e-6)
    alone = deviations(names=("motor_lag",), gusts=10.0)
    assert alone.lag_std == pytest.approx(norm(4 * chance(1), 0.1, 10.0), rel=1e-6)


@pytest.mark.parametrize(("cutoffs", "fault"), [((None, 20.0), 1.125), ((40.0, None), 0.563)])
def test_a_low_pass_on_board_is_neither_a_lag_nor_a_delay(cutoffs, fault):
    """A tenth of its delay, sqrt(2) / (2 pi f), of each and of both; measured speeds have none."""

    def filtered(motors):
        whole = dataset(made_fit.prepared(motor_rate=np.inf), motors=motors)
        (one,) = whole.configurations
        flights = [
            replace(f, log=replace(f.log, gyro_lowpass=cutoff))
            for cutoff in cutoffs
            for f in one.flights
        ]
        return replace(whole, configurations=(replace(one, flights=flights),))

    free = FreeTiming(at=AT, names=BOTH)
    fit = fit_at(free, moved=[0.5, 0.5], covariance=COVARIANCE)
    found = timing_with_deviations(TimedFit(filtered(COMMANDED).at(AT, BOTH), fit))
    c = chance(2)
    assert found.lag_std == pytest.approx(norm(4 * c, 0.3, fault), rel=1e-3)
    assert found.delay_std == pytest.approx(norm(3 * c, 0.3, fault), rel=1e-3)
    assert found.total_std == pytest.approx(norm(13**0.5 * c, 0.1, fault), rel=1e-3)
    assert shape_fault(filtered(MotorsEntry())) == 0.0


def test_no_lag_is_less_sure_than_it_was_beforehand():
    bench = MotorsEntry(speed="commanded", lag=0.04, lag_std=0.002)
    found = deviations(motors=bench)
    assert found.lag_std == 0.002
    assert found.delay_std == pytest.approx(norm(3 * chance(2), 0.3))


def test_hold_time_is_uncertain_by_a_quarter_of_a_slow_sample():
    flights = made_fit.prepared(motor_rate=100.0), made_fit.prepared(motor_rate=50.0)
    assert hold_fault(made_fit.dataset(*flights, motors=COMMANDED)) == pytest.approx(0.005)
    assert hold_fault(made_fit.dataset(*flights)) == 0.0


def test_unknown_motors_have_the_usual_lag_and_30_ms_of_delay():
    both = unidentifiable_timing(dataset(), delay_free=True)
    assert (both.lag_std, both.delay_std) == (0.03, 0.03)
    assert both.total_std == pytest.approx(0.03 * 2**0.5)
    lag = unidentifiable_timing(dataset(), delay_free=False)
    assert (lag.lag_std, lag.delay_std, lag.total_std) == (0.03, None, 0.03)
    assert both.response == MotorResponse(lag=0.035)
    assert both.free == lag.free == ()


# The way there: fits that move the times to where they are least.


def fitting(monkeypatch, fit):
    """Let this stand for the fit of all that the flights tell."""
    monkeypatch.setattr(timing_fit, "joint_fit", fit)


def no_lag(at):
    """Motors without lag lose thousands of log-likelihood with any."""
    return -1e4 * (at.mean_lag > 2e-3)


def turns_leave_open(monkeypatch, std):
    """Let the turns of one flight be known in time to a deviation [ms]."""
    late = Lateness(seconds=0.0, std=std * MS)
    monkeypatch.setattr(timing_fit, "flight_spectra", lambda fit: [(None, None)])
    monkeypatch.setattr(timing_fit, "lateness", lambda spectra, axes: late)


def fits_to(monkeypatch, bottom, *, gain=0.0, skew=0.0, share=1.0, likelihood=no_lag, before=None):
    """Let every fit move the times by a share of the way to the bottom; return where it was.

    `bottom`: of fits from some times, or of all. `likelihood`: logarithm at some times. `before` is
    called with the flights of each fit and its options.
    """
    seen = []

    def joint_fit(dataset, **options):
        if before is not None:
            before(dataset, options)
        free, begin = dataset.free_timing, options.get("begin")
        seen.append((free, begin))
        end = bottom(free) if callable(bottom) else bottom
        way = {
            "motor_lag": end.mean_lag - free.at.mean_lag,
            "motor_delay": end.delay - free.at.delay,
            "motor_skew": skew - skew_of(free.at),
        }
        moved = [share * way[name] / MS for name in free.names]
        fit = fit_at(free, moved=moved, covariance=np.eye(len(free.names)))
        won = gain if "motor_skew" in free.names else 0.0
        return replace(fit, log_likelihood=5.0 + won + likelihood(free.at)), []

    fitting(monkeypatch, joint_fit)
    turns_leave_open(monkeypatch, 1.0)
    return seen


def settled_from(start, names):
    return settled_fit(timing_fit.fit_at(dataset().at(start, names), ()), ())


def test_a_fit_that_moved_far_restarts_there_without_its_times(monkeypatch):
    """No further than 20 ms a round, which is how far the slopes reach; all times by one share.

    Along the lines first, and once more where that ends.
    """
    seen = fits_to(monkeypatch, MotorResponse(lag=0.055, delay=0.012))
    timed, fit, _ = settled_from(MotorResponse(lag=0.005), BOTH)
    places = [(free.at.lag, free.at.delay) for free, _ in seen]
    expected = [(0.005, 0.0), (0.025, 0.0048), (0.045, 0.0096), (0.055, 0.012), (0.055, 0.012)]
    assert np.array(places) == pytest.approx(np.array(expected))
    assert seen[0][1] is None
    assert not set(seen[1][1]) & set(BOTH)
    assert "kt" in seen[1][1]
    assert timed.free_timing.at == seen[-1][0].at
    assert [fit.estimate.value(name) for name in BOTH] == pytest.approx([0.0, 0.0])


def turning(rate):
    flight = made_fit.prepared()
    rates = np.full_like(flight.data.angular_velocity, rate)
    return replace(flight, data=replace(flight.data, angular_velocity=rates))


def test_of_many_flights_the_liveliest_settle_first(monkeypatch):
    """And where they settle all begin, but for what only a first fit of all can tell."""
    many = dataset(*(turning(k) for k in (3, 1, 6, 2, 5, 4)))
    few = liveliest(many).configurations[0].flights
    assert [f.prepared.data.angular_velocity[0, 0] for f in few] == [3, 6, 5, 4]
    one = dataset()
    assert liveliest(one) is one
    sizes = []

    def note(dataset, options):
        sizes.append((len(dataset.configurations[0].flights), sorted(options)))

    seen = fits_to(monkeypatch, AT, before=note)
    timed, *_ = first_fit(many, MotorResponse(lag=0.03), BOTH, ())
    along, made = (4, ["begin", "close", "terms"]), (4, ["begin", "terms"])
    assert sizes == [(4, ["guess", "terms"]), along, made, (6, ["guess", "terms"])]
    assert timed.timing == AT and seen[-1][0].at == AT


def test_three_tenths_of_a_deviation_need_no_other_round(monkeypatch):
    for off, rounds in ((0.29, 1), (0.31, 2)):
        seen = fits_to(monkeypatch, AT)
        start = MotorResponse(lag=AT.lag + off * MS, delay=AT.delay)
        settled_from(start, BOTH)
        assert len(seen) == rounds


def test_a_timing_that_never_settles_is_taken_from_the_last_fit(monkeypatch):
    """Steps of 5 ms for ever: fifteen of them, none counted twice, the last one of the samples."""
    seen = fits_to(monkeypatch, MotorResponse(lag=0.040, delay=10.0), share=5e-4)
    timed, fit, _ = settled_from(AT, ("motor_delay",))
    assert len(seen) == timing_fit.MOST_ROUNDS == 15
    assert timed.free_timing.at == seen[-1][0].at
    moved = fit.estimate.value("motor_delay")
    assert timed.free_timing.at.delay + moved == pytest.approx(0.010 + 0.075, rel=0.01)


@pytest.mark.parametrize(("gain", "skewed"), [(9.9, False), (10.1, True)])
def test_rising_and_falling_lags_are_separated_from_a_gain_of_10(monkeypatch, gain, skewed):
    fits_to(monkeypatch, AT, gain=gain, skew=0.3)
    found = fitted_timing(dataset(), AT, BOTH, ())
    assert ("motor_skew" in found.free) is skewed
    assert found.response.mean_lag == pytest.approx(0.040)
    assert skew_of(found.response) == pytest.approx(0.3 if skewed else 0.0)


@pytest.mark.parametrize(("source", "lag"), [("mocap", 0.04)], ids=["motion capture"])
def test_where_a_skew_changes_no_signal_none_is_asked_for(monkeypatch, source, lag):
    seen = fits_to(monkeypatch, MotorResponse(lag=lag, delay=0.01), gain=1e3, skew=0.3)
    found = fitted_timing(dataset(source=source), MotorResponse(lag=lag, delay=0.01), BOTH, ())
    assert found.free == BOTH
    assert [free.names for free, _ in seen] == [BOTH]


@pytest.mark.parametrize(("skew", "kept"), [(0.7, True), (0.9, False), (50.0, False)])
def test_a_skew_of_more_than_there_is_has_lost_the_motion(monkeypatch, skew, kept):
    fits_to(monkeypatch, AT, gain=1e3, skew=skew)
    found = fitted_timing(dataset(), AT, BOTH, ())
    assert ("motor_skew" in found.free) is kept
    assert found.response.lag > 0.0


def test_where_a_skew_does_not_settle_there_is_none(monkeypatch):

    def refuse(dataset, options):
        if "motor_skew" in dataset.free_timing.names:
            raise UnsettledError("no")

    fits_to(monkeypatch, AT, gain=1e3, skew=0.3, before=refuse)
    assert fitted_timing(dataset(), AT, BOTH, ()).free == BOTH


@pytest.mark.parametrize(("pull", "known"), [(29.9, True), (30.1, False)])
def test_a_gust_bias_of_30_ms_makes_the_lag_unidentifiable(monkeypatch, pull, known):
    fits_to(monkeypatch, AT)
    calm = (made_fit.turned([0.150 / (pull * MS)] * 3),)
    found = fitted_timing(dataset(given=calm), AT, BOTH, ())
    assert found.free == (BOTH if known else ())
    assert found.response == (AT if known else MotorResponse(lag=0.035))
    # Measured speeds have no lag that could be taken for the autopilot's answer.
    measured = dataset(motors=MotorsEntry(), given=calm)
    assert fitted_timing(measured, AT, ("motor_delay",), ()).free == ("motor_delay",)


@pytest.mark.parametrize(
    ("turned", "free"), [(True, ("motor_delay",)), (False, ())], ids=["flown", "calm"]
)
def test_motors_without_lag_are_known_by_turns_that_are_flown(monkeypatch, turned, free):
    """A simulator's may have none; a calm flight shows the autopilot's answer to its gyro.

    Then the delay alone is free: the slope by so short a lag is that of the delay.
    """
    fits_to(monkeypatch, MotorResponse(lag=0.0004, delay=0.0003))
    calm = (made_fit.turned([0.150 / (20.0 * MS)] * 3),)
    flights = dataset() if turned else dataset(given=calm)
    found = fitted_timing(flights, AT, BOTH, ())
    assert found.free == free
    if turned:
        assert found.response.lag == 0.0
        assert found.lag_std == found.delay_std == found.total_std > MS  # no better than their sum


@pytest.mark.parametrize(("std", "free"), [(4.0, ("motor_delay",)), (4.2, ())])
def test_turns_that_may_be_8_ms_late_do_not_show_no_lag(monkeypatch, std, free):
    """Once lag was 0 +- 2.5 ms, of motors with 21: the turns of that hover were open by 27 ms."""
    fits_to(monkeypatch, MotorResponse(lag=0.0004, delay=0.0003))
    turns_leave_open(monkeypatch, std)
    assert fitted_timing(dataset(), AT, BOTH, ()).free == free


LOST_AT = MotorResponse(lag=0.0004, delay=0.0113)


def likely_to_24_ms(at):
    """Return log-likelihood that tells lags between nothing and 24 ms apart by less than 3."""
    return -2.0 * ((at.mean_lag - 0.011) / 0.011) ** 2 if at.mean_lag < 0.03 else -100.0


def test_a_lag_that_the_search_has_lost_is_found_again(monkeypatch):
    """Six random worlds had motors with 12 to 25 ms, and lag 0 +- .5 ms identified."""

    def bottom(free):
        return MotorResponse(lag=0.014, delay=-0.003) if free.at.mean_lag > 0.006 else LOST_AT

    begun = MotorResponse(lag=0.004, delay=0.007)
    fits_to(monkeypatch, bottom, likelihood=likely_to_24_ms)
    found = fitted_timing(dataset(), begun, BOTH, ())
    assert found.free == BOTH
    assert (found.response.lag, found.response.delay) == pytest.approx((0.014, -0.003))


def test_of_a_lag_that_is_lost_again_the_sum_alone_is_known(monkeypatch):
    """The lag is as unknown as before the flight, and so is the delay."""

    def bottom(free):
        late = MotorResponse(lag=0.0, delay=0.0115 - free.at.mean_lag)
        return late if free.names == ("motor_delay",) else LOST_AT

    fits_to(monkeypatch, bottom, likelihood=likely_to_24_ms)
    found = fitted_timing(dataset(), AT, BOTH, ())
    assert found.free == ("motor_delay",)
    assert (found.response.lag, found.response.delay) == pytest.approx((0.008, 0.0035))
    assert (found.lag_std, found.delay_std) == (0.03, 0.03)
    assert found.total_std < 3.0 * MS
    assert replace(found, lag_std=None, delay_std=MS).with_lag_of(found).delay_std == 0.03


def test_a_sum_that_is_unknown_shows_no_lag(monkeypatch):
    """Once the delay was 19 +- 39 ms, and the lag 0 +- 1 of motors with 25."""
    monkeypatch.setattr(timing_fit, "hold_fault", lambda dataset: 0.020)
    fits_to(monkeypatch, MotorResponse(lag=0.0004, delay=0.0003))
    found = fitted_timing(dataset(), AT, BOTH, ())
    assert (found.free, found.response) == ((), MotorResponse(lag=0.035))


@pytest.mark.parametrize("lag", [0.0, 0.0305])
def test_motors_that_move_before_their_command_are_unknown(monkeypatch, lag):
    fits_to(monkeypatch, MotorResponse(lag=lag, delay=-lag - 0.001))
    found = fitted_timing(dataset(), AT, BOTH, ())
    assert (found.free, found.response) == ((), MotorResponse(lag=0.035))


@pytest.mark.parametrize(
    "bottom",
    [
        MotorResponse(lag=0.21),
        MotorResponse(lag=0.04, delay=0.17),
        MotorResponse(lag=0.04, delay=-0.17),
    ],
)
def test_times_beyond_any_motors_are_none(monkeypatch, bottom):
    fits_to(monkeypatch, bottom)
    assert fitted_timing(dataset(), AT, BOTH, ()) is None


@pytest.mark.parametrize("bottom", [MotorResponse(lag=0.19), MotorResponse(lag=0.04, delay=0.15)])
def test_motors_may_be_as_slow_as_200_ms_and_as_late_as_160(monkeypatch, bottom):
    fits_to(monkeypatch, bottom)
    found = fitted_timing(dataset(), AT, BOTH, ()).response
    assert (found.lag, found.delay) == pytest.approx((bottom.lag, bottom.delay))


def unsettled(monkeypatch, *, settles, bottom=TRIED):
    """Let fits settle only with these terms; return the times and terms of each that is begun."""
    tried = []

    def note(dataset, options):
        if "motor_skew" not in dataset.free_timing.names:
            tried.append((dataset.free_timing.names, options["terms"]))
        if options["terms"] != settles:
            raise UnsettledError("no")

    fits_to(monkeypatch, bottom, before=note)
    return tried


def test_where_a_fit_does_not_settle_fewer_terms_are_tried(monkeypatch):
    tried = unsettled(monkeypatch, settles=("accel_bias",))
    assert find_timing(dataset()).free == BOTH
    assert [terms for _, terms in tried] == [timing_fit.DEFAULT_TERMS, ("accel_bias",)]


def test_flights_that_settle_nowhere_show_no_lag(monkeypatch):
    """None at all would say that commands are followed at once."""
    unsettled(monkeypatch, settles=None)
    assert find_timing(dataset()) == unidentifiable_timing(dataset(), delay_free=True)
    bench = MotorsEntry(speed="commanded", delay=0.01)
    assert find_timing(dataset(motors=bench)) == unidentifiable_timing(
        dataset(motors=bench), delay_free=False
    )
    assert find_timing(dataset(motors=MotorsEntry())) is None


def test_new_terms_refit_the_timing_from_its_previous_value(monkeypatch):
    """Damping that the model lacks makes motors look quick; without a skew, to begin with."""
    terms = (*timing_fit.DEFAULT_TERMS, "turn_damping")
    found = MotorTiming(
        response=MotorResponse(lag=0.03, delay=0.01, lag_down=0.05),
        total_std=MS,
        free=(*BOTH, "motor_skew"),
    )
    whole = dataset(motor_timing=found)
    tried = unsettled(monkeypatch, settles=terms, bottom=AT)
    again = timed_again(whole, terms)
    assert tried == [(BOTH, terms)]
    assert again.motor_timing.free == BOTH
    assert timed_again(whole, ("drag",)) is whole  # it does not settle: the timing stays
    for kept in (None, replace(found, free=())):
        given_ = dataset(motor_timing=kept)
        assert timed_again(given_, terms) is given_


# What a fit may move.

RESPONSES = st.builds(
    MotorResponse, lag=st.floats(0.0, 0.1), delay=st.floats(-0.1, 0.1), lag_down=st.none()
)


@given(at=RESPONSES, lag=st.floats(-0.05, 0.05), delay=st.floats(-0.1, 0.1))
def test_times_move_by_so_much_and_a_lag_not_below_zero(at, lag, delay):
    moved = FreeTiming(at=at, names=BOTH).moved({"motor_lag": lag, "motor_delay": delay})
    assert moved.lag == pytest.approx(max(at.lag + lag, 0.0))
    assert moved.delay == pytest.approx(at.delay + delay)
    assert moved.lag_down is None


@given(mean=st.floats(0.01, 0.1), skew=st.floats(-0.5, 0.5), by=st.floats(-0.3, 0.3))
def test_a_skew_speeds_rising_and_slows_falling_about_the_mean(mean, skew, by):
    at = MotorResponse(lag=mean * (1 - skew), lag_down=mean * (1 + skew))
    free = FreeTiming(at=at, names=("motor_lag", "motor_skew"))
    moved = free.moved({"motor_skew": by, "motor_lag": 0.002})
    assert moved.mean_lag == pytest.approx(mean + 0.002)
    assert skew_of(moved) == pytest.approx(skew + by, abs=1e-9)
    assert free.moved({}).mean_lag == pytest.approx(mean)


def test_the_lag_prior_is_relative_to_the_timing_of_the_signals():
    assert FreeTiming(at=AT, names=BOTH).prior() == pytest.approx(
        {"motor_lag": pytest.approx((-0.005, 0.03))}
    )
    bench = FreeTiming(at=AT, names=BOTH, lag_prior=(0.05, 0.002))
    assert bench.prior()["motor_lag"] == pytest.approx((0.010, 0.002))
    assert FreeTiming(at=AT, names=("motor_delay",)).prior() == {}
    bench = MotorsEntry(speed="commanded", lag=0.05, lag_std=0.002)
    assert dataset(motors=bench).at(AT, BOTH).free_timing.lag_prior == (0.05, 0.002)


def test_faults_are_100_us_of_the_total_and_300_us_of_the_split():
    split, total = FreeTiming(at=AT, names=BOTH).faults()
    assert split == {"motor_lag": 3e-4, "motor_delay": -3e-4}
    assert total == {"motor_lag": 0.0, "motor_delay": 1e-4}
    for name in BOTH:
        assert FreeTiming(at=AT, names=(name,)).faults() == [{name: 1e-4}]


def test_a_timing_that_is_given_or_unknown_is_not_moved():
    assert dataset().free_timing is None
    assert dataset(motor_timing=MotorTiming(response=AT, total_std=MS)).free_timing is None
    assert dataset().at(AT).free_timing is None


# Where it begins, and whether the flights tell any of it.


def costs(monkeypatch, cost):
    monkeypatch.setattr(
        timing_search, "pilot_band_costs", lambda dataset, trials: [cost(one) for one in trials]
    )


@pytest.mark.parametrize(("bottom", "found"), [(0.045, 0.04), (0.001, 0.005), (0.13, None)])
def test_a_lag_begins_at_the_best_trial(monkeypatch, bottom, found):
    """None where that is the last one: the motion follows something slower than motors."""
    costs(monkeypatch, lambda response: 1e6 * (response.lag - bottom) ** 2)
    start = coarse_timing(dataset(), ("lag", "delay"))
    assert (start is None) if found is None else start == MotorResponse(lag=found)


def test_the_lag_prior_decides_between_trials_that_fit_equally(monkeypatch):
    costs(monkeypatch, lambda response: 0.0)
    assert coarse_timing(dataset(), ("lag",)).lag == 0.04
    # 100 ms are 2.2 deviations from the usual 35, and unlikelier by 2.3 than the best trial.
    for gain, lag in ((2.2, 0.04), (2.5, 0.1)):
        costs(monkeypatch, lambda response, gain=gain: -gain * (response.lag == 0.1))
        assert coarse_timing(dataset(), ("lag",)).lag == lag
    bench = MotorsEntry(speed="commanded", lag=0.07, lag_std=0.002, delay=0.003)
    assert coarse_timing(dataset(motors=bench), ("lag",)) == MotorResponse(lag=0.07, delay=0.003)


@pytest.mark.parametrize(
    ("bottom", "gain", "found"),
    [
        (0.004, 1e3, 0.004),
        (0.0125, 11.0, 0.012),  # the end of the usual itself, as of a gyro low-passed at 20 Hz
        (-0.0125, 11.0, -0.012),
        (0.040, 11.0, 0.040),  # further out than usual, and clearly better there
        (0.040, 9.0, 0.012),  # not clearly, and not at nothing: the fit goes on from there
        (-0.040, 11.0, -0.040),
        (0.5, 1e3, None),
        (0.164, 1e3, 0.164),
        (0.172, 1e3, None),
    ],
)
def test_a_delay_begins_at_the_best_trial_or_further_out(monkeypatch, bottom, gain, found):
    edge = 0.012 * np.sign(bottom)
    scale = gain / max((bottom - edge) ** 2, 1e-9)
    costs(monkeypatch, lambda response: scale * (response.delay - bottom) ** 2)
    start = coarse_timing(dataset(motors=MotorsEntry()), ("delay",))
    assert (start is None) if found is None else start.delay == pytest.approx(found, abs=1e-9)


def test_flights_that_show_no_delay_begin_nowhere(monkeypatch):
    costs(monkeypatch, lambda response: 0.0)
    assert coarse_timing(dataset(motors=MotorsEntry()), ("delay",)) is None


@pytest.mark.parametrize(
    ("ratios", "expected"),
    [
        ([[1.0, 3.0, 2.0]], 0.05),
        ([[1.0, 3.0, 2.0], [9.0, 5.0, 6.0]], 0.15 / 9),
        ([[0.01] * 3], 1.5),
    ],
)
def test_a_response_to_gusts_moves_a_delay_by_150_ms_over_rho(ratios, expected):
    """Of the turn and the configuration that are flown most; not beyond a rho of 0.1."""
    whole = dataset(given=tuple(made_fit.turned(own) for own in ratios))
    whole = replace(whole, configurations=whole.configurations * len(ratios))
    assert gust_bias(whole) == pytest.approx(expected)


@pytest.mark.parametrize(("yaw", "bias"), [(3.1, 0.0), (2.9, 0.15)])
def test_an_axis_excited_above_the_pilots_band_is_not_biased(yaw, bias):
    """And where none is, the ratios are those of the pilot's band alone."""
    bands = [(1.0, 2.0), (3.0, 4.0)]
    factors = made_fit.turned([1.0, 1.0, 1.0], [2.0, 2.0, yaw], bands=bands)
    assert gust_bias(dataset(given=(factors,))) == pytest.approx(bias)
    assert gust_bias(dataset(given=(factors,)), turns=2) == pytest.approx(0.15)


def test_of_some_turns_those_flown_most_count():
    whole = dataset(given=(made_fit.turned([1.0, 3.0, 5.0]),))
    assert gust_bias(whole) == pytest.approx(0.15 / 5.0)
    assert gust_bias(whole, turns=2) == pytest.approx(0.15 / 3.0)


def test_yaw_alone_does_not_show_that_motors_have_no_lag(monkeypatch):
    """Of motors with 22 ms, in gusts: the lag was 0 +- .9 ms, and the delay 39."""
    fits_to(monkeypatch, MotorResponse(lag=0.0004, delay=0.0003))
    quick = made_fit.turned([1.0, 1.0, 6.0], [2.0, 2.0, 9.0], bands=[(1.0, 2.0), (3.0, 4.0)])
    assert fitted_timing(dataset(given=(quick,)), AT, BOTH, ()).free == ()


@pytest.mark.parametrize(
    ("value", "std", "known"),
    [
        (0.010, 0.0178, True),  # 1.96 of them are 34.9 ms: under the usual 35
        (0.010, 0.0180, False),
        (-0.100, 0.0510, True),
        (0.100, 0.0511, False),
    ],
)
def test_a_time_is_known_if_half_its_interval_is_small_enough(value, std, known):
    assert is_time_identifiable(value, std) is known


@pytest.mark.parametrize(
    ("lost", "begun"),
    [([], 40.0), ([40.0], 20.0), ([40.0, 20.0], 80.0), ([40.0, 20.0, 80.0], 40.0)],
)
def test_a_fit_that_gets_lost_begins_at_another_lag(monkeypatch, lost, begun):
    tried = []

    def fit(dataset, **_):
        tried.append(1e3 * dataset.timing.lag)
        away = 1e26 if any(abs(tried[-1] - lag) < 1e-6 for lag in lost) else 2.0
        return fit_at(dataset.free_timing, moved=[1.0, -away]), []

    fitting(monkeypatch, fit)
    found, first, _ = first_fit(dataset(), MotorResponse(lag=0.04), BOTH, ())
    assert 1e3 * found.timing.lag == pytest.approx(begun)
    assert first.estimate.value("motor_delay") == pytest.approx(-1e23 if len(lost) == 3 else -0.002)
    assert tried == pytest.approx([40.0, 20.0, 80.0][: min(len(lost) + 1, 3)])


def test_without_a_lag_there_is_one_start(monkeypatch):
    fitting(monkeypatch, lambda at, **_: (fit_at(at.free_timing, moved=[1e26]), []))
    found, *_ = first_fit(dataset(), MotorResponse(delay=0.01), ("motor_delay",), ())
    assert found.timing == MotorResponse(delay=0.01)


def test_a_declared_lag_that_flights_contradict_is_open_by_that():
    declared = made_fit.dataset(motors=MotorsEntry(speed="commanded", lag=0.022, lag_std=0.001))
    assert declared.lag_std(0.0225, 0.0008) == pytest.approx(0.0008)
    assert declared.lag_std(0.022, 0.005) == pytest.approx(0.001)
    # Both deviations are 1 ms, and they are 4 of theirs apart.
    apart = 4.0 * 2.0**0.5 * MS
    assert declared.lag_std(0.022 - apart, 0.001) == pytest.approx(0.004)


def test_a_lag_of_quick_motors_contradicts_no_declaration():
    undeclared = made_fit.dataset(motors=COMMANDED)
    assert undeclared.lag_std(0.005, 0.001) == 0.001
    assert undeclared.lag_std(0.005, 0.1) == undeclared.lag_prior[1]
