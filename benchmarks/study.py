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

from nebosvod.studies.point import evaluate
from nebosvod.studies.question import Study, load_study_text
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


def wall(study: Study, workers: Workers) -> float:
    """Wall seconds of a whole study, workers started and folder written."""
    with tempfile.TemporaryDirectory() as folder:
        started = time.perf_counter()
        run_study(study, Path(folder) / "s", workers=workers)
        return time.perf_counter() - started


def main() -> None:
    """Print one line for each figure."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--points", type=int, default=200)
    parser.add_argument("--wall", type=int, default=0, help="points of the studies timed by the clock; 0 for none")
    parser.add_argument("--flat", type=int, default=0, help="points after which the memory is looked at again")
    options = parser.parse_args()
    for (mission, what, goal), varied in VARIED.items():
        study = study_of(mission, varied, options.points + 1)
        found = rate(study, options.points)
        bare = alone(study, max(options.points // 5, 10))
        print(f"{mission}, {what}: {found:.0f} points/s and core (goal {goal}); {bare:.0f} with nothing shared")
        print(f"  a million points: {1e6 / found / 3600:.1f} h on one core, {1e6 / found / 3600 / 64:.2f} h on 64")
    if options.wall:
        efficiency(options.wall)
    if options.flat:
        memory(options.flat)


def efficiency(points: int) -> None:
    """What two workers and dask make of one study."""
    study = study_of("minimal", VARIED["minimal", "sigmas", 100], points)
    one, two = wall(study, Workers(count=1)), wall(study, Workers(count=2))
    print(f"two workers: {one / two / 2:.2f} of twice as fast ({points} points, start included)")
    from distributed import LocalCluster

    with LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None) as cluster:
        address = cluster.scheduler_address
        wall(study, Workers(scheduler=address))
        print(f"dask: {wall(study, Workers(scheduler=address)) / two - 1.0:+.2f} against two processes")


def memory(points: int) -> None:
    """Peak memory of this process after a tenth of some points and after all."""
    study = study_of("minimal", VARIED["minimal", "sigmas", 100], points)
    peaks = []
    for number in range(points):
        evaluate_row(study, number)
        if number + 1 in (points // 10, points):
            peaks.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0)
    print(f"memory: {peaks[0]:.0f} MB after {points // 10} points, {peaks[1]:.0f} MB after {points}")


if __name__ == "__main__":
    main()
