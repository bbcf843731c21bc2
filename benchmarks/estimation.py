"""Time and peak memory of the estimators against the number of epochs; p = 2, q = 3, m = 3, four biases.

Goals: batch of 10^6 epochs <= 1.5 s and 1 GB, recursive <= 3 s, log-log slope <= 1.1. Each case runs in a process
of its own, so that the peak memory is its own; times are CPU seconds of one thread, without building the problem.
Usage: python benchmarks/estimation.py [largest power of ten, default 6]
"""

import json
import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable

import numpy as np

from nebosvod.estimation import Block, Estimate, LinearProblem, Markov, Prior, White
from nebosvod.estimation.filters import kalman
from nebosvod.estimation.solvers import batch, recursive, separated, sequential

SOLVERS: dict[str, tuple[Callable[[LinearProblem], Estimate], str, int]] = {
    "batch qr": (batch.solve, "white", 6),
    "batch blocks": (lambda problem: batch.solve(problem, "blocks"), "white", 6),
    "batch identity": (lambda problem: batch.solve(problem, "identity"), "white", 6),
    "batch qr, Gauss-Markov": (batch.solve, "markov", 6),
    "recursive with history": (recursive.solve, "white", 6),
    "recursive, Gauss-Markov": (recursive.solve, "markov", 6),
    "Joseph with budget": (sequential.solve, "white", 6),
    "Schmidt with budget": (lambda problem: sequential.solve(problem, "schmidt"), "white", 6),
    "two stages with budget": (separated.solve, "white", 4),
}
GOALS = {"batch qr": 1.5, "recursive with history": 3.0}
BLAS = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


def problem(n: int, z: str) -> LinearProblem:
    """Two instruments with biases and position errors; state of six, three parameters."""
    rng = np.random.default_rng(0)
    label = np.arange(n) % 2
    names = ("x", "y", "z", "vx", "vy", "vz")
    units = np.array([1.0, 1.0, 1.0, 1e6, 1e6, 1e6])
    blocks = [Block(name="state", names=names, H=rng.normal(size=(n, 2, 6)) * units)]
    priors = [Prior(name="state", names=names, covariance=np.diag(1e6 / units**2))]
    for name in ("radius", "mass", "albedo"):
        blocks.append(Block(name=name, names=(name,), H=rng.normal(size=(n, 2, 1))))
        priors.append(Prior(name=name, names=(name,), covariance=[[0.1]]))
    white, markov = [], []
    for instrument in range(2):
        bias = np.zeros((n, 2, 2))
        bias[label == instrument] = np.eye(2)
        own = (f"b{instrument} ra", f"b{instrument} dec")
        blocks.append(Block(name=f"bias {instrument}", names=own, H=bias))
        priors.append(Prior(name=f"bias {instrument}", names=own, covariance=0.25 * np.eye(2)))
        rows = np.flatnonzero(label == instrument)
        H = rng.normal(size=(len(rows), 2, 3))
        if z == "white":
            white.append(White(name=f"z {instrument}", H=H, Q=np.eye(3), rows=rows))
        else:
            F, Q = (np.broadcast_to(value * np.eye(3), (len(rows), 3, 3)) for value in (0.9, 0.19))
            markov.append(Markov(name=f"z {instrument}", H=H, F=F, Q=Q, P0=np.eye(3), rows=rows))
    return LinearProblem(
        residual=rng.normal(size=(n, 2)),
        R=np.eye(2),
        blocks=tuple(blocks),
        priors=tuple(priors),
        white=tuple(white),
        markov=tuple(markov),
        noise_label=label,
        noise_names=("noise 0", "noise 1"),
    )


def measure(name: str, n: int) -> dict[str, float]:
    """CPU seconds (best of three, or of what ten seconds allow) and peak memory of one case in this process."""
    solve, z, _ = SOLVERS[name]
    solve(problem(100, z))
    case = problem(n, z)
    times = []
    for _ in range(3):
        begin = time.process_time()
        solve(case)
        times.append(time.process_time() - begin)
        if sum(times) > 10.0:
            break
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024**2
    return {"seconds": min(times), "gigabytes": peak}


def table(largest: int) -> None:
    """Print all cases, each from a process of its own."""
    environment = os.environ | BLAS
    print(f"{'estimator':26s} {'n':>8s} {'CPU s':>9s} {'peak GB':>8s} {'slope':>6s}  goal")
    for name, (_, _, power) in SOLVERS.items():
        before = None
        for exponent in range(3, min(power, largest) + 1):
            n = 10**exponent
            command = [sys.executable, __file__, "--case", name, str(n)]
            out = subprocess.run(command, env=environment, check=True, capture_output=True, text=True).stdout
            found = json.loads(out)
            slope = "" if before is None else f"{np.log10(found['seconds'] / before):.2f}"
            goal = f"<= {GOALS[name]} s, 1 GB" if exponent == 6 and name in GOALS else ""
            print(
                f"{name:26s} {n:8d} {found['seconds']:9.4f} {found['gigabytes']:8.3f} {slope:>6s}  {goal}", flush=True
            )
            before = found["seconds"]


def dense_ratio(n: int = 500) -> None:
    """Compare the batch with plain dense numpy, which inverts the (np, np) noise."""
    case = problem(n, "markov")
    batch.solve(case)  # compiled kernels are loaded before the clock starts
    begin = time.process_time()
    for _ in range(5):
        batch.solve(case)
    ours = (time.process_time() - begin) / 5
    rng = np.random.default_rng(0)
    A, H = rng.normal(size=(2 * n, 2 * n)), rng.normal(size=(2 * n, 13))
    noise = A @ A.T + np.eye(2 * n)
    begin = time.process_time()
    W = np.linalg.solve(noise, H)
    gain = np.linalg.solve(H.T @ W, W.T)
    _ = gain @ noise @ gain.T
    dense = time.process_time() - begin
    figures = f"batch qr {ours * 1e3:.1f} ms, dense numpy {dense * 1e3:.1f} ms, ratio {dense / ours:.1f}"
    print(f"n = {n}, correlated noise: {figures}")


def update_time(size: int = 10, count: int = 2000) -> None:
    """Time one update with two measured numbers: ours, and of other libraries where they are installed."""
    rng = np.random.default_rng(0)
    belief, H, R = kalman.Belief.of(np.zeros(size), np.eye(size)), rng.normal(size=(2, size)), np.eye(2)
    updates: dict[str, Callable[[], object]] = {
        "square root": lambda: kalman.update(belief, np.zeros(2), H, R),
        "Joseph": lambda: kalman.joseph(belief.covariance, H, R),
    }
    updates |= _filterpy(H, R) | _stonesoup(H, R)
    for name, update in updates.items():
        update()
        begin = time.process_time()
        for _ in range(count):
            update()
        print(f"one update, {size} states: {name:24s} {(time.process_time() - begin) / count * 1e6:6.0f} us")
    case = problem(10000, "white")
    sequential.solve(problem(100, "white"))
    begin = time.process_time()
    sequential.solve(case)
    each = (time.process_time() - begin) / case.n
    print(f"one update, 13 states: compiled Joseph, its budget of ten sources included {each * 1e6:.1f} us")


def _filterpy(H: np.ndarray, R: np.ndarray) -> dict[str, Callable[[], object]]:
    """Joseph update of filterpy, or nothing where it is not installed."""
    try:
        from filterpy.kalman import update
    except ImportError:
        return {}
    size = H.shape[1]
    return {"filterpy": lambda: update(np.zeros(size), np.eye(size), np.zeros(2), R, H)}


def _stonesoup(H: np.ndarray, R: np.ndarray) -> dict[str, Callable[[], object]]:
    """Update of Stone Soup, or nothing where it is not installed."""
    try:
        from stonesoup.models.measurement.linear import LinearGaussian
        from stonesoup.types.detection import Detection
        from stonesoup.types.hypothesis import SingleHypothesis
        from stonesoup.types.prediction import GaussianStatePrediction
        from stonesoup.updater.kalman import KalmanUpdater
    except ImportError:
        return {}
    size = H.shape[1]
    model = LinearGaussian(ndim_state=size, mapping=(0, 1), noise_covar=R)
    updater, seen = KalmanUpdater(measurement_model=model), Detection(np.zeros((2, 1)), measurement_model=model)

    def update() -> object:
        return updater.update(SingleHypothesis(GaussianStatePrediction(np.zeros((size, 1)), np.eye(size)), seen))

    return {"Stone Soup": update}


if __name__ == "__main__":
    if len(sys.argv) == 4 and sys.argv[1] == "--case":
        print(json.dumps(measure(sys.argv[2], int(sys.argv[3]))))
    elif os.environ.get("OMP_NUM_THREADS") != "1":  # the libraries read it when they load
        raise SystemExit(subprocess.run([sys.executable, *sys.argv], env=os.environ | BLAS).returncode)
    else:
        table(int(sys.argv[1]) if len(sys.argv) > 1 else 6)
        dense_ratio()
        update_time()
