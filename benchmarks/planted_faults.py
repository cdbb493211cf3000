"""Does a test notice when a term of an interval is wrong? Faults are planted, one at a time.

    python benchmarks/planted_faults.py
    python benchmarks/planted_faults.py --only timing_search

Every term that an interval or a verdict is made of is halved, doubled, dropped or given the other
sign in a copy of `src`, and the tests of the room that owns the file are run on it. Printed is
which fault they noticed; it ends with 1 if there is one that they did not. What is replaced must be
there exactly once, so that a fault whose line has changed is said and not passed over.

Takes about a second of one core a fault, and all tests of these rooms once before it begins.
"""

# ruff: noqa: E501 (lines of the source as they are)

import argparse
import os
import shutil
import sys
import tempfile
import time
import traceback
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import hypothesis.strategies  # noqa: F401 (what every run would import again)
import jaxtyping  # noqa: F401
import pydantic  # noqa: F401
import pytest
import scipy.optimize
import scipy.signal
import scipy.spatial
import scipy.stats  # noqa: F401

ROOT: Final = Path(__file__).resolve().parents[1]
OPENS, ENDS = "<<", ">>"


@dataclass(frozen=True, slots=True, kw_only=True)
class Room:
    """What is planted in one file, and which tests should notice.

    Attributes
    ----------
    tests
        Of the room that owns the file, the fast ones first.
    scaled
        Lines in which ``<<term>>`` is halved, and doubled.
    changed
        What is there, and what is put in its place.
    """

    tests: tuple[str, ...]
    scaled: tuple[str, ...] = ()
    changed: tuple[tuple[str, str], ...] = ()


ROOMS: Final[dict[str, Room]] = {
    "estimation/leaps.py": Room(
        tests=("tests/estimation/test_known_noise.py", "tests/estimation/test_banded.py"),
        scaled=("MOST_NOISE = <<0.7>>",),
    ),
    "estimation/banded.py": Room(
        tests=(
            "tests/estimation/test_known_noise.py",
            "tests/estimation/test_banded.py",
            "tests/estimation/test_feedback.py",
            "tests/estimation/test_partial.py",
            "tests/estimation/test_bound.py",
            "tests/estimation/test_scatter.py",
        ),
        scaled=(
            "UNKNOWN = <<10.0>>",
            "return <<equations @ fit.estimate.covariance>>",
            "covariance = <<root @ (kept @ kept.T) @ root.T>>",
            "influence=<<equations.scores @ inverse>>,",
            "log_likelihood=<<-0.5 * state.cost>>,",
            "return -np.inf if state is None else <<-0.5 * state.cost>>",
            "return <<before + behind>>",
            "<<_scatter_of_influences(influence[blocks])>> + _scatter_of_influences(influence[~blocks]),",
            "values=<<rest.scores.sum(axis=0) @ inverse_rest>>,",
            "np.maximum(<<np.diagonal(floor) / variance>>, 1.0)",
        ),
        changed=(
            ("covariance = root @ (kept @ kept.T) @ root.T", "covariance = inverse"),
            ("inverse = root @ kept @ root.T", "inverse = root @ root.T"),
            ("information=equations.information - equations.noise_information,", "information=equations.information,"),
            ("scores=np.array([s, prior_score])", "scores=np.array([s])"),
            ("return before + behind", "return before"),
            ("_scatter_of_influences(influence[blocks]) + _scatter_of_influences(", "_scatter_of_influences("),
            ("formal = inverse_rest - inverse", "formal = inverse_rest"),
            ("(rest.scores @ inverse_rest - whole.scores @ inverse)", "(rest.scores @ inverse_rest)"),
        ),
    ),
    "estimation/banded_equations.py": Room(
        tests=(
            "tests/estimation/test_known_noise.py",
            "tests/estimation/test_banded.py",
            "tests/estimation/test_feedback.py",
            "tests/estimation/test_partial.py",
            "tests/estimation/test_bound.py",
            "tests/estimation/test_late_errors.py",
        ),
        scaled=(
            "rest = prior_cost(problem, phi) - <<2.0>> * response",
            "if not np.isfinite(cost) or response > <<MOST_RESPONSE * _count_rows(problem)>>:",
            "squares.append(power - <<rows * known_noise_variance(problem, c, G)>>)",
            "gain += <<float(slopes @ phi[list(part.moving)])>>",
            "scores[:, :, part.at(part.moving)] += <<feedback.responses[number].gain_slopes>>",
            "own[:, :, at] += <<G @ lift.T>>",
            "u[errors] += <<by * G[errors] @ factors.slope_lifts[one.slope].T>>",
            "own[errors] += <<size * (dG[errors] @ lift).transpose(0, 2, 1)>>",
            "own[errors, :, at] += <<G[errors] @ lift>>",
            "spare = np.minimum(<<power / v - rows>>, 0.0)",
            "cost += float(np.sum(<<rows * np.log(v)>>, where=counted))",
            "np.sum(<<((phi - mean)[known] / std[known]) ** 2>>)",
            "own += <<_response_scores(problem, problem.feedback, number, responding).sum(axis=1)>>",
            "information = <<np.diag(std**-2.0)>>",
            "information[square] += <<_block_information(factors.gram[part.local], w, dU)>>",
            "each = each + <<w.T[:, :, None] * by_noise>>",
            "reweighting[square] += <<0.5 * (turned + turned.T)>>",
            "noise_information[square] += <<_noise_information(noise, rows * w, dG)>>",
            "prior_score=<<(mean - state.phi) * std**-2.0>>",
            "parts = [<<np.diag(1.0 / problem.prior[1])>>]",
            "weights = <<1.0 / np.sqrt(state.variance[part.blocks])>>",
        ),
        changed=(
            ("cost += float(np.sum(spare, where=counted & floored))", "pass"),
            ("accurate = np.diagonal(R).min() > SMALLEST_PIVOT", "accurate = True"),
            ("variance=state.variance[blocks]", "variance=state.variance[: blocks.sum()]"),
        ),
    ),
    "estimation/banded_problem.py": Room(
        tests=(
            "tests/estimation/test_banded.py",
            "tests/estimation/test_known_noise.py",
            "tests/estimation/test_late_errors.py",
        ),
        scaled=(
            "RELATIVE_FLOOR: Final = <<1e-9>>",
            "left = A - <<(A[:, :, list(noisy)].reshape(-1, k) @ G).reshape(t, *A.shape)>>",
        ),
        changed=(
            ("moves[:, self.places] = True", "pass"),
            ("moves[one.part, self.map.names.index(one.name)] = True", "pass"),
            ("if one.part == k}", "}"),
            (": m.sum(axis=1).max()]", ": m.sum(axis=1).min()]"),
        ),
    ),
    "estimation/bound.py": Room(
        tests=("tests/estimation/test_bound.py",),
        scaled=("factors.R, <<1.0 / variance>>, factors.R",),
    ),
    "estimation/factors.py": Room(
        tests=(
            "tests/estimation/test_factors.py",
            "tests/estimation/test_reweighted.py",
            "tests/fit/test_signal_slopes.py",
        ),
        scaled=(
            "np.tensordot(<<by>>, self.slope_lifts, axes=1)",
            "FEW_ROWS = <<28>>",
            "shares[1, :-1] = <<0.5>> * same",
        ),
        changed=(
            ("total[1:] += before", "total[1:] += 0.0 * before"),
            ("shares[0, 1:], shares[1, :-1] = 0.5 * same", "shares[0, 1:], shares[1, :-1] = 0.5"),
        ),
    ),
    "estimation/feedback.py": Room(
        tests=("tests/estimation/test_feedback.py",),
        scaled=(
            "return <<np.real(weighted * self.log_effect_slopes)>>",
            "np.sum(<<response.rows * np.real(response.complementary_sensitivity * logarithm)>>)",
            "every[:, :, by] = <<np.real(slope)>>",
        ),
        changed=(
            ("replace(part, complementary_sensitivity=part.uncertainty)", "part"),
            ("np.real(response.complementary_sensitivity * logarithm)", "np.abs(response.complementary_sensitivity) * np.real(logarithm)"),
            ("response.rows * response.complementary_sensitivity / effect", "response.rows * np.abs(response.complementary_sensitivity) / effect"),
            ("(self.rows * self.complementary_sensitivity)[:, :, None]", "(self.rows * np.abs(self.complementary_sensitivity))[:, :, None]"),
            ("np.where(np.real(effect) < 0, -effect, effect)", "effect"),
        ),
    ),
    "estimation/least_squares.py": Room(
        tests=("tests/estimation/test_ordinary.py", "tests/estimation/test_total.py"),
        scaled=(
            "variance = <<float(residual @ residual) / max(problem.rows - f, 1)>>",
            "return <<sigma_W**2 * (1.0 + float(chi @ chi)) * (root @ root.T)>>",
            "sigma_W = <<s[-1] / np.sqrt(max(rows - n_t, 1))>>",
            "return <<estimate.std / np.abs(estimate.values)>>",
        ),
        changed=(
            ("max(problem.rows - f, 1)", "problem.rows"),
            ("max(rows - n_t, 1)", "rows"),
        ),
    ),
    "estimation/estimate.py": Room(
        tests=("tests/estimation/test_scatter.py",),
        scaled=("(above - below).T / (<<2.0 * step>>)",),
    ),
    "estimation/damped_steps.py": Room(
        tests=("tests/estimation/test_damped_steps.py",),
        scaled=(
            "asked = (<<score / lengths>>) @ V",
            "predicted_gain=float(moved @ (<<2.0 * asked>> - strength * moved)),",
            "ratio = min(<<won / max(predicted_gain, float(np.finfo(float).tiny))>>, 1.0)",
            'root: Float[np.ndarray, "f f"] = <<V / np.sqrt(strength)>> / lengths[:, None]',
        ),
    ),
    "estimation/dispersion.py": Room(
        tests=("tests/estimation/test_dispersion.py",),
        scaled=(
            "Dispersion(ratio=<<shown / stated>>, degrees",
            "degrees=<<stated**2 / spread>>)",
            "<<blocks * shown>> + degrees",
            "<<degrees * total>>) / whole",
            "<<np.array([[one.ratio] for one in dispersions])>> * stated",
            "<<weight.sum(axis=0) ** 2>> / by_group",
            "np.log(half) - <<special.digamma(half)>>",
            "spare = <<float(weight @ (values - mean) ** 2)>>",
            "kept = <<self.between / (self.between + variance)>>",
            "<<lost * self.between>> + lost**2",
            "+ <<lost**2 * self.variance>>,",
            "return float(<<(1.0 + np.sqrt(1.0 + 2.0 * variance))>> /",
        ),
        changed=(
            ("own = Y - squares", "own = Y"),
            ("(own**2).sum()) + max(across, 0.0)", "(own**2).sum())"),
            ("whole = blocks + degrees", "whole = degrees"),
            ("degrees >= FEWEST_DEGREES", "degrees > 0.0"),
            ("- (len(values) - 1.0)", ""),
            ("1.0 / (variances + between)", "1.0 / variances"),
            ("information[one], influences[one]", "information, influences"),
        ),
    ),
    "estimation/measured.py": Room(
        tests=("tests/estimation/test_measured.py", "tests/fit/weight/test_kt_from_weight.py"),
        scaled=(
            "CHANCE: Final = <<2.0>>",
            "DOUBTED: Final = <<2.58>>",
            "CONTRADICTION: Final = <<5.0>>",
            "reach = wrong * <<max(moved, 1.0 - moved)>>",
            "moved = kept * <<theirs>> / (own + theirs)",
            "<<m * after.var(axis=0)>>",
            "/ (<<n + m - 2>>)",
        ),
        changed=(
            ("max(moved, 1.0 - moved)", "(1.0 - moved)"),
            ("max(moved, 1.0 - moved)", "moved"),
            ("float(np.hypot(chance, reach))", "chance"),
            ("float(np.hypot(chance, reach))", "reach"),
        ),
    ),
    "fit/weight/thrust_change.py": Room(
        tests=("tests/fit/sensors/test_sensor_response.py",),
        scaled=(
            "return <<change>> * GRAVITY",
            "return <<whole>> * size",
            "return <<0.5>> * change * size",
        ),
    ),
    "flight/imu_tilt.py": Room(
        tests=("tests/flight/test_imu_tilt.py",),
        scaled=("<<drag>> * np.where(known",),
        changed=(
            ("x[known] - x[known].mean(axis=0)", "x[known]"),
            ("np.where(known[:, None], across, 0.0)", "across"),
        ),
    ),
    "fit/dataset/coupled_turns.py": Room(
        tests=("tests/fit/dataset/test_declared_rotors.py",),
        scaled=(
            "MOST_MIXED: Final = <<0.6>>",
            "across[1, 0] + <<across[0, 1]>>",
            "<<torques[0, 0]>> + torques[1, 1]",
        ),
        changed=(
            ("a > 0.0 and c > 0.0 and ", ""),
            (" - np.outer(along, along) / max(size, TINY)", ""),
        ),
    ),
    "checks/motors/changed_thrust.py": Room(
        tests=("tests/checks/test_changed_rotor.py", "tests/checks/test_spoilt_flights.py"),
        scaled=("SURE: Final = <<5.0>>", "LEAST_CHANGE: Final = <<0.035>>"),
        changed=(("_, std = change_of_means", "std, _ = change_of_means"),),
    ),
    "estimation/reweighted.py": Room(
        tests=("tests/estimation/test_scatter.py", "tests/estimation/test_reweighted.py"),
        scaled=(
            "variance = np.maximum(<<mean_square / np.count_nonzero(problem.weights[0])>>, floor)",
            "scores = <<(residual[:, None] @ J)[:, 0]>> / variance",
            "log_likelihood=float(<<-0.5>> * np.sum",
            "return np.array([<<prior_std[n] ** -2.0>> if",
            "return inverse @ (Q.T @ b), <<inverse @ inverse.T>>",
            "return <<centred.T @ centred * (b / (b - 1.0))>>",
            "floor = <<RELATIVE_FLOOR>> * float",
        ),
        changed=(
            (" * (b / (b - 1.0))", ""),
            ("influence - influence.mean(axis=0)", "influence"),
            (" / np.count_nonzero(problem.weights[0])", ""),
        ),
    ),
    "fit/intervals/numbers.py": Room(
        tests=(
            "tests/fit/test_excitation.py",
            "tests/fit/test_joint_intervals.py",
            "tests/fit/test_inertia_uncertainty.py",
            "tests/fit/test_row_intervals.py",
            "tests/fit/test_known_beforehand.py",
            "tests/results/test_stated_intervals.py",
        ),
        scaled=(
            "FEWEST_PHASES: Final = <<3>>",
            "INERTIA_BIAS: Final = <<2.5>>",
            "CLOSED_LOOP_BIAS: Final = <<1.0>>",
            "RATIO_BIAS: Final = <<1.5>>",
            "SCALE_BIAS: Final = <<3.0>>",
            "NO_EXCITATION: Final = <<1.5>>",
            "LEAST_EXCITATION: Final = <<5.0>>",
            "too_small = <<RATIO_BIAS / (rho - RATIO_BIAS)>>",
            "else <<SCALE_BIAS / (rho + SCALE_BIAS)>>",
            "return <<CLOSED_LOOP_BIAS / (rho + CLOSED_LOOP_BIAS) * abs(size)>>",
            "return <<max(scale, too_small) * abs(size)>>",
            "return <<INERTIA_BIAS / (max(float(rho), 0.0) + INERTIA_BIAS) * abs(size)>>",
            "return <<SCALE_BIAS / (link + SCALE_BIAS) * abs(size)>>",
            "return <<SCALE_BIAS / (max(float(rho), 0.0) + SCALE_BIAS) * abs(size)>>",
            "return t * <<np.sqrt(np.maximum(np.diagonal(formal), np.diagonal(scatter)))>>",
            "t = <<float(student_quantile(0.975, degrees))>>",
            "return <<float(np.sqrt(sum(part**2 for part in parts)))>>",
            "std = self.half_width[index] / <<1.96>>",
        ),
        changed=(
            ("(max(float(rho), 0.0) + INERTIA_BIAS)", "(max(float(rho), 0.0) - INERTIA_BIAS)"),
            ("RATIO_BIAS / (rho - RATIO_BIAS)", "RATIO_BIAS / (rho + RATIO_BIAS)"),
            ("max(scale, too_small)", "scale"),
            ("max(scale, too_small)", "too_small"),
            ("    if with_response:\n", "    if False:\n"),
            ("1.0 / (1.0 - relative**2)", "1.0 / (1.0 - relative)"),
            ("1.0 / (1.0 - relative**2)", "1.0"),
            ("student_quantile(0.975, degrees)", "student_quantile(0.95, degrees)"),
            ("part**2 for part", "part for part"),
            ("np.outer(std, std)", "np.outer(std, np.ones_like(std))"),
            ("return max(value for key", "return min(value for key"),
        ),
    ),
    "fit/reduction/frequency_bands.py": Room(
        tests=(
            "tests/fit/test_excitation.py",
            "tests/fit/test_joint_intervals.py",
            "tests/fit/test_informative_bands.py",
        ),
        scaled=(
            "LEAST_RATIO: Final = <<3.0>>",
            "PILOT_BAND: Final = (<<0.3>>, 3.0)",
            "PILOT_BAND: Final = (0.3, <<3.0>>)",
        ),
        changed=(("> (1.0 + least_ratio) *", "> least_ratio *"),),
    ),
    "model/terms/term.py": Room(
        tests=("tests/fit/test_expected_gain.py",),
        scaled=("LEAST_SHARE: Final = <<1e-3>>", "return <<self.trace_force * self.arm>>"),
    ),
    "model/terms/rotors.py": Room(
        tests=("tests/fit/test_known_beforehand.py", "tests/fit/test_joint_intervals.py", "tests/fit/test_expected_gain.py"),
        scaled=(
            "\nROTOR_SPREAD_STD: Final = <<0.04>>",
            "GROUP_SPREAD_STD: Final = <<0.1>>",
            "TWIST_STD: Final = <<np.radians(2.0)>>",
            "ROTOR_DRAG_STD: Final = <<0.3>>",
            "return <<ROTOR_DRAG_STD * size.mass / size.speeds>>",
            "prior=lambda s: <<TWIST_STD * s.arm>>",
            "return <<ROTOR_SPREAD_STD>> if rotor.group is None",
            "relevant=lambda s: <<s.arm / 50.0>>,  # a degree",
            "relevant=lambda s: <<abs(s.moments[2])>> / 1000.0",
        ),
        changed=(("if rotor.group is None else GROUP_SPREAD_STD", "if True else GROUP_SPREAD_STD"),),
    ),
    "model/terms/air.py": Room(
        tests=("tests/fit/test_known_beforehand.py", "tests/fit/test_joint_intervals.py", "tests/fit/test_expected_gain.py"),
        scaled=(
            "DAMPING_STD: Final = <<0.3>>",
            "INFLOW_STD: Final = <<0.4>>",
            "LIFT_STD: Final = <<0.05>>",
            "\nDRAG_STD: Final = <<0.3>>",
            "prior=lambda s: <<DRAG_STD * s.mass * s.arm>>",
            "relevant=lambda s: <<0.3 * s.mass * s.arm**2>>",
            "relevant=lambda s: <<0.1 * s.mass>>",
            "relevant=lambda s: <<0.3 * s.mass * s.arm / 5.0>>",
            "relevant=lambda s: <<0.3 * s.mass>>,  # of a small",
        ),
    ),
    "model/terms/body.py": Room(
        tests=("tests/fit/test_known_beforehand.py", "tests/fit/test_joint_intervals.py", "tests/fit/test_expected_gain.py"),
        scaled=(
            "\nACCEL_BIAS_STD: Final = <<0.2>>",
            "MOUNTING_STD: Final = <<0.5>>",
            "OFFSET_STD: Final = <<0.05>>",
            '"y": MOUNTING_STD, "z": <<ACCEL_BIAS_STD>>}',
            '{"x": <<MOUNTING_STD>>, "y"',
            '"y": <<MOUNTING_STD>>, "z"',
            "prior=lambda s: <<OFFSET_STD * s.mass * GRAVITY * s.arm>>",
            "relevant=lambda s: <<s.mass * s.arm / 50.0>>",
            "relevant=lambda s: <<s.mass * GRAVITY * s.arm / 50.0>>",
            "relevant=lambda s: <<0.2>>",
            "return <<float(np.sqrt(abs(one) * abs(other)))>> / 20.0",
        ),
    ),
    "fit/joint/joint_problem.py": Room(
        tests=(
            "tests/fit/test_known_beforehand.py",
            "tests/fit/test_closed_loop.py",
            "tests/fit/sensors/test_force_delay.py",
        ),
        scaled=(
            "BANDWIDTH = <<25.0>>",
            "through = <<BANDWIDTH * (s + ATTITUDE)>>",
            "turn = <<2.0 * np.pi * factors.band.mean(axis=1)>>",
            "return <<-1j * turn>>\n",
            "return <<-1j * turn / (1.0 + 1j * turn * at.mean_lag)>>",
            "speed = <<(mixer * vehicle.spins / (2.0 * rotor_speeds(configuration))).sum(axis=1)>>",
            'prior |= {f"{name}{at}": <<std>> for name, std, _ in tolerances',
            "{name: <<std>> for name, (_, std) in known.items()}",
            "\"az\"), -1] = <<lateness(\"motor_delay\", turn, timing.at)>>",
            "{n: <<mean>> for n, (mean, _) in known.items()}",
            "size: Float[np.ndarray, \" N\"] = <<np.linalg.norm(lowest[:, :, squares], axis=(0, 1)) / one>>",
        ),
        changed=(
            ("return np.sqrt(size)", "return size"),
            ("FORCE_ERRORS = (0, 1, 2)", "FORCE_ERRORS = (0, 1)"),
            ("[rate, rate, slow_yaw, climb]", "[rate, rate, rate, climb]"),
            ("*= with_response", "*= 1.0"),
            ("rows=moving[:, None] * counted_errors", "rows=factors.rows[:, None] * counted_errors"),
            ("rows=moving[:, None] * counted_errors", "rows=moving[:, None] * np.ones_like(counted_errors, dtype=int)"),
            ("spin_up = 1j * turn", "spin_up = -1j * turn"),
            ("* (\"dHx\" not in configuration.model.layout)", ""),
            ("vehicle.levers[:, :2].T\n    alike", "vehicle.levers[:, 1::-1].T\n    alike"),
        ),
    ),
    "estimation/effective_blocks.py": Room(
        tests=("tests/fit/test_joint_intervals.py",),
        scaled=(
            "variance = <<np.diagonal(jacobian @ scatter_covariance(fit.influence) @ jacobian.T)>>",
        ),
        changed=(
            ("return max(len(fit.influence) - len(fit.estimate.names) / fit.variance.shape[1], 1.0)", "return float(len(fit.influence))"),
            (" / fit.variance.shape[1], 1.0)", ", 1.0)"),
        ),
    ),
    "fit/intervals/excitation.py": Room(
        tests=("tests/fit/test_joint_intervals.py",),
        scaled=(
            "total += <<rows[own].sum() * explained / np.maximum(left, np.finfo(float).tiny)>>",
        ),
        changed=(
            ("np.maximum(signal - left, 0.0)", "signal"),
            ("return factors.rows * in_pilot_band(factors)", "return factors.rows"),
            ("return pilots_rows(factors)[:, None] * np.maximum(power", "return np.maximum(power"),
            (" * kept", ""),
            ("np.maximum(power[0] / left, 1.0)", "1.0"),
            ("bias = weight / (1.0 + rho)", "bias = weight / np.maximum(rho, 1.0)"),
        ),
    ),
    "fit/sensors/late_accelerometer.py": Room(
        tests=("tests/fit/test_late_accelerometer.py",),
        scaled=(
            "FILTERED_SHARE: Final = <<0.1>>",
            "DOUBTED_SHARE: Final = <<0.25>>",
            "USUAL_FILTER_DELAY: Final = <<0.01>>",
            "SURE: Final = <<0.75>>",
            "longer = delay + <<left.seconds / slope>>",
            "DELAYS[-1])), <<SURE * left.std / slope>>",
            "half = <<1.96>> * np.array",
            "{name: share * abs(<<moved[name]>> - own[name])",
            "float(np.exp(<<-0.5>> * np.logaddexp(0.0, -odds)))",
        ),
        changed=(
            ("slope = (one.seconds - other.seconds)", "slope = (other.seconds - one.seconds)"),
            ("(one.seconds <= 0.0 and delay == 0.0)", "one.seconds <= 0.0"),
            ("(one.seconds <= 0.0 and delay == 0.0)", "False"),
            ("break  # they are", "pass  # they are"),
            ("np.linalg.norm([_next_delay", "max([_next_delay"),
        ),
    ),
    "fit/sensors/force_delay.py": Room(
        tests=("tests/fit/sensors/test_force_delay.py",),
        scaled=(
            "USUAL_DELAY: Final = <<0.03>>",
            "formal_covariance(found, rows)) / <<1.96>>",
            "std = np.sqrt(<<chance**2>> + by_response",
            "by_response**2 + <<MODEL_FAULT**2>>)",
            "values = <<rows @ found.estimate.values>>",
        ),
        changed=(
            ("begin=fit.estimate.estimate.by_name", "begin={}"),
            ("timing is None or timing.delay_slope is None", "timing is None"),
        ),
    ),
    "fit/sensors/lateness.py": Room(
        tests=("tests/checks/test_lever_arms_and_clocks.py",),
        scaled=(
            "phase = <<FED_BACK * _mean_unexplained(bands, about)>>",
            "return self.left + <<4.0 * self.common>> * float",
        ),
        changed=(("weighed = _at_one_time(found, about=weighed.seconds)", "pass"),),
    ),
    "fit/intervals/joint_numbers.py": Room(
        tests=(
            "tests/fit/test_joint_intervals.py",
            "tests/fit/test_excitation.py",
            "tests/fit/test_inertia_uncertainty.py",
        ),
        scaled=(
            "FEWEST_FLIGHTS = <<3>>",
            "MOST_LEVERAGE = <<4.0>>",
            "<<student_quantile(0.975, degrees) * np.sqrt(variance)>>",
            "half_width=<<1.96 * np.sqrt(before)>>",
            "by_flights = np.diagonal(formal) - <<before>>",
            "dispersions(fit, parts, flights), <<by_flights * shares>>, own",
            "return np.divide(<<known>>, total,",
            "        <<half_width_between_phases(fit, jacobian)>>,",
            "        <<_between_flights(fit, jacobian)>>,",
            "half_width=<<np.abs(response).sum(axis=0)>>",
            "half_width=<<1.96 * np.linalg.norm(late, axis=0)>>",
            "half_width=<<1.96 * np.linalg.norm(pushed, axis=0)>>",
            "shared = <<response_shifts.T @ response_shifts / 1.96**2>> + late.T @ late",
            "return <<1.96 * np.sqrt((leverage * influences**2).sum(axis=0))>>",
            "shifts.append(<<covariance[:, at] @ held>>)",
            "variance += <<m / (m - 1.0) * ((influences - influences.mean(axis=0)) ** 2).sum(axis=0)>>",
            "return <<float(student_quantile(0.975, degrees)) * np.sqrt(variance)>>",
        ),
        changed=(
            ("float(student_quantile(0.975, degrees))", "1.96"),
            ("m / (m - 1.0) * ", ""),
            ("(influences - influences.mean(axis=0)) ** 2", "influences**2"),
            ("degrees = min(degrees, m - 1)", "degrees = min(degrees, m)"),
            ("degrees = min(degrees, m - 1)", "degrees = m - 1"),
            ("variance += m /", "variance = m /"),
            ("if m < FEWEST_FLIGHTS:", "if False:"),
            ("if m >= ENOUGH_FLIGHTS:", "if True:"),
            ("leverage * influences**2", "influences**2"),
            ("np.abs(response).sum(axis=0)", "np.abs(response.sum(axis=0))"),
        ),
    ),
    "fit/intervals/interval_terms.py": Room(
        tests=("tests/fit/test_interval_terms.py",),
        scaled=("term[grows] = <<half[grows]>> * np.sqrt",),
        changed=(
            ('half + term if rule == "linear" else np.hypot(half, term)', "np.hypot(half, term)"),
            ('half + term if rule == "linear" else np.hypot(half, term)', "half + term"),
            ("if term.half_width[place] != 0.0", ""),
        ),
    ),
    "fit/intervals/allowances.py": Room(
        tests=(
            "tests/fit/test_joint_intervals.py",
            "tests/fit/test_excitation.py",
            "tests/fit/test_inertia_uncertainty.py",
        ),
        scaled=(
            "half_width=<<np.array(common) * np.abs(numbers.values)>>",
            "parts.append(<<attenuation_allowance(base, size, rho, with_response=False)>>)",
            'parts.append(<<product_allowance(value, numbers.excitation[f"yaw@{owner}"])>>)',
            "linked[i] = <<link_allowance(float(numbers.values[i]), link)>>",
            "half_width=<<1.96 * _relative_mass_std(numbers, configurations, mass_std)>>",
            "stretch_term(numbers.half_width, <<_stretch_factors(numbers)>>)",
            "stretch[i] = max(<<(Ixx + Iyy) / max(Izz, np.finfo(float).tiny)>>, 1.0)",
            "speeds = <<len(vehicle.rotors) * hover>>",
            'if base == "Jr_over_Izz":\n        return <<1e-3>>',
        ),
        changed=(
            ("size = max(value, number_scale(numbers, name, mass=c.mass, vehicle=c.vehicle))", "size = value"),
            ("(numbers.on_yaw_scale(name) and not weighed)", "base in SCALED"),
            ("owner if base in HEIGHTS and not weighed else None", "owner if base in HEIGHTS else None"),
            ("owner if base in HEIGHTS and not weighed else None", "None"),
            ("else max(shares.values())", "else min(shares.values())"),
            ('f"Izz_com@{owner}" if owner else "kd"', "name"),
        ),
    ),
    "fit/weight/weigh_thrust.py": Room(
        tests=(
            "tests/fit/weight/test_kt_from_weight.py",
            "tests/fit/weight/test_weight_steps.py",
        ),
        scaled=(
            "CHANGES_STD = <<0.02>>",
            "<<share>> * kt.value",
        ),
        changed=(
            ("combine_scales(self.weight, self.changes)", "self.weight"),
            ("correlation_of(own + common)", "correlation_of(own)"),
        ),
    ),
    "fit/weight/kt_from_weight.py": Room(
        tests=("tests/fit/weight/test_kt_from_weight.py",),
        scaled=(
            "REST_STD = <<0.1>>",
            "mean_scale(measured, spread=<<effect>>**0.5)",
        ),
        changed=(("return CARRIED_VELOCITY", "return CAMERA_VELOCITY"),),
    ),
    "fit/motors/law_from_thrust.py": Room(
        tests=(
            "tests/fit/motors/test_law_from_thrust.py",
            "tests/results/test_command_units.py",
        ),
        scaled=(
            "FULL_STD: Final = <<0.05>>",
            "<<self._full_std>> * self._log_command_span",
            "STEADY: Final = <<0.95>>",
            "WRONG_STD: Final = <<0.3>>",
            "WRONG_FULL_STD: Final = <<0.1>>",
            "MISTAKES: Final = <<0.05>>",
        ),
        changed=(
            ("changes.over(weight)", "weight.over(changes)"),
            ("return USUAL if flown is None else combine_scales(USUAL, flown)", "return flown or USUAL"),
            ("self.shown.std / (1.0 - growth)", "self.shown.std"),
            ("(self.shown.value - self.power) / (1.0 - growth)", "self.shown.value - self.power"),
            ("min(max(growth, 0.0), STEADY)", "growth"),
            ("value=share.value * power, std", "value=share.value, std"),
            ("return self.exponent.share", "return self.exponent.std"),
            ("for side in (-1.0, 1.0)", "for side in (1.0,)"),
            ("likely[1] / sum(likely)", "likely[1]"),
            ("near = NEAR if self.from_flight else 1.0", "near = NEAR"),
        ),
    ),
    "fit/motors/bent_law.py": Room(
        tests=(
            "tests/fit/motors/test_law_from_thrust.py",
            "tests/results/test_command_units.py",
        ),
        changed=(
            ("(np.maximum(speed, 0.0) / anchor) ** power", "(np.maximum(speed, 0.0) / anchor)"),
            ("exponent=power * law.curve.exponent", "exponent=law.curve.exponent"),
        ),
    ),
    "fit/dataset/torn_weight.py": Room(
        tests=("tests/fit/dataset/test_carried_weight.py",),
        changed=(
            ("- bias.value, std=bias.std", "- bias.value, std=0.1 * bias.std"),
            ("std=velocity_std * unsure", "std=10.0 * velocity_std * unsure"),
        ),
    ),
    "fit/dataset/vertical_motion.py": Room(
        tests=("tests/fit/dataset/test_carried_weight.py",),
        scaled=("FORGOTTEN = <<2.0>>", "np.sqrt(<<12.0>> * min"),
        changed=(("bell = share * (1.0 - share)", "bell = np.ones_like(share)"),),
    ),
    "fit/dataset/carried_weight.py": Room(
        tests=("tests/fit/dataset/test_carried_weight.py",),
        scaled=(
            "PRIOR_VELOCITIES = <<2.0>>",
        ),
        changed=(
            ("left + brake * swing", "left"),
            (" - bias.value", ""),
            ("known.reconciled_with(read)", "known.with_other(read)"),
            ("flight.any_velocity, piece", "np.zeros_like(flight.any_velocity), piece"),
            ("needed = GRAVITY + gained.value + drag", "needed = GRAVITY + gained.value"),
        ),
    ),
    "fit/reduction/motor_timing.py": Room(
        tests=("tests/fit/test_timing_deviations.py",),
        scaled=(
            "LAG_PRIOR: Final = (<<0.035>>, 0.03)",
            "LAG_PRIOR: Final = (0.035, <<0.03>>)",
            "SUM_FAULT: Final = <<1e-4>>",
            "SPLIT_FAULT: Final = <<3e-4>>",
            "(<<mean - self.at.mean_lag>>, std)",
            "(mean - self.at.mean_lag, <<std>>)",
            "return <<1.96 * std>> <=",
        ),
    ),
    "fit/fit_flights.py": Room(
        tests=("tests/fit/test_widened.py", "tests/fit/test_other_settings.py"),
        scaled=(
            "return <<2.0>> * np.sqrt(np.sum",
            "half_width=<<2.0>> * np.abs(shift",
            "shift(dataset, <<0.5>> * EDGES[-1])",
            "half = <<0.5>> / dataset",
            "max(half, <<found.total_std>>)",
            "at.lag + <<found.lag_std>>, at.delay",
            "at.delay - <<found.lag_std>>\n",
            "longer_arms(vehicle, <<vehicle.arm_std>>)",
            "std = <<vehicle.imu_position_std>>",
            "share = <<length / vehicle.arm>>",
            "place[axis] += <<length>>",
            "half = <<2.0 * np.sqrt(np.mean(np.square(shifts), axis=0))>>",
        ),
        changed=(
            ("np.sqrt(np.sum(squares, axis=0))", "np.sqrt(np.max(squares, axis=0))"),
            ("np.mean([shift(", "np.sum([shift("),
            ("step, at = max(half, found.total_std)", "step, at = found.total_std"),
            ("step, at = max(half, found.total_std)", "step, at = half"),
            ("[] if timed else", ""),
            ("for move in (-step, step)", "for move in (step,)"),
            ("at.delay - found.lag_std", "at.delay"),
            ("for axis in range(3)", "for axis in range(2)"),
        ),
    ),
    "fit/row_fits.py": Room(
        tests=("tests/fit/test_known_beforehand.py", "tests/fit/test_row_intervals.py"),
        scaled=(
            '"difference": <<1.0>>,\n    "Ixy"',
            '"Ixy": <<0.2>>',
            '"Ixz": <<0.2>>',
            '"Iyz": <<0.2>>',
            '"Jr": <<0.003>>',
            "\nROW_SPREAD_STD = <<0.015>>",
            '"Fx_0": <<mass * MOUNTING_STD>>',
            '"Fy_0": <<mass * MOUNTING_STD>>',
            '"Fz_0": <<mass * ACCEL_BIAS_STD>>',
            'spread = <<ROW_SPREAD_STD * abs(first.estimate.value("kt"))>>',
            "return <<max(explained, 0.0) / max(residual, np.finfo(float).tiny)>>",
            "return <<explained / np.maximum(residual, np.finfo(float).tiny)>>",
            "weighed = <<1.96 * mass_std / mass>>",
            "tilt[i] = <<2.0 * value>>",
            "<<MOST_DRAG * lean / vehicle.arm * value>>",
            "weight[i] = <<weighed * value>>",
            "size = max(value, <<number_scale(numbers, name, mass=mass, arm=vehicle.arm)>>)",
            "MOST_DRAG = <<0.03>>",
            "np.full(count, <<np.sqrt(blocks / f)>>)",
            "motion[i] = <<attenuation_allowance(name, size, rho, with_response=False)>>",
        ),
        changed=(
            ("float(fit.known_power[inside].sum()) - residual", "float(fit.known_power[inside].sum())"),
            ("residual = float(fit.residual_power[inside].sum())", "residual = float(fit.residual_power.sum())"),
            ("free = [max(blocks - count, 1)", "free = [max(blocks, 1)"),
            ("float(min(free))", "float(max(free))"),
            ("rho, with_response=False)", "rho, with_response=True)"),
        ),
    ),
    "fit/joint/informative_bands.py": Room(
        tests=("tests/fit/test_informative_bands.py",),
        changed=(
            ("with_response = flown[:, [NOISY.index(name) for name in TURN_ERRORS]]", "with_response = np.ones_like(flown[:, turns])"),
            ("counted = counted_bands(factors, flown)", "counted = np.ones_like(flown)"),
            ("counted[:, THRUST] = thrust | (factors.band[:, 0] == 0.0)", "pass"),
            ("counted[:, YAW] &= _yawed_flights(factors, flown[:, YAW])", "pass"),
            ("return or_every(yawed)[:, 0]", "return yawed[:, 0]"),
        ),
    ),
    "fit/joint/term_choice.py": Room(
        tests=("tests/fit/test_expected_gain.py",),
        scaled=(
            "LEAST_GAIN = <<50.0>>",
            "SURE = <<4.0>>",
            "least = <<LEAST_GAIN * len(joint)>>",
            "return <<0.5 * float(equations.scores.sum(axis=0) @ equations.step)>>",
            "if gains[name] < <<0.5 * needed>>:",
        ),
    ),
    "fit/timing/timing_faults.py": Room(
        tests=("tests/fit/test_timing_deviations.py", "tests/fit/test_late_accelerometer.py"),
        scaled=(
            "HOLD_FAULT: Final = <<0.25>>",
            "SLOW_DELAY: Final = <<float(np.sqrt(2.0) / (2.0 * np.pi))>>",
            "return <<HOLD_FAULT / min(rates)>>",
        ),
        changed=(
            ("HOLD_FAULT / min(rates)", "HOLD_FAULT / max(rates)"),
            ("return 0.0\n    rates", "pass\n    rates"),
        ),
    ),
    "fit/timing/timed_fit.py": Room(
        tests=("tests/fit/test_timing_deviations.py",),
        scaled=(
            "LONGEST_MOVE: Final = <<0.02>>",
            "NEAR: Final = <<0.3>>",
            "LEAST_GAIN: Final = <<10.0>>",
        ),
    ),
    "fit/timing/timing_fit.py": Room(
        tests=("tests/fit/test_timing_deviations.py",),
        scaled=(
            "MOST_ROUNDS: Final = <<15>>",
            "LONGEST_LAG: Final = <<0.2>>",
            "LONGEST_DELAY: Final = <<0.16>>",
            "UNIDENTIFIABLE_BIAS: Final = <<0.03>>",
            "delay_std=<<UNIDENTIFIABLE_BIAS>> if delay_free",
            "total_std=_norm_of_deviations(std, <<UNIDENTIFIABLE_BIAS>>) if",
            "_norm_of_deviations(<<lag>>, split, held, shape, late)",
            "_norm_of_deviations(lag, <<split>>, held, shape, late)",
            "_norm_of_deviations(lag, split, <<held>>, shape, late)",
            "_norm_of_deviations(lag, split, held, <<shape>>, late)",
            "_norm_of_deviations(lag, split, held, shape, <<late>>)",
            "_norm_of_deviations(<<delay>>, split, hold, shape, gusts)",
            "_norm_of_deviations(delay, <<split>>, hold, shape, gusts)",
            "_norm_of_deviations(delay, split, <<hold>>, shape, gusts)",
            "_norm_of_deviations(delay, split, hold, shape, <<gusts>>)",
            'total_std=_norm_of_deviations(<<std["total"]>>, SUM_FAULT, hold, shape, gusts)',
            'total_std=_norm_of_deviations(std["total"], <<SUM_FAULT>>, hold, shape, gusts)',
            'total_std=_norm_of_deviations(std["total"], SUM_FAULT, <<hold>>, shape, gusts)',
            "chance = <<random_half_width(fit, rows, formal_covariance(fit, rows))>>",
            "by_response = <<np.abs(response_sensitivity(fit) @ rows.T).sum(axis=0)>>",
        ),
        changed=(
            ("dataset.lag_std(response.mean_lag, _norm_of_deviations(lag, split, held, shape, late))", "_norm_of_deviations(lag, split, held, shape, late)"),
            ("(hold, gusts) if delay is None else (0.0, 0.0)", "(0.0, gusts)"),
            ("(hold, gusts) if delay is None else (0.0, 0.0)", "(hold, gusts)"),
            ("np.abs(response_sensitivity(fit) @ rows.T).sum(axis=0)", "np.abs((response_sensitivity(fit) @ rows.T).sum(axis=0))"),
            ("late = total > 0.0 and ", "late = "),
            ('if name != "motor_skew")', ")"),
            ('and dataset.source == "imu"', ""),
            ("SPLIT_FAULT if lag is not None and delay is not None else SUM_FAULT", "SPLIT_FAULT"),
        ),
    ),
    "fit/timing/timing_search.py": Room(
        tests=("tests/fit/test_timing_deviations.py",),
        scaled=(
            "LEAST_GAIN: Final = <<10.0>>",
            "GUST_BIAS: Final = <<0.15>>",
            "SMALLEST_RATIO: Final = <<0.1>>",
            "FURTHEST: Final = <<0.16>>",
            "<<0.5 * ((lag - mean) / std) ** 2>>",
            "return <<GUST_BIAS / max(most, SMALLEST_RATIO)>>",
        ),
        changed=(
            ("most = max(float(own", "most = min(float(own"),
            ("mass=mass) & ~slow_bands(factors)", "mass=mass)"),
            ("flown[:, :turns].any()", "flown.any()"),
            ("own[:turns].max()", "own.max()"),
            ("factors.select(slow_bands(factors)[:, 0])", "factors"),
            ("best == len(LAGS_TRIED) - 1", "False"),
            ("max(LAGS_TRIED[best], 0.005)", "LAGS_TRIED[best]"),
            ("if values[0] - values[best] < LEAST_GAIN:", "if False:"),
            ("* (1.0 if best else -1.0)", ""),
        ),
    ),
    "fit/dataset/weight_balance.py": Room(
        tests=("tests/fit/weight/test_kt_from_weight.py",),
        scaled=(
            "LONGEST_WINDOW = <<10.0>>",
            "SHORTEST_WINDOW = <<2.0>>",
            "VELOCITY_CHANGE = <<1.5>>",
            "std=<<VELOCITY_CHANGE * float(np.sqrt(breaks)) / seconds / GRAVITY>>,",
            "std=<<float(weight.sum() ** -0.5)>>,",
        ),
        changed=(
            ("breaks = 1 + sum(", "breaks = sum("),
            ("float(np.sqrt(breaks))", "breaks"),
            ("float(np.sqrt(breaks))", "1.0"),
            ("part.std**-2.0", "part.std**-1.0"),
        ),
    ),
    "fit/reduction/reduce.py": Room(
        tests=("tests/fit/reduction/test_rotor_noise.py",),
        scaled=(
            "half = <<0.5>> * flight.rotor_speed_std**2",
            "= <<4.0 * square * half * average>>",
            "= <<weight * half * difference**2>>",
        ),
        changed=(
            ("4.0 * square * half * average", "4.0 * square * half"),
            ("half * difference**2", "half * difference"),
            ("real[:1] / np.sqrt(2.0)", "real[:1]"),
            ("difference = np.sin(turn) * flight.sample_rate", "pass"),
        ),
    ),
    "checks/verdicts/parameters.py": Room(
        tests=(
            "tests/checks/verdicts/test_motor_parameters.py",
            "tests/results/test_stated_intervals.py",
            "tests/checks/verdicts/test_rotor_spread.py",
        ),
        scaled=(
            "TIME_SCALE = <<0.008>>",
            "half = <<1.96>> * std\n",
            "<<1.96>> * timing.total_std",
            "interval=(value - <<1.96 * std>>, value + 1.96 * std)",
            "interval=(value - 1.96 * std, value + <<1.96 * std>>)",
            "sharp, known = half <= <<WEAK>> *",
            "MOSTLY_ASSUMED = <<0.5>>",
            "fit.problem.prior_std[name] ** <<2>> for",
            "left = <<np.sqrt(_own_variance(spread, names, after) / _own_variance(spread, names, before))>>",
        ),
        changed=(
            ("WEAK * max(abs(value), TIME_SCALE)", "WEAK * abs(value)"),
            ('(response.mean_lag, timing.lag_std)', '(response.lag, timing.lag_std)'),
            ("own -= own.mean(axis=0)", "pass"),
            ("left = np.sqrt(", "left = np.array("),
        ),
    ),
    "results/row_tables.py": Room(
        tests=("tests/results/test_stated_intervals.py",),
        scaled=(
            "judge(value, <<1.96>> * std",
            "half = <<1.96>> * std",
        ),
    ),
    "results/physical_inertia.py": Room(
        tests=("tests/results/test_physical_inertia.py",),
        scaled=(
            "return <<0.5>> * float(np.sqrt(abs(diagonal[i] * diagonal[j])))",
            "return <<0.5>> * float(np.sqrt(mass *",
        ),
    ),
    "checks/impossible_inertia.py": Room(
        tests=("tests/results/test_physical_inertia.py",),
        scaled=(
            "spread = <<slope * half>>",
            "share=_moment_share(float(moments[0]), <<0.5>> *",
            "return self.value + <<self.half_width>> < 0.0",
        ),
        changed=(
            ("spread @ numbers.correlation[np.ix_(places, places)] @ spread", "spread @ spread"),
        ),
    ),
    "checks/verdicts/judge.py": Room(
        tests=("tests/results/test_result.py",),
        scaled=(
            "\nWEAK = <<0.25>>",
            "HOPELESS = <<1.0>>",
            "HOPELESS_YAW = <<0.5>>",
            "size = <<max(abs(value), scale)>>",
        ),
        changed=(
            ("max(abs(value), scale)", "max(value, scale)"),
            ("HOPELESS_YAW if little and axis", "HOPELESS_YAW if axis"),
        ),
    ),
    "checks/weak_directions.py": Room(
        tests=(
            "tests/checks/test_weak_directions.py",
            "tests/checks/verdicts/test_motor_parameters.py",
            "tests/results/test_stated_intervals.py",
        ),
        scaled=(
            "GOOD, FAIR, ONE_AXIS = <<10.0>>, 30.0",
            "ONE_AXIS = 10.0, <<30.0>>, 255.0",
            "ONE_AXIS = 10.0, 30.0, <<255.0>>",
            "\nSHARE = <<0.3>>",
            "\nSAME = <<0.2>>",
            "rho < <<2.0>> * LEAST_EXCITATION",
        ),
        changed=(("root = np.sqrt(np.maximum(values, 0.0))", "root = np.maximum(values, 0.0)"),),
    ),
    "results/validation/replay.py": Room(
        tests=("tests/results/validation/test_whiteness.py", "tests/results/validation/test_replay.py"),
        scaled=("NORMAL_95: Final = <<1.96>>",),
    ),
    "results/validation/validate.py": Room(
        tests=("tests/results/validation/test_whiteness.py", "tests/results/validation/test_validate.py"),
        scaled=(
            "\nCUTOFF = <<3.0>>",
            "WHITENESS_LAGS = <<10>>",
            "step = max(round(<<data.sample_rate / cutoff>>), 1)",
            "return <<float(np.linalg.norm(body[:, i] - rotors[:, i])) / max(size, np.finfo(float).tiny)>>",
            "return <<max(abs(float(x[lag:] @ x[:-lag])) for lag in range(1, WHITENESS_LAGS + 1)) / power>>",
        ),
        changed=(
            ("x = residual - residual.mean()", "x = residual"),
            ("range(1, WHITENESS_LAGS + 1)", "range(1, 2)"),
            ("range(1, WHITENESS_LAGS + 1)", "range(1, WHITENESS_LAGS)"),
            ("max(abs(float(x[lag:] @ x[:-lag]))", "max(float(x[lag:] @ x[:-lag])"),
            ("size = float(np.linalg.norm(rotors[:, i]))", "size = float(np.linalg.norm(body[:, i]))"),
        ),
    ),
}  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class Fault:
    """One replacement in one file."""

    file: str
    old: str
    new: str

    @property
    def words(self) -> str:
        """Say what is replaced by what, in one line."""
        return " ".join(f"{self.old}  ->  {self.new}".split())


def planted(file: str, room: Room) -> Iterator[Fault]:
    """Yield every fault of a file."""
    for marked in room.scaled:
        before, _, rest = marked.partition(OPENS)
        term, _, after = rest.partition(ENDS)
        whole = term.isdigit()  # a count or an exponent stays one
        halved = str(int(term) // 2) if whole else f"(0.5 * ({term}))"
        doubled = str(2 * int(term)) if whole else f"(2.0 * ({term}))"
        for factor in (halved, doubled):
            yield Fault(file=file, old=before + term + after, new=before + factor + after)
    for old, new in room.changed:
        yield Fault(file=file, old=old, new=new)


def refuse_missing() -> None:
    """Raise where a fault's place is not in its file exactly once, or its tests are gone."""
    for file, room in ROOMS.items():
        text = (ROOT / "src/rotorfit" / file).read_text(encoding="utf-8")
        for fault in planted(file, room):
            if (count := text.count(fault.old)) != 1:
                raise SystemExit(f"{file}: {fault.old!r} is there {count} times, and not once")
        for test in room.tests:
            if not (ROOT / test).is_file():
                raise SystemExit(f"{file}: no {test}")


def noticed(fault: Fault, tests: tuple[str, ...], source: Path) -> bool:
    """Return whether the tests fail with a fault in the copy of the source."""
    path = source / "rotorfit" / fault.file
    right = path.read_text(encoding="utf-8")
    _write(path, right.replace(fault.old, fault.new))
    try:
        return _failed(tests, source)
    finally:
        _write(path, right)


def _write(path: Path, text: str) -> None:
    """Write a module; what was compiled of it may have the same second and size, and goes."""
    path.write_text(text, encoding="utf-8")
    for compiled in (path.parent / "__pycache__").glob(f"{path.stem}.*.pyc"):
        compiled.unlink()


def _failed(tests: tuple[str, ...], source: Path) -> bool:
    """Return whether a test fails; raise where pytest could not even begin.

    In a process of its own that has all but rotorfit imported already: half of the time.
    """
    said = source.parent / "said.txt"
    child = os.fork()
    if child == 0:
        code = 98
        try:
            code = _run(tests, source, said)
        except BaseException:
            traceback.print_exc()
        finally:
            os._exit(code)
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    if code not in (0, 1):
        raise SystemExit(f"pytest ended with {code}:\n{said.read_text()}")
    return code == 1


def _run(tests: tuple[str, ...], source: Path, said: Path) -> int:
    """Run pytest with the copy in front, all that it says into a file; return how it ended."""
    with said.open("w") as file:
        os.dup2(file.fileno(), 1)
        os.dup2(file.fileno(), 2)
    sys.path.insert(0, str(source))
    os.environ["PYTHONPATH"] = str(source)
    os.chdir(ROOT)
    # Without the checks of shapes: they take half of the time, and no fault changes a shape.
    options = ("-x", "-q", "--tb=no", "-p", "no:cacheprovider", "--hypothesis-profile=ci")
    early = ("-W", "ignore::pytest.PytestAssertRewriteWarning")  # of what is imported above
    code = int(pytest.main([*options, *early, "--jaxtyping-packages=", *tests]))
    sys.stdout.flush()
    taken = Path(sys.modules["rotorfit"].__file__ or "")
    return code if taken.is_relative_to(source) else 99


def main() -> None:
    parser = argparse.ArgumentParser(description="Plant faults one at a time, and run the tests.")
    parser.add_argument("--only", default="", help="files and replacements that hold this text")
    only = parser.parse_args().only
    refuse_missing()
    faults = [
        (fault, room.tests)
        for file, room in ROOMS.items()
        for fault in planted(file, room)
        if only in file or only in fault.old
    ]
    missed, start = 0, time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "src"
        shutil.copytree(ROOT / "src", source, ignore=shutil.ignore_patterns("__pycache__"))
        every = tuple(dict.fromkeys(test for _, tests in faults for test in tests))
        if _failed(every, source):
            said = (source.parent / "said.txt").read_text()
            raise SystemExit(f"the tests fail without any fault: mend them first\n{said}")
        for fault, tests in faults:
            seen = noticed(fault, tests, source)
            missed += not seen
            print(
                f"{'noticed    ' if seen else 'NOT NOTICED'}  {fault.file}: {fault.words}",
                flush=True,
            )
    print(f"{len(faults)} faults, {missed} not noticed, {time.perf_counter() - start:.0f} s")
    raise SystemExit(1 if missed else 0)


if __name__ == "__main__":
    main()
