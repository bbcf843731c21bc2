"""`noise_scale: by_station`: the noise of each station as its residuals have it."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from nebosvod.mission import FitMission

SPEC = importlib.util.spec_from_file_location("disagreement", Path(__file__).with_name("test_disagreement.py"))
assert SPEC is not None
assert SPEC.loader is not None
disagreement = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(disagreement)
world = disagreement.world  # the fixture that makes records and fits them
ARCSEC = np.pi / 648000.0
PLAIN = {"rejection": {"enabled": False}, "shared_errors": {"treatment": "off"}, "night_limit": "off"}


def groups(rng):
    """Two stations, one four times worse and one twice better than its weights, and three records of a third."""
    far = {"radius_km": 2.5e5}
    return (
        disagreement.group("C57", disagreement.whole_year(rng, 60), 2.0, stated=0.5, **far),
        disagreement.group("C51", disagreement.whole_year(rng, 60), 0.25, stated=0.5, **far),
        disagreement.group("C53", disagreement.whole_year(rng, 3), 0.5, stated=0.5, **far),
    )


def test_each_station_gets_the_noise_that_its_records_were_made_with(world):
    rng = np.random.default_rng(4)
    rows = world.records(11, disagreement.BELT, *groups(rng))
    plain = world.fit(rows, disagreement.BELT, fit=PLAIN)
    scaled = world.fit(rows, disagreement.BELT, fit=PLAIN | {"noise_scale": "by_station"})
    station = scaled.found.material.astrometry.station
    sigma = np.sqrt(np.mean(scaled.found.material.sigma_rad**2, axis=1)) / ARCSEC
    for code, true in (("C57", 2.0), ("C51", 0.25)):
        assert sigma[station == code].mean() == pytest.approx(true, rel=0.26)  # 4 sigma of 120 numbers
    # the restricted likelihood of independent noise: chi2 is what is expected
    estimate = scaled.found.general.fit.estimate
    assert estimate.chi2 == pytest.approx(2 * len(station) - 6, rel=0.02)
    assert scaled.chi2 < disagreement.HELD
    assert scaled.sigma_km < 0.8 * plain.sigma_km
    told = [text for text in scaled.found.material.notices if "as the residuals of" in text]
    assert [text.split(":")[0] for text in told] == ["C51", "C57", "other stations"]
    assert any("sigma x" in rule for rule in scaled.found.material.rule)


def test_another_word_is_refused():
    with pytest.raises(ValidationError, match="by_station"):
        FitMission.model_validate(
            {"schema_version": 1, "name": "a", "fit": {"observations": ["a"], "noise_scale": "by_night"}}
        )
