"""Triangular factors against the dense observation matrix: time, memory and agreement.

    python benchmarks/factors_speed.py

solves the identification problem of Six et al. 2020 (eleven parameters, weighed mass) for 90 s and
for 2.5 h of flight at 200 Hz, from the recorded arrays to the solution, in both ways: the matrix
W_t (6n x 12) of eq. 13 and its thin singular value decomposition, and the factors of the signals.
One thread. The flight is made up; it obeys Newton-Euler but for white noise.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy reads it

import dataclasses
import resource
import subprocess
import sys
import tempfile
import time
import tracemalloc
from pathlib import Path

import numpy as np
import scipy.linalg

from rotorfit.estimation.estimate import LinearProblem
from rotorfit.estimation.factors import Factors
from rotorfit.estimation.least_squares import total
from rotorfit.estimation.parameter_map import parameter_map
from rotorfit.fit.reduction.reduce import time_factors
from rotorfit.flight.flight_data import FlightData, Segment
from rotorfit.model.regressor import Regressor, regressor
from rotorfit.model.signals import signal_matrix
from rotorfit.model.vehicle import Rotor, Vehicle

RATE = 200.0
ARM = 0.2
MASS = 1.285
BLOCK_SECONDS = 10.0  # The paper's estimate has no use for the scatter of shorter ones.
FREE = ("kt", "kd", "msx", "msy", "msz", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")
TRUTH = {
    "mass": MASS, "kt": 3.63e-6, "kd": 5.11e-8, "msx": -4.5e-3, "msy": -1.9e-3, "msz": -8.3e-3,
    "Ixx": 0.0182, "Iyy": 0.0186, "Izz": 0.0288, "Ixy": 5e-5, "Ixz": 1e-4, "Iyz": -1e-4,
}  # fmt: skip
ARRAYS = {"specific_force": 3, "angular_velocity": 3, "angular_acceleration": 3}
ARRAYS |= {"rotor_speed": 4, "rotor_acceleration": 4}


def plus_frame(arm: float = ARM) -> Vehicle:
    """Return the frame of Six et al. 2020, eq. 9."""
    places = ((0.0, -arm, 0.0), (0.0, arm, 0.0), (arm, 0.0, 0.0), (-arm, 0.0, 0.0))
    spins = ("ccw", "ccw", "cw", "cw")
    return Vehicle(
        rotors=tuple(Rotor(position=p, spin=s) for p, s in zip(places, spins, strict=True))
    )


def made_up_flight(n: int, *, seed: int = 0) -> FlightData:
    """Return smooth rates and rotor speeds, the accelerations they ask for, and sensor noise."""
    rng = np.random.default_rng(seed)
    t = np.arange(n) / RATE
    arrays = {name: np.zeros((n, width)) for name, width in ARRAYS.items()}
    hover = np.sqrt(MASS * 9.81 / (4 * TRUTH["kt"]))
    for name, sizes in (
        ("angular_velocity", (0.8, 0.6, 0.4)),
        ("rotor_speed", (0.08 * hover,) * 4),
    ):
        for column, size in enumerate(sizes):
            for f, phase in zip(rng.uniform(0.1, 4.0, 5), rng.uniform(0, 6.28, 5), strict=True):
                arrays[name][:, column] += 0.6 * size * np.sin(2 * np.pi * f * t + phase)
    arrays["rotor_speed"] += hover
    arrays["rotor_acceleration"][1:] = np.diff(arrays["rotor_speed"], axis=0) * RATE
    flight = as_flight(arrays)
    model = regressor(plus_frame())
    B = np.einsum("p,pjz->jz", [TRUTH.get(name, 0.0) for name in model.names], model.tensor)
    solve = -np.linalg.solve(B[:, :6], B[:, 6:])
    for start in range(0, n, 50_000):
        rows = slice(start, min(start + 50_000, n))
        Z = signal_matrix(flight, plus_frame(), rows.start, rows.stop)
        acceleration = Z[:, 6:] @ solve.T
        arrays["specific_force"][rows] = acceleration[:, :3]
        arrays["angular_acceleration"][rows] = acceleration[:, 3:]
    stds = {"specific_force": 0.4, "angular_velocity": 0.02, "angular_acceleration": 0.5}
    for name, std in (stds | {"rotor_speed": 5.0}).items():
        arrays[name] += std * rng.standard_normal(arrays[name].shape)
    return flight


def as_flight(arrays: dict[str, np.ndarray]) -> FlightData:
    n = len(arrays["specific_force"])
    return FlightData(
        sample_rate=RATE,
        time=np.arange(n) / RATE,
        differentiation="exact",
        segments=(Segment(start=0, stop=n),),
        **arrays,
    )


def dense_matrix(flight: FlightData) -> np.ndarray:
    """Return W_t = [W_k W mW_m] of Six et al. 2020, eq. 13, written entry by entry.

    Columns are contiguous, as LAPACK wants them; rows are ordered by wrench component.
    """
    n, d = len(flight.time), ARM
    W = np.zeros((12, 6, n))
    kt, kd, sx, sy, sz, xx, yy, zz, xy, xz, yz, mass = W
    ax, ay, az = flight.specific_force.T
    x, y, z = flight.angular_velocity.T
    dx, dy, dz = flight.angular_acceleration.T
    s1, s2, s3, s4 = np.square(flight.rotor_speed.T)
    np.negative(s1 + s2 + s3 + s4, out=kt[2])
    np.multiply(s1 - s2, d, out=kt[3])
    np.multiply(s3 - s4, d, out=kt[4])
    np.subtract(s1 + s2, s3 + s4, out=kd[5])
    x2, y2, z2, x_y, x_z, y_z = x * x, y * y, z * z, x * y, x * z, y * z
    np.negative(y2 + z2, out=sx[0]), np.add(x_y, dz, out=sx[1]), np.subtract(x_z, dy, out=sx[2])
    np.subtract(x_y, dz, out=sy[0]), np.negative(x2 + z2, out=sy[1]), np.add(y_z, dx, out=sy[2])
    np.add(x_z, dy, out=sz[0]), np.subtract(y_z, dx, out=sz[1]), np.negative(x2 + y2, out=sz[2])
    np.negative(az, out=sx[4]), np.copyto(sx[5], ay), np.copyto(sy[3], az)
    np.negative(ax, out=sy[5]), np.negative(ay, out=sz[3]), np.copyto(sz[4], ax)
    np.copyto(xx[3], dx), np.copyto(xx[4], x_z), np.negative(x_y, out=xx[5])
    np.negative(y_z, out=yy[3]), np.copyto(yy[4], dy), np.copyto(yy[5], x_y)
    np.copyto(zz[3], y_z), np.negative(x_z, out=zz[4]), np.copyto(zz[5], dz)
    np.subtract(dy, x_z, out=xy[3]), np.add(dx, y_z, out=xy[4]), np.subtract(x2, y2, out=xy[5])
    np.add(dz, x_y, out=xz[3]), np.subtract(z2, x2, out=xz[4]), np.subtract(dx, y_z, out=xz[5])
    np.subtract(y2, z2, out=yz[3]), np.subtract(dz, x_y, out=yz[4]), np.add(dy, x_z, out=yz[5])
    np.multiply(flight.specific_force.T, MASS, out=mass[:3])
    return W.reshape(12, 6 * n).T


def dense_solution(W: np.ndarray) -> np.ndarray:
    """Return the last right singular vector over its last entry; W is overwritten."""
    _, _, Vt = scipy.linalg.svd(W, full_matrices=False, overwrite_a=True, check_finite=False)
    return Vt[-1, :-1] / Vt[-1, -1]


def refined(W: np.ndarray, chi: np.ndarray) -> np.ndarray:
    """Return the dense solution with the digits that its SI columns have cost it.

    (A^T A - s^2 1) chi = -A^T y with the Rayleigh quotient s^2, on columns of unit length.
    """
    R = np.linalg.qr(W, mode="r")
    A, y = R[:, :-1], R[:, -1]
    lengths = np.linalg.norm(A, axis=0)
    for _ in range(3):
        square = np.sum((A @ chi + y) ** 2) / (1.0 + chi @ chi)
        normal = (A / lengths).T @ (A / lengths) - square * np.diag(lengths**-2.0)
        # A residual and its correction, so that the normal equations cost no digits.
        gradient = ((A / lengths).T @ (A @ chi + y)) - square * chi / lengths
        chi = chi - np.linalg.solve(normal, gradient) / lengths
    return chi


def problem(factors: Factors, model: Regressor, free: tuple[str, ...] = FREE) -> LinearProblem:
    return LinearProblem(
        factors=(factors,),
        tensors=(model.tensor,),
        map=parameter_map(
            model.names, {name: {(0, name): 1.0} for name in free}, {(0, "mass"): MASS}
        ),
        weights=np.ones((1, 6)),
    )


def by_factors(flight: FlightData) -> np.ndarray:
    vehicle = plus_frame()
    factors = time_factors(flight, vehicle, block_seconds=BLOCK_SECONDS).merged()
    return total(problem(factors, regressor(vehicle))).values


def by_dense(flight: FlightData) -> np.ndarray:
    return dense_solution(dense_matrix(flight))


def best_time(function, *arguments, repeat: int) -> float:
    """Return the least of several times [s]."""
    times = []
    for _ in range(repeat):
        start = time.perf_counter()
        function(*arguments)
        times.append(time.perf_counter() - start)
    return min(times)


def resolve_times(flight: FlightData) -> dict[str, float]:
    """Return the time of solving again from the factors, by what has changed [s]."""
    factors = time_factors(flight, plus_frame()).merged()
    model = regressor(plus_frame())
    base = problem(factors, model)

    def other_weights() -> None:
        total(dataclasses.replace(base, weights=np.array([[1.0, 1.0, 2.0, 40.0, 50.0, 60.0]])))

    def one_parameter_less() -> None:
        total(dataclasses.replace(base, map=base.map.without("Iyz")))

    def other_geometry() -> None:
        total(dataclasses.replace(base, tensors=(regressor(plus_frame(0.21)).tensor,)))

    changes = (other_weights, one_parameter_less, other_geometry)
    return {f.__name__.replace("_", " "): best_time(f, repeat=50) for f in changes}


def memory_in_child(method: str, folder: str) -> float:
    """Return the peak above the flight's own arrays, measured in a fresh process [MB]."""
    command = [sys.executable, __file__, method, folder]
    return float(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def load(folder: str) -> FlightData:
    return as_flight({name: np.load(Path(folder, f"{name}.npy")) for name in ARRAYS})


def child(method: str, folder: str) -> None:
    if method == "save":
        flight = made_up_flight(1_800_000)
        for name in ARRAYS:
            np.save(Path(folder, f"{name}.npy"), getattr(flight, name))
        return
    if method == "ratio":
        flight = made_up_flight(int(folder))
        dense = best_time(by_dense, flight, repeat=10)
        print(dense / best_time(by_factors, flight, repeat=40))
        return
    solve = {"factors": by_factors, "dense": by_dense}[method]
    flight = load(folder)
    few = as_flight({name: getattr(flight, name)[:2000] for name in ARRAYS})
    solve(few)  # Libraries and their workspaces are no part of the flight.
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    tracemalloc.start()
    solve(flight)
    arrays = tracemalloc.get_traced_memory()[1] / 2**20
    # The process sees LAPACK's own workspace, and the arrays what fits in memory it had already.
    process = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 2**10
    print(max(arrays, process))


def compare(flight: FlightData, repeat: int) -> None:
    n = len(flight.time)
    dense_repeat = max(repeat // 4, 2)
    factors = best_time(by_factors, flight, repeat=repeat)
    build = best_time(dense_matrix, flight, repeat=dense_repeat)
    dense = best_time(by_dense, flight, repeat=dense_repeat)
    chi = by_factors(flight)
    plain = by_dense(flight)
    exact = refined(dense_matrix(flight), plain)
    print(f"\nn = {n:_} samples ({n / RATE / 60:.1f} min)")
    print(
        f"  dense matrix and thin SVD  {dense * 1e3:9.2f} ms   (of it building {build * 1e3:.2f})"
    )
    print(f"  factors and total          {factors * 1e3:9.2f} ms")
    print(f"  ratio                      {dense / factors:9.1f}")
    print("  largest relative difference of the solutions")
    print(f"    factors to refined dense {gap(chi, exact):9.1e}")
    print(f"    plain dense to refined   {gap(plain, exact):9.1e}")
    for what, seconds in resolve_times(flight).items():
        print(f"  solve again, {what:20s}{seconds * 1e6:6.0f} us")


def gap(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.abs(one / other - 1.0).max())


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([sys.executable, __file__, "save", folder], check=True)
        # While this process is small: a child's peak starts at its parent's.
        memory = {method: memory_in_child(method, folder) for method in ("dense", "factors")}
        compare(made_up_flight(18_000), repeat=40)
        compare(load(folder), repeat=8)
    print("  peak memory above the flight's arrays")
    for method, megabytes in memory.items():
        print(f"    {method:8s} {megabytes:8.0f} MB")


if __name__ == "__main__":
    if len(sys.argv) == 3:
        child(sys.argv[1], sys.argv[2])
    else:
        main()
