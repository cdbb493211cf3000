"""The accuracy study: its bound is the bound, its rivals are themselves, and it runs."""

import functools
import json
from dataclasses import replace

import numpy as np
import pytest
from benchmarks.accuracy import __main__ as study_command
from benchmarks.accuracy import bound, rivals
from benchmarks.accuracy.runs import METHODS, Study, fly, one_run
from benchmarks.accuracy.tables import limits, scored, tables_text
from benchmarks.common import true_values
from scipy import optimize
from scipy.signal import windows

from rotorfit.estimation.estimate import LinearProblem
from rotorfit.estimation.factors import time_block_factors
from rotorfit.estimation.parameter_map import parameter_map
from rotorfit.fit.joint.joint_map import joint_map
from rotorfit.fit.joint.joint_problem import NOISY
from rotorfit.model.regressor import regressor
from rotorfit.model.signals import signal_matrix
from rotorfit.simulation import sampled_flight_data

SHORT = Study(vehicles=("A",), seconds=15.0)
SLOPE = parameter_map(("slope", "one"), {"slope": {(0, "slope"): 1.0}}, {(0, "one"): -1.0})
"""slope x - y = 0 of the signals (x, y)."""
SLOPE_TENSOR = np.eye(2)[:, None, :]


@pytest.fixture(scope="module")
def stressed():
    return fly(3, scenario="stress", study=replace(SHORT, vehicles=("A", "B")))


def line_spectrum(rng, lines):
    x = rng.normal(size=lines) + 1j * rng.normal(size=lines)
    noise = np.zeros((lines, 2, 2), dtype=complex)
    noise[:, 0, 0] = rng.uniform(0.005, 0.03, lines)
    noise[:, 1, 1] = rng.uniform(0.02, 0.2, lines)
    return bound.Spectrum(
        weight=np.full(lines, 2.0),
        frequency=np.arange(1.0, lines + 1.0),
        signals=np.column_stack([x, 1.7 * x]),
        noise=noise,
        disturbance=np.zeros((lines, 1)),
    )


def test_an_efficient_estimate_scatters_by_the_bound():
    # Errors in both variables, a different noise in every line: maximum likelihood is known.
    rng = np.random.default_rng(4)
    line = line_spectrum(rng, 60)
    model = bound.LinearModel(
        tensors=(SLOPE_TENSOR,), map=SLOPE, phi=np.array([1.7]), noisy=(1,), rotors=()
    )
    least = 1.0 / np.sqrt(bound.fisher([line], model)[0, 0])
    root = np.sqrt(np.einsum("lzz->lz", line.noise).real / 2.0)

    def estimate():
        error = rng.normal(size=(2, *root.shape))
        x, y = (line.signals + root * (error[0] + 1j * error[1])).T

        def cost(slope):
            return np.sum(
                np.abs(slope * x - y) ** 2 / (2 * (slope**2 * root[:, 0] ** 2 + root[:, 1] ** 2))
            )

        return optimize.minimize_scalar(cost, bracket=(1.6, 1.8)).x

    found = np.array([estimate() for _ in range(500)])
    assert found.std() == pytest.approx(least, rel=0.1)  # three deviations of a deviation
    assert found.mean() == pytest.approx(1.7, abs=0.2 * least)


def expected_cost(flights, joint, at, late):
    """Return the mean of minus the log-likelihood at other parameters, up to a constant."""
    physics = regressor(flights["A"].vehicle)
    theta, total = joint_map(joint).theta(at), 0.0
    for c, flight in enumerate(flights.values()):
        s = bound.flight_spectrum(flight, flight.vehicle, rotor_speed_std=5.0)
        truth = np.tensordot(joint_map(joint).theta(true_phi(flights, joint))[c], physics.tensor, 1)
        z = bound.explained(s.signals, truth, [physics.layout.index(n) for n in NOISY])
        for i, name in enumerate(physics.layout.names):
            if name[0] == "O" or "H" in name:
                z[:, i] *= np.exp(-2j * np.pi * s.frequency * late)
        B = np.tensordot(theta[c], physics.tensor, 1)
        for weight, line, N, Q in zip(s.weight, z, s.noise, s.disturbance, strict=True):
            r = B @ line
            total += 0.5 * weight * (r.conj() @ np.linalg.solve(B @ N @ B.T + np.diag(Q), r)).real
    return total


def true_phi(flights, joint):
    return bound.true_phi(joint_map(joint), flights)


def test_information_is_the_curvature_of_the_expected_likelihood(stressed):
    physics = regressor(stressed["A"].vehicle)
    joint = [bound.joint_configuration(name, f, physics) for name, f in stressed.items()]
    phi = true_phi(stressed, joint)
    model = bound.LinearModel(
        tensors=(physics.tensor,) * 2,
        map=joint_map(joint),
        phi=phi,
        noisy=tuple(physics.layout.index(n) for n in NOISY),
        rotors=tuple(i for i, n in enumerate(physics.layout.names) if n[0] == "O" or "H" in n),
    )
    spectra = [bound.flight_spectrum(f, f.vehicle, rotor_speed_std=5.0) for f in stressed.values()]
    F = bound.fisher(spectra, model, lags=(None,))
    size = 1.0 / np.sqrt(np.diagonal(F))
    rng = np.random.default_rng(0)
    for _ in range(3):
        step = 0.05 * size * rng.normal(size=len(size))
        up, down = (
            expected_cost(stressed, joint, phi + sign * step[:-1], sign * step[-1])
            for sign in (1.0, -1.0)
        )
        at = expected_cost(stressed, joint, phi, 0.0)
        assert at == pytest.approx(0.0, abs=1e-9)
        assert up + down - 2.0 * at == pytest.approx(step @ F @ step, rel=1e-3)


def in_lines(signals, flight):
    """Return signals windowed and transformed as the spectrum's are."""
    n = len(signals)
    window = windows.tukey(n, bound.TAPER)[:, None] / np.sqrt(n)
    lines = np.fft.rfft(signals * window, axis=0)
    return lines[np.fft.rfftfreq(n, 1.0 / flight.sample_rate) <= bound.TOP]


def test_noise_and_gusts_have_the_spectra_that_the_bound_takes():
    flight = fly(0, scenario="S2b", study=replace(SHORT, seconds=60.0))["A"]
    spectrum = bound.flight_spectrum(flight, flight.vehicle, rotor_speed_std=5.0)
    physics, rows = regressor(flight.vehicle), (1, len(flight.time) - 1)
    exact = signal_matrix(sampled_flight_data(flight), flight.vehicle, *rows)
    logged = sampled_flight_data(flight, signals="measured")
    noise = in_lines(signal_matrix(logged, flight.vehicle, *rows) - exact, flight)
    theta = flight.truth.parameters()
    theta["kt"] = flight.truth.kt
    gusts = in_lines(physics.residual(exact, theta), flight)
    power = (spectrum.weight[:, None] * np.abs(in_lines(exact, flight)) ** 2).sum(axis=0)
    window = windows.tukey(len(exact), bound.TAPER)[:, None]
    body = [physics.layout.index(n) for n in ("az", "dwy", "wxwy", "O2_1", "one")]
    np.testing.assert_allclose(power[body], ((window * exact) ** 2).sum(axis=0)[body], rtol=0.02)
    for low, high in ((0.05, 2.0), (2.0, 10.0), (10.0, 30.0)):
        band = (spectrum.frequency > low) & (spectrum.frequency <= high)
        tolerance = 4.0 / np.sqrt(band.sum())
        for name in ("ax", "dwx", "dwz", "wxwx", "O2_3", "dHz"):
            i = physics.layout.index(name)
            taken = spectrum.noise[band, i, i].real
            found = np.abs(noise[band, i]) ** 2
            assert np.mean(found / taken) == pytest.approx(1.0, abs=tolerance), (name, low)
        if high < 20.0:
            found = np.abs(gusts[band]) ** 2 / spectrum.disturbance[band]
            np.testing.assert_allclose(found.mean(axis=0), 1.0, atol=tolerance)
        cross = np.real(noise[band, physics.layout.index("O2_1")].conj() * noise[band, -4])
        i, j = physics.layout.index("O2_1"), len(physics.layout) - 4
        size = np.sqrt(np.mean(np.abs(noise[band, i]) ** 2) * np.mean(np.abs(noise[band, j]) ** 2))
        taken = np.mean(spectrum.noise[band, i, j].real)
        assert abs(np.mean(cross) - taken) < tolerance * size


def test_the_bound_is_taken_at_the_truth(stressed):
    found = bound.flights_bound(stressed, commanded=True)
    for owner, flight in stressed.items():
        for name, value in true_values(flight).items():
            full = f"{name}@{owner}" if f"{name}@{owner}" in found.true else name
            if full in found.true and name != "kd_over_kt":
                assert found.true[full] == pytest.approx(value, rel=1e-9, abs=1e-15), full
    assert found.std["kd"] < 0.1 * found.true["kd"]


def test_a_longer_flight_has_a_smaller_bound():
    short, long = (
        bound.flights_bound(fly(0, scenario="S1", study=replace(SHORT, seconds=s)), commanded=False)
        for s in (12.0, 36.0)
    )
    assert long.std["Ixx@A"] == pytest.approx(3**-0.5 * short.std["Ixx@A"], rel=0.25)


def test_noise_scaled_total_least_squares_solves_a_line_exactly():
    rng = np.random.default_rng(1)
    x = rng.normal(size=4000)
    rows = np.column_stack([x + 0.3 * rng.normal(size=4000), 1.7 * x + rng.normal(size=4000)])
    noise = np.diag([0.3**2, 1.0])
    problem = LinearProblem(
        factors=(time_block_factors(rows, block_rows=100),),
        tensors=(SLOPE_TENSOR,),
        map=SLOPE,
        weights=np.ones((1, 1)),
    )
    (sxx, sxy), (_, syy) = rows.T @ rows
    ratio = noise[1, 1] / noise[0, 0]
    half = 0.5 * (syy - ratio * sxx)
    deming = (half + np.sqrt(half**2 + ratio * sxy**2)) / sxy
    found = rivals.noise_scaled_total(problem, [noise])
    assert found.values[0] == pytest.approx(deming, rel=1e-9)
    assert abs(found.values[0] - 1.7) < 4.0 * found.std[0] < 0.2


@functools.cache
def truth_of_a():
    return true_values(fly(0, scenario="S1", study=replace(SHORT, seconds=10.0))["A"])


def made_up_runs(*, count, scatter, width):
    """Return runs of an estimate with a known scatter and claimed width, in bounds."""
    rng = np.random.default_rng(2)
    true = truth_of_a()
    names = ("kt", "kd", "msx@A", "Ixx@A", "Iyy@A", "Izz@A")
    runs = []
    for _ in range(count):
        bounds = {n: 0.01 * abs(true[n.removesuffix("@A")]) for n in names}
        rows = {
            n: [true[n.removesuffix("@A")] + scatter * b * rng.normal(), width * b, "identified"]
            for n, b in bounds.items()
        }
        runs.append({"found": {"default": rows}, "bound": bounds})
    return runs


@pytest.mark.parametrize(
    ("scatter", "width", "failing"),
    [
        (1.0, 1.96, []),
        (1.6, 1.96, ["RMSE / bound, median", "RMSE / bound, worst", "coverage, mean"]),
        (1.0, 5.0, ["coverage, mean"]),
    ],
)
def test_limits_separate_good_from_bad(scatter, width, failing):
    runs = made_up_runs(count=150, scatter=scatter, width=width)
    verdicts = limits(scored(runs, "default", scenario="S1", study=SHORT), "S1")
    failed = [v.what for v in verdicts if not v.passed and v.what != "coverage, least"]
    assert failed == failing
    assert verdicts[0].value == pytest.approx(scatter, rel=0.15)


@pytest.mark.parametrize("scenario", ["S1", pytest.param("stress", marks=pytest.mark.slow)])
def test_one_run_has_every_method_and_the_bound(scenario):
    run = one_run(1, scenario=scenario, study=SHORT)
    assert set(run["found"]) == set(METHODS)
    result = scored([run], "default", scenario=scenario, study=SHORT)
    assert {"kt", "kd", "Ixx@A", "Izz@A"} <= set(result.names)
    inertia = result.take(names=["Ixx@A", "Iyy@A"])
    assert (inertia.error**2 < 0.05**2).all()
    assert (inertia.bound < inertia.half_width).all()
    assert "rmse/bound" in tables_text([run], scenario=scenario, study=SHORT)
    assert json.loads(json.dumps(run)) == run


@pytest.mark.slow
def test_a_stopped_study_goes_on_where_it_was(tmp_path, capsys, monkeypatch):
    words = ["--scenario", "S1", "--vehicles", "A", "--seconds", "15", "--workers", "1"]
    words += ["-o", str(tmp_path / "runs.json")]
    assert study_command.main([*words, "--runs", "2"]) in (0, 1)
    first = capsys.readouterr().out
    assert "S1: A, 15 s each, 2 runs" in first

    def flown_again(*_, **__):
        raise AssertionError

    monkeypatch.setattr(study_command, "one_run", flown_again)
    study_command.main([*words, "--runs", "2"])
    assert capsys.readouterr().out == first
    with pytest.raises(SystemExit, match="give another file"):
        study_command.main([*words, "--runs", "2", "--seed", "9"])
