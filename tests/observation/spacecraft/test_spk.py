"""Spacecraft from SPK files, of every type that is read, against CSPICE."""

import struct
from io import BytesIO

import numpy as np
import pytest
from jplephem.daf import DAF
from jplephem.spk import SPK
from scipy.interpolate import BarycentricInterpolator

from nebosvod.dynamics.kepler import kepler_state
from nebosvod.errors import CoverageError, DataError
from nebosvod.observation import read_spk
from nebosvod.timescale import Epoch

DAY = 86400.0


def kepler(t):
    one = np.ones(t.size)
    return kepler_state(398600.4, 42164.0, 0.1, 0.3, 0.2 * one, 0.7 * one, t * np.sqrt(398600.4 / 42164.0**3))


# NAIF CSPICE through spiceypy, spkgeo(-170, et, "J2000", 10) on the file of the shared data: et, km, km/s
CSPICE_JWST = [
    (
        631109800.0,
        [
            -24663978.838716466,
            134098056.93903147,
            58334008.88508941,
            -30.35378671803126,
            -4.778728455930371,
            -1.998144707233228,
        ],
    ),
    (
        700000000.25,
        [
            -146540100.6549917,
            29505808.368314147,
            12522962.957883319,
            -6.979290747428827,
            -26.884511699948675,
            -11.746241265080648,
        ],
    ),
    (
        721234567.0,
        [
            103763070.4559664,
            99040288.67020023,
            42763518.591133535,
            -22.158413545219535,
            18.845947071583335,
            8.291717149277707,
        ],
    ),
    (
        756987654.322,
        [
            -14365282.33139025,
            135324865.58749887,
            58971552.12146449,
            -30.69525874795308,
            -2.79838381749268,
            -1.2184597021311698,
        ],
    ),
    (
        757296000.0,
        [
            -23794407.7133634,
            134190801.6773687,
            58474477.18261771,
            -30.443573310051487,
            -4.554798643135228,
            -2.003928579167053,
        ],
    ),
]


class TestSpk:
    """JWST (type 13) and Apophis (type 2)."""

    @pytest.fixture
    def jwst(self, data):
        return data / "observers" / "jwst_horizons_20200101_20240101_v01.bsp"

    def test_type_13_agrees_with_cspice_to_a_millimetre(self, jwst, ephemeris):
        """At both ends, at odd times, and at the last point itself."""
        orbit = read_spk(jwst)
        assert orbit.origin == "sun"
        (segment,) = orbit.segments
        assert (segment.method, segment.window) == ("hermite", 6)
        found = segment.evaluate(np.array([et for et, _ in CSPICE_JWST]))
        expected = np.array([state for _, state in CSPICE_JWST])
        # 1.5e8 km carry 3e-8 km; two orders of divided differences
        np.testing.assert_allclose(found[:, :3], expected[:, :3], rtol=0.0, atol=1e-6)
        np.testing.assert_allclose(found[:, 3:], expected[:, 3:], rtol=0.0, atol=1e-11)

    def test_jwst_is_about_L2_and_moves_as_its_velocity_says(self, jwst, ephemeris, support):
        orbit = read_spk(jwst, -170)
        epoch = Epoch.parse("2023-03-01T00:00:00 TDB")
        t_s = np.linspace(0.3, 200.3, 41) * DAY  # away from the points, where one polynomial gives way to the next
        state = orbit.state_km_km_s(ephemeris, epoch, t_s)
        distance = np.linalg.norm(state[:, :3] - ephemeris.position_km("earth", epoch, t_s), axis=1)
        assert 1.1e6 < distance.min() < distance.max() < 1.9e6
        numeric = support.derivative(lambda h: orbit.state_km_km_s(ephemeris, epoch, t_s + h)[:, :3], 300.0)
        np.testing.assert_allclose(state[:, 3:], numeric, rtol=0.0, atol=1e-8)

    def test_a_type_2_file_is_evaluated_by_jplephem_in_the_segment_that_covers_the_date(self, data, ephemeris):
        path = data / "dynamics" / "apophis_jpl220_2021_2050.bsp"
        orbit = read_spk(path)
        epoch = Epoch.parse("2028-12-01T00:00:00 TDB")
        t_s = np.linspace(0.0, 90.0, 19) * DAY
        state = orbit.state_km_km_s(ephemeris, epoch, t_s) - ephemeris.state_km_km_s("sun", epoch, t_s)
        kernel = SPK.open(path)
        for k in (0, 7, 18):
            jd = epoch.day + t_s[k] / DAY
            segment = next(s for s in kernel.segments if s.start_jd <= jd < s.end_jd)
            np.testing.assert_allclose(state[k, :3], segment.compute(jd), rtol=0.0, atol=1e-4)
        kernel.close()
        with pytest.raises(CoverageError, match="no state at 2060"):
            orbit.state_km_km_s(ephemeris, Epoch.parse("2060-01-01T00:00:00 TDB"), np.zeros(1))

    def test_a_wrong_target_and_a_broken_file_are_refused(self, jwst, tmp_path):
        with pytest.raises(DataError, match=r"no target -82 \(there are \[-170\]\)"):
            read_spk(jwst, -82)
        broken = tmp_path / "broken.bsp"
        broken.write_bytes(b"DAF/SPK " + b"\0" * 40)
        with pytest.raises(DataError, match=r"broken.bsp"):
            read_spk(broken)
        with pytest.raises(DataError, match="cannot be read"):
            read_spk(tmp_path / "absent.bsp")

    def retyped(self, jwst, tmp_path, kind):
        """The file of JWST with another type number: types 9 and 13 have one layout."""
        raw = bytearray(jwst.read_bytes())
        place = raw.index(np.array([-170, 10, 1, 13], dtype="<i4").tobytes())
        raw[place + 12 : place + 16] = np.array([kind], dtype="<i4").tobytes()
        other = tmp_path / f"type{kind}.bsp"
        other.write_bytes(raw)
        return other

    def test_type_9_interpolates_positions_and_velocities_each_by_itself(self, jwst, tmp_path):
        (segment,) = read_spk(self.retyped(jwst, tmp_path, 9)).segments
        assert segment.method == "lagrange"
        t_s = segment.t_s[300:304] + 40000.0
        window = slice(298, 304)  # of the first: three points on either side
        expected = BarycentricInterpolator(segment.t_s[window], segment.states[window])(t_s[:1])
        np.testing.assert_allclose(segment.evaluate(t_s)[:1], expected, rtol=1e-12)
        np.testing.assert_allclose(segment.evaluate(segment.t_s[:3]), segment.states[:3], rtol=1e-15)

    @pytest.mark.parametrize("kind", [1, 21, 8, 12])
    def test_other_types_agree_with_cspice(self, tmp_path, kind):
        """What Horizons sends (21; formerly 1) and tables of equal steps."""
        made = difference_file if kind in (1, 21) else equal_step_file
        orbit = read_spk(made(tmp_path / f"type{kind}.bsp", kind))
        mine = [row for row in CSPICE_TYPES if row[0] == kind]
        found = orbit.segments[0].evaluate(np.array([et for _, et, _ in mine]))
        expected = np.array([state for *_, state in mine])
        # 4e8 km carry 6e-8 km
        np.testing.assert_allclose(found[:, :3], expected[:, :3], rtol=0.0, atol=1e-6)
        np.testing.assert_allclose(found[:, 3:], expected[:, 3:], rtol=0.0, atol=1e-11)

    @pytest.mark.parametrize("kind", [1, 21, 8, 12, 9, 13])
    def test_a_segment_that_contradicts_itself_is_refused(self, tmp_path, kind):
        """Counts that do not fit, orders beyond the tables, times that do not ascend: a sentence with the file."""
        if kind in (1, 21):
            records, ends = difference_lines(15 if kind == 1 else 20)
            head, tail = [*records.ravel(), *ends], [4] if kind == 1 else [20, 4]
        else:
            head = [*kepler(np.arange(40) * 1800.0).ravel(), *(np.arange(40.0) if kind in (9, 13) else [0.0, 60.0])]
            tail = [5, 40]
        for words in ([*head, *tail[:-1], 9e9], [*head, *tail[:-1], np.nan], [*head[:-40], *tail], [*head[1:], *tail]):
            path = daf(tmp_path / "wrong.bsp", [(0.0, 1e9, -999001, 10, kind, words)])
            with pytest.raises(DataError, match=r"wrong\.bsp: target -999001: "):
                read_spk(path)

    @pytest.mark.parametrize("kind", [1, 21, 8, 12])
    def test_damaged_files_are_read_or_refused_and_never_break(self, tmp_path, ephemeris, kind):
        """Forty mutants of each: bytes changed, above all in the summaries, and cut files."""
        made = difference_file if kind in (1, 21) else equal_step_file
        whole = made(tmp_path / "whole.bsp", kind).read_bytes()
        rng, refused = np.random.default_rng(kind), 0
        for _ in range(40):
            raw = bytearray(whole)
            for place in rng.choice([rng.integers(1024), 1024 + rng.integers(70), rng.integers(len(raw))], 3):
                raw[place] = rng.integers(256)
            path = tmp_path / "mutant.bsp"
            path.write_bytes(raw[: len(raw) if rng.random() < 0.8 else rng.integers(len(raw))])
            try:
                orbit = read_spk(path)
                orbit.state_km_km_s(ephemeris, orbit.epoch, np.array([7.0e8 + 1234.5]))
            except (DataError, CoverageError):
                refused += 1
        assert refused > 5

    def test_an_unsupported_type_is_named(self, jwst, tmp_path):
        with pytest.raises(DataError, match=r"SPK type \[10\]; types 1, 2, 3, 8, 9, 12, 13 and 21"):
            read_spk(self.retyped(jwst, tmp_path, 10))


def daf(path, segments):
    """Write a DAF/SPK file of segments (start, end, target, centre, type, words)."""
    head = struct.pack("<8sii60siii8s", b"DAF/SPK ", 2, 6, b"test".ljust(60), 2, 2, 0, b"LTL-IEEE").ljust(699, b"\0")
    head = (head + b"FTPSTR:\r:\n:\r\n:\r\0:\x81:\x10\xce:ENDFTP").ljust(1024, b"\0")
    summaries, words, free = struct.pack("<3d", 0.0, 0.0, len(segments)), b"", 385
    for start, end, target, centre, kind, numbers in segments:
        last = free + len(numbers) - 1
        summaries += struct.pack("<2d6i", start, end, target, centre, 1, kind, free, last)
        words, free = words + np.asarray(numbers, dtype="<f8").tobytes(), last + 1
    path.write_bytes(head + summaries.ljust(1024, b"\0") + b" " * 1024 + words + b"\0" * (-len(words) % 1024))
    return path


def difference_lines(size, count=4):
    """Made-up difference lines (count, 4 size + 11) of all orders, 4000 s each, and where they end."""
    rng = np.random.default_rng(size)
    records, ends = np.zeros((count, 4 * size + 11)), 7.0e8 + 4000.0 * np.arange(1, count + 1)
    for k, record in enumerate(records):
        highest = (2, size, size // 2, 3)[k]
        record[0] = ends[k] - 4000.0
        record[1 : 1 + size] = (-1.0) ** k * np.cumsum(rng.uniform(2e3, 6e3, size))
        record[1 + size : 7 + size] = np.ravel(rng.normal(size=(3, 2)) * [1.4e8, 20.0])
        record[7 + size : 7 + 4 * size] = np.ravel(rng.normal(size=(3, size)) * 6e-6 * 0.3 ** np.arange(size))
        record[-4:] = highest, highest - 1, max(highest - 2, 0), highest - 1
    return records, ends


def difference_file(path, kind):
    """An SPK file of type 1 or 21."""
    size = 15 if kind == 1 else 20
    records, ends = difference_lines(size)
    tail = [len(ends)] if kind == 1 else [size, len(ends)]
    return daf(path, [(ends[0] - 5000.0, ends[-1], -999001, 10, kind, [*records.ravel(), *ends, *tail])])


def equal_step_file(path, kind):
    """An SPK file of type 8 or 12: forty states half an hour apart, six to each polynomial."""
    states = kepler(np.arange(40) * 1800.0)
    return daf(path, [(7.0e8, 7.0e8 + 39 * 1800.0, -999001, 399, kind, [*states.ravel(), 7.0e8, 1800.0, 5, 40])])


# CSPICE N0067 (spiceypy 8.3.0, spkgeo about the centre) on the very files made above: type, ET, state
CSPICE_TYPES = [
    (
        8,
        700000300.0,
        [
            23005.925124442805,
            29245.51828333614,
            7452.523751126023,
            -2.690806830033873,
            1.9358039608851765,
            0.7522431356399327,
        ],
    ),
    (
        8,
        700036777.0,
        [
            -40063.03091953242,
            -22228.21614366094,
            -4276.8323131935385,
            1.2692775057411378,
            -2.371649294615918,
            -0.7970174434993482,
        ],
    ),
    (
        8,
        700070195.0,
        [
            36466.391678833534,
            -16925.31577888295,
            -7372.3149258922085,
            1.1439305317328519,
            2.8483170576640573,
            0.7932236563230153,
        ],
    ),
    (
        12,
        700000300.0,
        [
            23005.92211267117,
            29245.549570055788,
            7452.533421414877,
            -2.6908131421494863,
            1.9358024199925892,
            0.7522430564023627,
        ],
    ),
    (
        12,
        700036777.0,
        [
            -40063.03034733054,
            -22228.216089755137,
            -4276.832332015935,
            1.26927746100866,
            -2.3716492319467894,
            -0.7970174217508782,
        ],
    ),
    (
        12,
        700070195.0,
        [
            36466.391450537514,
            -16925.315924503702,
            -7372.314956009995,
            1.1439305300263842,
            2.8483170142669763,
            0.793223643271187,
        ],
    ),
    (
        1,
        699999100.0,
        [
            30090976.85702481,
            195046877.85447776,
            232477837.11619723,
            6.591321990239439,
            10.656880324382392,
            12.690182830072315,
        ],
    ),
    (
        1,
        700001234.5,
        [
            30105043.604399726,
            195069624.96553016,
            232504909.6799516,
            6.58904566018319,
            10.656880324382392,
            12.676473299590171,
        ],
    ),
    (
        1,
        700004000.0,
        [
            30123261.53208674,
            195099096.56806725,
            232539941.9059913,
            6.586096402384852,
            10.656880324382392,
            12.658710963423214,
        ],
    ),
    (
        1,
        700007777.25,
        [
            -89297825.56595838,
            155347463.21616083,
            -192693849.81479678,
            -13.723823325757927,
            -15.145292343037388,
            15.812129784486299,
        ],
    ),
    (
        1,
        700008000.5,
        [
            -6750515.518957661,
            -76793561.79135911,
            32061348.22030136,
            -11.477393541169103,
            8.334754572928238,
            24.221968997268288,
        ],
    ),
    (
        1,
        700016000.0,
        [
            3116465.7580416948,
            230928693.5078887,
            163259795.85528213,
            3.414600834860656,
            -30.732280249547745,
            5.159806107504654,
        ],
    ),
    (
        21,
        699999100.0,
        [
            -199849104.7149729,
            -170298921.94386774,
            299222444.89294994,
            24.62124633574145,
            0.8476356132954423,
            -51.024655879931956,
        ],
    ),
    (
        21,
        700001234.5,
        [
            -199796569.89537376,
            -170297112.66565117,
            299113534.91810703,
            24.60322740440911,
            0.8476356132954423,
            -51.022638421215106,
        ],
    ),
    (
        21,
        700004000.0,
        [
            -199728561.9512263,
            -170294768.52936262,
            298972435.4258667,
            24.579881724109466,
            0.8476356132954423,
            -51.020024562193576,
        ],
    ),
    (
        21,
        700007777.25,
        [
            -45142550.30954895,
            236247032.66917038,
            65623628.13030533,
            -25.544027680119015,
            -12.302279743153834,
            -5.299862667394641,
        ],
    ),
    (
        21,
        700008000.5,
        [
            -171148877.46336833,
            -154481937.63018703,
            76688205.00003447,
            -2.768380781561222,
            31.033062188786435,
            17.89980860256452,
        ],
    ),
    (
        21,
        700016000.0,
        [
            76829326.39488494,
            52578529.467230685,
            -345700584.4708723,
            -2.460834508022622,
            10.454977067108514,
            -21.506953131031246,
        ],
    ),
]


@pytest.mark.parametrize("number", [1e300, -1e300, 1e15, 1e11])
def test_a_damaged_coefficient_of_an_spk_file_is_refused_with_the_file(tmp_path, ephemeris, number):
    """Type 2 about the Earth, one record of two coefficients, the first of x damaged."""
    name = b"NAME".ljust(60)
    head = struct.pack("<8sii60siii8s603s", b"DAF/SPK ", 2, 6, name, 2, 2, 513, b"LTL-IEEE", b"")
    file = BytesIO((head + b"FTPSTR:\r:\n:\r\n:\r\x00:\x81:\x10\xce:ENDFTP").ljust(1024, b"\0") + bytes(3072))
    record = [0.5 * DAY, 0.5 * DAY, number, 0.0, 7000.0, 0.0, 0.0, 7.0]
    DAF(file).add_array(b"SEGMENT".ljust(40), (0.0, DAY, -99, 399, 1, 2), np.array([*record, 0.0, DAY, 8.0, 1.0]))
    path = tmp_path / "craft.bsp"
    path.write_bytes(file.getvalue())
    orbit = read_spk(path)
    with pytest.raises(DataError, match=r"craft\.bsp: .*damaged"):
        orbit.state_km_km_s(ephemeris, Epoch.from_jd(2451545.0), np.array([100.0, 40000.0]))
