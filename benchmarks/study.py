"""Points a second and core of `nebosvod study`, what sharing brings, how well two workers share, what dask costs.

CPU time is measured, so that other work on the machine changes little; efficiency and overhead are ratios of wall times
of one run. Goals: minimal 100 points a second; apophis-2029 60 where only sigmas vary, 30 where the schedule does, 25
where the orbit does; efficiency of two workers 0.9; overhead of dask below 0.1; memory flat.
"""

import argparse
import resource
import tempfile
import time
from pathlib import Path

from nebosvod.studies.builtin import builtin_studies
from nebosvod.studies.point import evaluate
from nebosvod.studies.question import Study
from nebosvod.studies.reading import load_study, load_study_text
from nebosvod.studies.study import evaluate_row, run_study
from nebosvod.tasks.engine import Workers

VARIED = {
    ("minimal", "sigmas", 100): "telescopes.*.noise.sigma, values: 0.02 arcsec .. 1 arcsec, log: true",
    ("apophis-2029", "sigmas", 60): "telescopes.*.noise.sigma, values: 0.02 arcsec .. 1 arcsec, log: true",
    ("apophis-2029", "schedule", 30): "schedule.*.cadence, values: 11 h .. 13 h, linear: true",
    ("apophis-2029", "orbit", 25): "object.orbit.i, values: 3.3367 deg .. 3.3368 deg, linear: true",
}
PREDICTION = {"minimal": "ten days later", "apophis-2029": "encounter"}


def study_of(mission: str, varied: str, points: int) -> Study:
    """A study of so many different points."""
    answer = f"predictions.{PREDICTION[mission]}"
    return load_study_text(
        f"schema_version: 1\nstudy: speed\nmission: {mission}\nvary: {{x: {{set: {varied}}}}}\n"
        f"sample: {{latin: {{n: {points}}}}}\n"
        f"answer: [{{name: size, of: {answer}.semi_axes_km.0}}, {{name: blame, of: {answer}.budget}}]\n"
    )


def rate(study: Study, points: int) -> float:
    """Points a CPU second of this process."""
    evaluate_row(study, 0)
    started = time.process_time()
    for number in range(1, points + 1):
        evaluate_row(study, number)
    return points / (time.process_time() - started)


def alone(study: Study, points: int) -> float:
    """The same with nothing shared."""
    axis = study.axes[0]
    started = time.process_time()
    for number in range(1, points + 1):
        ((value, _),) = study.points[number]
        evaluate(study.editable.edited({axis.paths[0]: value}), study.wanted)
    return points / (time.process_time() - started)


def wall(study: Study, workers: Workers) -> tuple[float, float]:
    """Wall seconds of a whole study with all that starts and is written, and points a second once it is under way."""
    times: list[tuple[float, int]] = []
    with tempfile.TemporaryDirectory() as folder:
        started = time.perf_counter()
        run_study(
            study,
            Path(folder) / "s",
            workers=workers,
            progress=lambda done, rows: times.append((time.perf_counter(), done)),
        )
        whole = time.perf_counter() - started
    begun = next(k for k, (_, done) in enumerate(times) if done >= 0.1 * study.rows)
    (t0, n0), (t1, n1) = times[begun], times[-1]
    return whole, (n1 - n0) / (t1 - t0)


def main() -> None:
    """Print one line for each figure; with what is asked for by default, two minutes on a quiet machine."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--points", type=int, default=100, help="points of each rate")
    parser.add_argument("--wall", type=int, default=1500, help="points of the studies timed by the clock; 0 for none")
    parser.add_argument("--flat", type=int, default=5000, help="points over which memory is looked at; 0 for none")
    options = parser.parse_args()
    for (mission, what, goal), varied in VARIED.items():
        study = study_of(mission, varied, options.points + 1)
        found = rate(study, options.points)
        bare = alone(study, max(options.points // 5, 10))
        print(f"{mission}, {what}: {found:.0f} points/s and core (goal {goal}); {bare:.0f} with nothing shared")
        print(f"  a million points: {1e6 / found / 3600:.1f} h on one core, {1e6 / found / 3600 / 64:.2f} h on 64")
    impactors()
    if options.wall:
        efficiency(options.wall)
    if options.flat:
        memory(options.flat)


def impactors(rows: int = 40) -> None:
    """What an object of each built-in study costs, and so 100,000 of them."""
    for name in builtin_studies():
        study = load_study(name)
        evaluate_row(study, 0)
        started = time.process_time()
        for number in range(1, rows + 1):
            evaluate_row(study, number)
        each, objects = (time.process_time() - started) / rows, study.axes[0].count
        whole = each * study.rows
        print(
            f"{name}: {1e3 * each:.0f} ms a row; {objects} objects, {study.rows} rows: {whole / 60:.0f} min on one core"
        )
        much = 1e5 * whole / objects / 3600
        print(f"  100,000 objects: {much:.0f} h on one core, {much / 64:.1f} h on 64")


def efficiency(points: int) -> None:
    """What two workers and dask make of one study."""
    study = study_of("minimal", VARIED["minimal", "sigmas", 100], points)
    (one_s, one), (two_s, two) = wall(study, Workers(count=1)), wall(study, Workers(count=2))
    begun = f"{one_s / two_s / 2:.2f} with all that starts ({points} points)"
    print(f"two workers: {two / one / 2:.2f} of twice as fast once under way; {begun}")
    from distributed import LocalCluster

    with LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None) as cluster:
        address = cluster.scheduler_address
        wall(study, Workers(scheduler=address))
        _, dask = wall(study, Workers(scheduler=address))
        print(f"dask: {two / dask - 1.0:+.2f} against two processes")


def memory(points: int) -> None:
    """Memory of this process after a tenth of some points and after all."""
    study = study_of("minimal", VARIED["minimal", "sigmas", 100], points)
    held = []
    for number in range(points):
        evaluate_row(study, number)
        if number + 1 in (points // 10, points):
            pages = int(Path("/proc/self/statm").read_text("ascii").split()[1])
            held.append(pages * resource.getpagesize() / 2**20)
    print(f"memory: {held[0]:.0f} MB after {points // 10} points, {held[1]:.0f} MB after {points}")


if __name__ == "__main__":
    main()
