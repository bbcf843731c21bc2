"""Written ADES: the official schema accepts it, and it reads back as what it was."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from nebosvod.errors import InputError
from nebosvod.observation.formats import ades, mpc80
from nebosvod.observation.formats.ades_write import Residuals
from nebosvod.observation.formats.reading import parse_astrometry, read_astrometry
from nebosvod.observation.formats.records import Astrometry
from nebosvod.observation.formats.source_file import SourceFile

DATA = Path(__file__).resolve().parents[4] / "shared" / "data" / "observations"
needs_data = pytest.mark.skipif(not DATA.is_dir(), reason="reference observations are not here")
ARCSEC = np.pi / 648000.0
COLUMNS = """
    permID provID trkSub mode stn sys ctr pos1 pos2 pos3 posCov11 posCov22 posCov33 posCov13 obsTime rmsTime ra dec
    rmsRA rmsDec rmsCorr astCat mag band disc
"""
SEVERAL = "\n".join((
    "# version=2022",
    "|".join(COLUMNS.split()),
    "3666|1979 HP||CCD|G96||||||||||2010-01-07T20:21:48.586Z||0|-0.36842|0.1|0.2|-0.3|Gaia2|18.5|V|*",
    "3666|||UNK|G96||||||||||2016-12-31T23:59:60.5Z|0.00001|359.9999999999|90|0.00001|12.5||UNK|||",
    "|2010 FM61||CCD|C51|ICRF_KM|399|6685.9939|-1699.4357|381.8355|1.5|2.5|1e-4|-1e-3|"
    "2010-01-08T01:07:40Z|0.5|19.0|-90|100.125|0.2|||9|G|",
    "|C/2019 Y4||CCD|C54|ICRF_AU|399|-40.5|12.25|-3.5|||||2019-01-08T01:07:40.1234567Z||19.0|5.0|||||||",
    "||P10abcd|CMO|247|WGS84|399|237.76096|38.11385|12|||||2023-08-26T04:36:22.7Z||33.5|0.000000001||||Gaia3|||",
))  # fmt: skip


def table(text: str) -> Astrometry:
    return parse_astrometry(SourceFile("f", text.encode()))


def made(count: int) -> Residuals:
    """Residuals of all sizes."""
    size = np.geomspace(1e-4, 1e5, count)
    return Residuals(
        orbit="JPL 1",
        residual_rad=np.stack([size, -size], axis=1) * ARCSEC,
        sigma_rad=np.full((count, 2), 0.3 * ARCSEC),
        correlation=np.linspace(-0.9, 0.9, count),
        accepted=size < 3.0,
    )


def require_valid(xml: bytes) -> None:
    """Judge XML by the schema that the IAU's own tools use (package iau-ades)."""
    etree = pytest.importorskip("lxml.etree", reason="iau-ades is not installed")
    package = pytest.importorskip("ades", reason="iau-ades is not installed")
    schema = etree.XMLSchema(etree.parse(Path(package.__file__).parent / "data" / "xsd" / "general.xsd"))
    schema.assertValid(etree.fromstring(xml))


def require_same(one: Astrometry, other: Astrometry) -> None:
    """Everything that ADES can hold is equal to the digits that are written."""
    for name in ("designation", "station", "mode", "catalogue", "centre", "roving", "discovery"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)
    np.testing.assert_allclose(one.psi, other.psi, rtol=0, atol=np.radians(0.51e-9))  # nine decimals of a degree
    np.testing.assert_allclose(one.t_s + (one.epoch - other.epoch), other.t_s, rtol=0, atol=1e-6)  # cut at microseconds
    np.testing.assert_allclose(one.position_km, other.position_km, rtol=1e-9, atol=2e-5)
    np.testing.assert_allclose(one.position_covariance_km2, other.position_covariance_km2, rtol=1e-9)
    np.testing.assert_allclose(one.sigma_rad, other.sigma_rad, rtol=0, atol=0.6e-5 * ARCSEC)
    np.testing.assert_allclose(one.correlation, other.correlation, atol=1e-6)
    np.testing.assert_allclose(one.timing_sigma_s, other.timing_sigma_s, atol=1e-6)
    np.testing.assert_allclose(one.magnitude, other.magnitude, atol=0.006)


@pytest.mark.parametrize("with_residuals", [False, True])
def test_the_official_schema_accepts_what_is_written_and_it_reads_back(with_residuals: bool) -> None:
    one = table(SEVERAL)
    residuals = made(len(one)) if with_residuals else None
    xml, psv = ades.write_xml(one, residuals), ades.write_psv(one, residuals)
    require_valid(xml.encode())
    # 360 deg does not exist: 359.9999999999 is written as 0
    near = np.where(one.psi[:, :1] > np.radians(359.9999999), [[0.0]], one.psi[:, :1])
    expected = replace(one, psi=np.hstack([near, one.psi[:, 1:]]))
    require_same(expected, table(xml))
    require_same(expected, table(psv))
    assert ("<resRA>" in xml) == with_residuals


def test_the_official_converter_reads_the_psv_that_is_written(tmp_path: Path) -> None:
    psvtoxml = pytest.importorskip("ades.psvtoxml", reason="iau-ades is not installed")
    one = table(SEVERAL)
    (tmp_path / "f.psv").write_text(ades.write_psv(one, made(len(one))), "utf-8")
    psvtoxml.psvtoxml(str(tmp_path / "f.psv"), str(tmp_path / "f.xml"))
    xml = (tmp_path / "f.xml").read_bytes()
    require_valid(xml)
    assert parse_astrometry(SourceFile("f", xml)).designation.tolist() == one.designation.tolist()


@needs_data
@pytest.mark.parametrize("name", ["03666_Holman.obs80", "phaethon_mpc_full.obs80.gz", "2024BX1.obs80"])
def test_real_files_in_eighty_columns_become_valid_ades(name: str) -> None:
    one = mpc80.read(DATA / name)
    xml = ades.write_xml(one)
    require_valid(xml.encode())
    require_same(one, table(xml))
    require_same(one, table(ades.write_psv(one)))


@needs_data
def test_comma_separated_records_become_valid_ades() -> None:
    one = read_astrometry(DATA / "holman_data_with_sats_occ.csv")
    require_valid(ades.write_xml(one).encode())


@pytest.mark.parametrize("size_km", [6400.5, 384_400.123456, 1.5e6, 1.234567e8, 2e9, 9e9])
def test_positions_of_every_size_fit_the_schema(size_km: float) -> None:
    one = table(SEVERAL)
    place = np.where(np.isfinite(one.position_km), -size_km * np.array([0.6, 0.0, 0.8]), np.nan)
    near = one.centre == "earth"
    one = replace(one, position_km=place, roving=np.zeros(5, dtype=bool)).select(near)
    require_valid(ades.write_xml(one).encode())
    np.testing.assert_allclose(table(ades.write_psv(one)).position_km, one.position_km, rtol=2e-10, atol=1e-6)


def test_nothing_is_written_of_nothing_nor_with_residuals_of_something_else() -> None:
    one = table(SEVERAL)
    with pytest.raises(InputError, match="no observations to write"):
        ades.write_psv(one.select(np.zeros(len(one), dtype=bool)))
    with pytest.raises(InputError, match="3 residuals for 5 observations"):
        ades.write_psv(one, made(3))
