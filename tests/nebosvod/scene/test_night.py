"""Telescopes on the ground see at night, and not what is low: checked against astropy's horizon frame."""

import json
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from nebosvod.cli import main

# Pan-STARRS 1 (F51): the MPC's parallax constants
LONGITUDE_DEG, COS, SIN = 203.74409, 0.936239, 0.351538
MISSION = """schema_version: 1
name: night
reference_epoch: 2026-06-01T00:00:00 TDB
object:
  name: MB
  orbit: {kind: keplerian, frame: ecliptic_j2000, epoch: 2026-06-01 TDB, a: 2.6 au, e: 0.12, i: 8 deg, node: 80 deg,
          peri: 120 deg, M: 200 deg}
telescopes:
  - name: PS
    orbit: {kind: ground, code: F51}
    noise: {sigma: 0.1 arcsec}
schedule: [{start: 2026-08-15 TDB, end: 2026-09-01 TDB, cadence: 1 h}]
predictions: [{name: p, plane: rtn, at: 2026-10-01 TDB}]
"""


def run(folder: Path, text: str) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Summary and table of visibility."""
    from astropy.table import Table

    (folder / "night.yaml").write_text(text, "utf-8")
    assert main(["run", str(folder / "night.yaml"), "-o", str(folder / "run"), "--overwrite"]) == 0
    table = Table.read(folder / "run" / "tables" / "visibility.ecsv")
    return json.loads((folder / "run" / "summary.json").read_text("utf-8")), {
        n: np.array(table[n]) for n in table.colnames
    }


@pytest.fixture(scope="module")
def night(tmp_path_factory):
    folder = tmp_path_factory.mktemp("night")
    return (*run(folder, MISSION), folder)


@pytest.fixture(scope="module")
def horizon(night):
    """Altitudes of the Sun and of the object by astropy, deg; the object's direction is that of each seen exposure."""
    import astropy_iers_data
    from astropy import units as u
    from astropy.coordinates import AltAz, EarthLocation, SkyCoord, get_sun
    from astropy.time import Time
    from astropy.utils import iers
    from astropy.utils.exceptions import AstropyWarning

    _, table, folder = night
    radius = 6378137.0
    turn = np.radians(LONGITUDE_DEG)
    place = EarthLocation.from_geocentric(
        radius * COS * np.cos(turn), radius * COS * np.sin(turn), radius * SIN, unit=u.m
    )
    arrays = np.load(folder / "run" / "arrays.npz")
    # the installed table with its predictions (older astropy takes the one without by itself, and then TDB for UT1);
    # one that ends before these nights gives the mean of 50 years for polar motion, good to an arcsecond
    installed = iers.IERS_A.open(astropy_iers_data.IERS_A_FILE)
    with iers.earth_orientation_table.set(installed), warnings.catch_warnings():
        warnings.simplefilter("ignore", AstropyWarning)
        frame = AltAz(obstime=Time([t.removesuffix(" TDB") for t in table["epoch_tdb"]], scale="tdb"), location=place)
        sun = get_sun(frame.obstime).transform_to(frame).alt.deg
        seen = AltAz(obstime=frame.obstime[table["visible"]], location=place)
        # far away, so that astropy sees no parallax in an astrometric direction
        target = SkyCoord(*np.degrees(arrays["psi"].T), unit="deg").transform_to(seen).alt.deg
    return sun, target


def test_every_exposure_is_in_the_dark_and_high_enough_by_astropy(night, horizon):
    _, table, _ = night
    sun, target = horizon
    assert 40 < np.count_nonzero(table["visible"]) < 80
    assert sun[table["visible"]].max() < -12.0
    assert target.min() > 20.0


def test_altitudes_are_those_of_astropy(night, horizon):
    """To the aberration (0.006 deg) and the light time of the Sun."""
    _, table, _ = night
    sun, target = horizon
    np.testing.assert_allclose(table["sun_altitude"], sun, rtol=0.0, atol=0.01)
    np.testing.assert_allclose(table["altitude"][table["visible"]], target, rtol=0.0, atol=0.01)


def test_every_exposure_by_day_is_lost_with_its_reason(night, horizon, tmp_path):
    summary, table, _ = night
    sun, _ = horizon
    by_day = sun > -12.0
    np.testing.assert_array_equal(table["reason"] == "twilight", by_day)
    (block,) = summary["visibility"]
    assert block["removed"]["twilight"] == np.count_nonzero(by_day)
    assert set(table["reason"].tolist()) == {"-", "twilight", "altitude"}


def test_the_limits_are_keys_and_check_says_them(tmp_path, capsys):
    text = MISSION.replace("{sigma: 0.1 arcsec}", "{sigma: 0.1 arcsec}\n    exclusion: {}")
    off = text.replace("exclusion: {}", "exclusion: {sun_altitude: 90 deg, altitude: -90 deg}")
    _, table = run(tmp_path, off)
    # as it was before there were limits: everything above the horizon, by day too
    assert set(table["reason"].tolist()) == {"-", "earth"}
    assert np.any(table["sun_altitude"][table["visible"]] > 0.0)
    (tmp_path / "n.yaml").write_text(text.replace("exclusion: {}", "exclusion: {sun_altitude: -18 deg}"), "utf-8")
    assert main(["check", str(tmp_path / "n.yaml")]) == 0
    assert "PS: ground (Sun below -18 deg, object above 20 deg)" in capsys.readouterr().out


def test_a_telescope_in_space_has_no_horizon(tmp_path, capsys):
    text = MISSION.replace("{kind: ground, code: F51}", "{kind: geostationary, longitude: 0 deg}")
    text = text.replace("{sigma: 0.1 arcsec}", "{sigma: 0.1 arcsec}\n    exclusion: {altitude: 20 deg}")
    (tmp_path / "n.yaml").write_text(text, "utf-8")
    assert main(["check", str(tmp_path / "n.yaml")]) == 2
    said = capsys.readouterr().err
    assert "n.yaml:12:" in said
    assert "telescopes[0].exclusion.altitude: belongs to a telescope of kind ground (this one is geostationary)" in said


def test_the_centre_of_the_earth_has_no_night(tmp_path):
    _, table = run(tmp_path, MISSION.replace("code: F51", "code: '500'"))
    assert table["visible"].all()
