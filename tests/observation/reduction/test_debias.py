"""Star-catalogue biases, on a table of 48 pixels made here in the published form."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from nebosvod.errors import DataError, InputError
from nebosvod.observation.formats.mpc80 import parse
from nebosvod.observation.formats.source_file import SourceFile
from nebosvod.observation.reduction.debias import COLUMNS, debias, ring_pixel

ARCSEC = np.pi / 648000.0
NSIDE = 2
LINE = "     K05TH3M  C{} {}         19.2 V{}p0839703"


def table(path: Path, rows: np.ndarray) -> Path:
    """The published form: 23 lines of comment, then a row a pixel."""
    text = "".join(f"! line {i} of the head\n" for i in range(23))
    text += "".join(" ".join(f"{value:8.3f}" for value in row) + "\n" for row in rows)
    path.write_text(text, encoding="ascii")
    return path


@pytest.fixture
def rows() -> np.ndarray:
    """Numbers that tell pixel, catalogue and kind: three decimals, within the limits."""
    return np.round(np.random.default_rng(1).normal(0.0, 0.3, (12 * NSIDE**2, COLUMNS)), 3)


def read(*lines: str):
    return parse(SourceFile("f.obs", "\n".join(lines).encode()))


PLACES = ("21 31 27.040-00 10 33.90", "05 31 27.040+80 10 33.90", "11 00 00.000-75 00 00.00")


@pytest.mark.parametrize(("letter", "column"), [("a", 0), ("c", 2), ("r", 14), ("U", 24), ("Y", 25)])
@pytest.mark.parametrize("place", PLACES)
def test_the_bias_is_the_offset_at_j2000_plus_proper_motion(tmp_path, rows, letter, column, place) -> None:
    records = read(LINE.format("2005 10 09.20072", place, letter))
    correction, notices = debias(records, table(tmp_path / "bias.dat", rows))
    pixel = int(ring_pixel(NSIDE, records.psi)[0])
    four = rows[pixel, 4 * column : 4 * column + 4]
    years = (2453652.70072 - 2451545.0) / 365.25  # to 3e-6
    expected = four[:2] + years * four[2:] / 1e3
    np.testing.assert_allclose(correction[0] / ARCSEC, expected, rtol=0.0, atol=1e-7)
    assert notices == ("catalogue biases (Eggl et al. 2020, 2 pixels a side) taken off 1 observation",)


def test_many_observations_in_any_order_get_their_own_pixels(tmp_path, rows) -> None:
    letters = "".join(np.random.default_rng(2).choice(list("acrU"), 200))
    rng = np.random.default_rng(3)
    places = [
        f"{rng.integers(24):02d} 31 27.040{'+-'[rng.integers(2)]}{rng.integers(89):02d} 10 33.90" for _ in letters
    ]
    records = read(*(LINE.format("2005 10 09.20072", p, c) for p, c in zip(places, letters)))
    path = table(tmp_path / "bias.dat", rows)
    together, _ = debias(records, path)
    for i in (0, 17, len(records) - 1):
        np.testing.assert_array_equal(debias(records.select(np.array([i])), path)[0][0], together[i])


def test_gaia_and_unknown_catalogues_are_left_alone(tmp_path, rows) -> None:
    records = read(*(LINE.format("2005 10 09.20072", PLACES[i], letter) for i, letter in enumerate("V E")))
    correction, notices = debias(records, table(tmp_path / "bias.dat", rows))
    np.testing.assert_array_equal(correction, 0.0)
    assert notices[1].startswith("1 observation names no star catalogue")


def test_without_a_table_nothing_is_taken_off_and_it_is_said() -> None:
    records = read(LINE.format("2005 10 09.20072", PLACES[0], "c"))
    correction, notices = debias(records)
    np.testing.assert_array_equal(correction, 0.0)
    assert "1 observation was measured against star catalogues with known biases" in notices[0]
    assert debias(replace(records, catalogue=np.array(["Gaia2"])))[1] == ()


@pytest.mark.parametrize(
    ("nside", "pixels"),
    [
        (64, (14685, 27403, 16805, 41429, 40978, 2865, 35408, 9671)),
        (256, (236916, 439339, 266902, 661293, 653385, 45512, 565569, 154398)),
    ],
)
def test_pixels_are_those_of_a_kept_library(nside: int, pixels: tuple[int, ...]) -> None:
    """astropy-healpix 2.0.1, ring order. It agreed on 200,000 random directions for 1, 2, 64, 100, 256 as well."""
    psi = np.array(
        [
            (5.422446, 0.409577), (3.408329, -0.117538), (0.92312, 0.326085), (2.272021, -0.749097),
            (3.59366, -0.720745), (2.211392, 1.083933), (5.113522, -0.451208), (1.756687, 0.652681),
        ]
    )  # fmt: skip
    np.testing.assert_array_equal(ring_pixel(nside, psi), pixels)


@pytest.mark.parametrize("nside", [1, 3, 64])
def test_pixels_have_equal_areas_and_every_one_is_met(nside: int) -> None:
    rng = np.random.default_rng(9)
    psi = np.stack([rng.uniform(0.0, 2.0 * np.pi, 400000), np.arcsin(rng.uniform(-1.0, 1.0, 400000))], axis=1)
    count = np.bincount(ring_pixel(nside, psi), minlength=12 * nside**2)
    assert count.size == 12 * nside**2
    mean = 400000 / count.size
    # chi-square per degree of freedom of a Poisson count
    assert np.sum((count - mean) ** 2) / mean / (count.size - 1) == pytest.approx(1.0, abs=6.0 / np.sqrt(count.size))


def test_poles_have_pixels() -> None:
    psi = np.array([[0.0, np.pi / 2], [6.28, np.pi / 2], [0.0, -np.pi / 2], [6.283185307179586, 0.3]])
    pixel = ring_pixel(64, psi)
    assert list(pixel[:3]) == [0, 3, 12 * 64**2 - 4]
    assert 0 <= pixel[3] < 12 * 64**2


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda lines: lines[:-1], r"bias\.dat: 47 rows of data, which is no number of HEALPix pixels"),
        (lambda lines: [], r"bias\.dat: 0 rows"),
        (lambda lines: [line.replace(" ", " 9 ", 1) for line in lines], r"bias\.dat:\d+: 105 columns instead of 104"),
        (lambda lines: [f"{line[:-6]}xx\n" if line[0] != "!" else line for line in lines], "a column is not a number"),
        (
            lambda lines: [f"{line[:-8]} 1e9\n" if line[0] != "!" else line for line in lines],
            "column 104 is 1000000000",
        ),
        (lambda lines: [f"{line[:-8]} nan\n" if line[0] != "!" else line for line in lines], "column 104 is nan"),
    ],
)
def test_a_damaged_table_is_refused_with_its_line(tmp_path, rows, change, message) -> None:
    path = table(tmp_path / "bias.dat", rows)
    path.write_text("".join(change(path.read_text().splitlines(keepends=True))))
    with pytest.raises(InputError, match=message):
        debias(read(LINE.format("2005 10 09.20072", PLACES[0], "c")), path)


def test_a_missing_table_is_a_fault_of_the_machine(tmp_path) -> None:
    with pytest.raises(DataError, match="the table of catalogue biases cannot be read"):
        debias(read(LINE.format("2005 10 09.20072", PLACES[0], "c")), tmp_path / "none.dat")
