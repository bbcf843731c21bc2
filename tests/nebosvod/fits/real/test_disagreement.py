"""The example of docs/fit.md: the occultations of (3200) Phaethon among the records of two space telescopes."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from nebosvod.fits.engine import OrbitFit
from nebosvod.observation.formats.reading import read_astrometry

A2_ESTIMATED = {"nongrav": {"A2": {"value": "0 au/d^2", "sigma": "1e-12 au/d^2", "treatment": "estimated"}}}


def test_eleven_occultations_lead_four_hundred_records_of_space_telescopes(
    data: Path, fitted: Callable[..., OrbitFit], state_at: Any, phaethon_of_jpl: Any
) -> None:
    path = data / "observations" / "phaethon_mpc_full.obs80.gz"
    records = read_astrometry(path)
    alone = fitted(path, records.select(records.station == "275"), object=A2_ESTIMATED)
    mixed = fitted(path, records.select(np.isin(records.station, ["275", "C51", "C57"])), object=A2_ESTIMATED)
    sigma = []
    for found in (alone, mixed):
        assert not found.verdict.failed
        orbit = state_at(found, phaethon_of_jpl.epoch)
        difference = orbit.state - phaethon_of_jpl.state
        both = orbit.S @ orbit.S.T + phaethon_of_jpl.covariance[:6, :6]  # JPL's orbit of 2018 is to 15 km
        assert float(difference @ np.linalg.solve(both, difference)) < 22.5
        sigma.append(float(np.linalg.norm(orbit.S[:3])))
    assert len(mixed.material) == 412
    assert sigma[1] < sigma[0]
    sharp = mixed.material.astrometry.station == "275"
    assert sharp.sum() == 11
    assert mixed.general.selected[sharp].all()
    (one,) = mixed.errors
    assert (one.station, one.kind, len(one.rows)) == ("C57", "bias", 346)
    assert one.sure == pytest.approx(5.5, abs=0.2)
    assert one.estimate == pytest.approx((-0.14, 0.41), abs=0.02)
