"""What the residuals say, as blocks of summary.json: tests of biases, tests of patterns, sentences."""

from typing import Any

import numpy as np
import numpy.typing as npt

from nebosvod.findings.bias_tests import FOUND, BiasTest, Hypothesis, Power
from nebosvod.findings.doctor import Diagnosis, rhythm_words
from nebosvod.findings.residual_tests import SeriesTest, TelescopeTest
from nebosvod.results.rows import Row
from nebosvod.timescale import Epoch
from nebosvod.units import ARCSEC

Array = npt.NDArray[np.float64]


def diagnosis_block(found: Diagnosis | None, epoch: Epoch) -> dict[str, Any]:
    """The key `diagnosis`; empty where no tests were made."""
    if found is None:
        return {}
    worst = found.residuals.worst
    return {
        "diagnosis": {
            "level": found.biases.level,
            "findings": list(found.findings),
            "bias_tests": [bias_test(one, epoch) for one in found.biases.tests],
            "residual_tests": [residual_test(one) for one in found.residuals.telescopes],
            "level_alone": found.residuals.alone,
            "worst_rhythm": None
            if worst is None
            else {
                "what": worst.what,
                "period_s": worst.period_s,
                "name": worst.name or None,
                "times_worse": worst.times_worse,
                "told": rhythm_words(found.residuals),
            },
        }
    }


def bias_test(one: BiasTest, epoch: Epoch) -> Row:
    """One entry of `bias_tests`."""
    return {
        "telescope": one.telescope,
        "n": one.n,
        "verdict": one.verdict,
        "modelled": one.modelled,
        "reason": one.reason or None,
        "constant": hypothesis(one.constant, epoch),
        "appearing": hypothesis(one.appearing, epoch),
        "found_constant_arcsec": sizes(one.power_constant),
        "found_appearing_arcsec": sizes(one.power_appearing),
    }


def hypothesis(one: Hypothesis | None, epoch: Epoch) -> Row | None:
    """A bias as the measurements say if it is there."""
    if one is None:
        return None
    return {
        "since_tdb": None if one.since_s is None else (epoch + one.since_s).iso(),
        "statistic": one.statistic,
        "chance": one.chance,
        "bias_arcsec": (one.bias_rad / ARCSEC).tolist(),
        "sigma_arcsec": (one.sigma_rad / ARCSEC).tolist(),
        "shift_km": one.shift_km,
        "shift_sigmas": one.shift_sigmas,
    }


def sizes(curve: Power | None) -> dict[str, float | None] | None:
    """Sizes of a bias that are found with chances of a half and nine tenths."""
    if curve is None:
        return None
    found = {f"{chance:g}": curve.size_found(chance) for chance in FOUND}
    return {key: None if size is None else size / ARCSEC for key, size in found.items()}


def residual_test(one: TelescopeTest) -> Row:
    """One entry of `residual_tests`."""
    return {
        "telescope": one.telescope,
        "n": one.n,
        "scatter": one.scatter,
        "series": [series(each) for each in one.series],
    }


def series(one: SeriesTest) -> Row:
    """The tests of one component."""
    return {
        "axis": one.axis,
        "runs": one.runs,
        "runs_expected": one.runs_expected,
        "runs_chance": one.runs_chance,
        "lag": one.lag,
        "correlation": one.correlation,
        "correlation_chance": one.correlation_chance,
        "period_s": one.period_s,
        "shortest_period_s": one.shortest_s,
        "amplitude_sigmas": one.amplitude_sigmas,
        "rhythm_chance": one.rhythm_chance,
        "at_worst_chance": one.at_worst_chance,
    }
