"""Mutated observation files through each reader: a sound table or a sentence with file and line, never anything else.

NEBOSVOD_FUZZ_CASES raises the number of cases (1,500 by default for each format).
"""

import os
import random
import time
from collections.abc import Callable

import numpy as np
import pytest

from nebosvod.errors import InputError
from nebosvod.observation.formats.reading import format_of, parse_astrometry
from nebosvod.observation.formats.records import Astrometry
from nebosvod.observation.formats.source_file import SourceFile

CASES = int(os.environ.get("NEBOSVOD_FUZZ_CASES", "1500"))
LIMIT_S = 2.0  # CPU seconds for one file
COLUMNS = (
    "permID|provID|trkSub|mode|stn|sys|ctr|pos1|pos2|pos3|posCov11|posCov22|posCov33|posCov12|obsTime|rmsTime|ra|dec|"
    "rmsRA|rmsDec|rmsCorr|astCat|mag|band|disc|raStar|decStar|deltaRA|deltaDec|precRA|precDec|deprecated"
)
RECORDS = (
    "permID=3666,provID=1979 HP,mode=CCD,stn=G96,obsTime=2010-01-07T20:21:48.586Z,ra=19.04175,dec=-0.36842,rmsRA=0.1,"
    "rmsDec=0.2,rmsCorr=-0.3,astCat=Gaia2,mag=18.5,band=V,disc=*",
    "permID=3666,stn=C51,sys=ICRF_KM,ctr=399,pos1=6685.9,pos2=-1699.4,pos3=381.8,posCov11=1,posCov22=1,posCov33=1e0,"
    "posCov12=0.5,obsTime=2010-01-08T01:07:40Z,rmsTime=0.1,ra=19.0,dec=5.0,precRA=0.01,precDec=0.1",
    "permID=3666,mode=OCC,stn=275,sys=ICRF_AU,ctr=0,pos1=0.9,pos2=-0.1,pos3=0.3,obsTime=2020-09-15T14:02:19.12Z,"
    "rmsRA=0.1,rmsDec=0.1,astCat=UNK,raStar=27.7,decStar=60.0,deltaRA=2.0,deltaDec=-3.0",
    "trkSub=P10ab,mode=UNK,stn=247,sys=WGS84,ctr=399,pos1=237.7,pos2=38.1,pos3=12,obsTime=2016-12-31T23:59:60Z,ra=33.5,"
    "dec=1.5",
    "provID=2010 FM61,mode=PHO,stn=024,obsTime=1893-10-29T09:55:00Z,ra=92.2,dec=53.6,deprecated=X",
)
FIELDS = [dict(field.split("=") for field in record.split(",")) for record in RECORDS]
ROWS = tuple("|".join(fields.get(name, "") for name in COLUMNS.split("|")) for fields in FIELDS)
LINES = (
    "00433         A1893 10 29.4132  06 08 59.32 +53 39 04.2                 HA053802",
    "     K05TH3M* C2005 10 09.20072 21 31 27.04 -00 10 33.9          19.2 Vrp0839703",
    "j4767K10F61M  S2010 03 26.79569 06 54 24.99 +42 59 21.9                L~0KAAC51",
    "j4767K10F61M  s2010 03 26.79569 1 +  504.4738 + 5046.9579 + 4682.8243   ~0KAAC51",
    "00433         V2023 08 26.19193220 55 41.10 -08 18 29.6          15.1 VV~7811270",
    "00433         v2023 08 26.1919321 237.76096  +38.11385      0           ~7811270",
    "00433         R1975 01 23.00000                                          JPLR254",
    "00433         r1975 01 23.00000                                          JPLR254",
    "    CK19Y040  X2020 01 02.1234567 09 05.1     +19 48               14.7   BZ020024",
)


# records of (410777) as OrbFit 5 wrote them
RWO = (
    "version =   2",
    "errmod  = 'fcct14'",
    "END_OF_HEADER",
    "! a comment",
    " 410777    O C   2009 02 24.36493       1.000E-05 12 52 49.370  1.500E-01    0.433 F    0.204   -0.103 "
    "+00 09 47.30  1.000E-01    0.485 F    0.272   -0.298                       o 691      0.66 1 0",
    " 410777    S S   2014 05 25.28214       1.000E-05 10 37 03.990  1.500E-01    1.000 F    0.000    0.232 "
    "+10 15 51.90  1.000E-01    1.000 F    0.000   -0.203 19   R  1.00   1.35   L C51      0.31 1 1",
    " 410777    S s   2014 05 25.28214 1  -6063.8910   2951.8836   1376.0726 C51",
    " 410777    V c   2014 04 07 20:21:00    455098.63387   1.63248   1.63248 F     0.00000     1.19126 251 251"
    "      0.80 1",
)


def xml_seed() -> str:
    """The records as elements."""
    records = [
        "<optical>\n" + "".join(f"<{name}>{text}</{name}>\n" for name, text in fields.items()) + "</optical>\n"
        for fields in FIELDS
    ]
    return '<?xml version="1.0" encoding="UTF-8"?>\n<ades version="2022">\n' + "".join(records) + "</ades>\n"


SEEDS = {
    "psv": "\n".join(["# version=2022", "! x", COLUMNS, *ROWS, ""]),
    "csv": "\n".join(line.replace("|", ",") for line in (COLUMNS, *ROWS)) + "\n",
    "xml": xml_seed(),
    "mpc80": "\n".join([*LINES[:8], ""]),
    "rwo": "\n".join(
        [*RWO[:5], RWO[4].replace("24.36493", "25.40000"), RWO[4].replace("24.36493", "26.50000"), *RWO[5:], ""]
    ),
}
WORDS = (
    "", " ", "0", "-0", "360", "1e400", "nan", "-inf", "1" * 400, "9" * 19, "|", "||||", ",", '"', "\n", "\r",
    "\n\n", "\t", "\0", "<", ">", "&", "&amp;", "&#0;", "&x;", "<!DOCTYPE a>", "<![CDATA[", "]]>", "<!--", "-->",
    "<?x", "</optical>", "<ra>", "# version=2022", "#", "!", "2016-12-31T23:59:60Z", "0000-00-00T00:00:00Z",
    "9999-12-31T23:59:60Z", "Z", "60", "399", "ICRF_KM", "ICRF_AU", "ITRF", "C51", "247", "X", "S", "s", "V", "v",
    "R", "r", "O", "\u0660", "\u00b2", "\u202e", "\ufeff", "☄", "a" * 3000, "obsTime", "trx", "obsCenter", "permID",
    "+", "-", ".", "1_0", "0x10", "١٢",
)  # fmt: skip
Mutation = Callable[[random.Random, str], str]


def insert_word(rng: random.Random, text: str) -> str:
    """Put an odd word anywhere."""
    i = rng.randrange(len(text) + 1)
    return text[:i] + rng.choice(WORDS) + text[i:]


def replace_word(rng: random.Random, text: str) -> str:
    """Put an odd word over as many letters, so that columns stay where they are."""
    word = rng.choice(WORDS)
    i = rng.randrange(len(text) + 1)
    return text[:i] + word + text[i + len(word) :]


def swap_cell(rng: random.Random, text: str) -> str:
    """Put an odd word in place of what stands between two separators."""
    marks = [i for i, letter in enumerate(text) if letter in "|,>"]
    if not marks:
        return replace_word(rng, text)
    start = rng.choice(marks) + 1
    stop = min((j for mark in "|,<\n" if (j := text.find(mark, start)) >= 0), default=len(text))
    return text[:start] + rng.choice(WORDS) + text[stop:]


def delete_span(rng: random.Random, text: str) -> str:
    """Take out some letters."""
    i = rng.randrange(len(text) + 1)
    return text[:i] + text[i + rng.choice((1, 1, 2, 5, 20, 200)) :]


def flip_letter(rng: random.Random, text: str) -> str:
    """Change one letter into any other."""
    i = rng.randrange(len(text)) if text else 0
    return (
        text[:i]
        + chr(rng.choice((rng.randrange(32, 127), rng.randrange(48, 58), rng.randrange(0xD7FF))))
        + text[i + 1 :]
    )


def move_line(rng: random.Random, text: str) -> str:
    """Delete, double or move one line."""
    lines = text.splitlines(keepends=True)
    if not lines:
        return text
    line = lines.pop(rng.randrange(len(lines)))
    for _ in range(rng.randrange(3)):
        lines.insert(rng.randrange(len(lines) + 1), line)
    return "".join(lines)


def cut_short(rng: random.Random, text: str) -> str:
    """Keep the beginning only."""
    return text[: rng.randrange(len(text) + 1)]


MUTATIONS: tuple[Mutation, ...] = (
    insert_word, replace_word, replace_word, swap_cell, swap_cell, delete_span, flip_letter, flip_letter, move_line,
    cut_short,
)  # fmt: skip


def mutant(kind: str, seed: int) -> bytes:
    """One mutated file; the same for the same seed."""
    rng = random.Random(f"{kind} {seed}")
    text = SEEDS[kind]
    for _ in range(rng.choice((1, 1, 1, 2, 3, 8))):
        text = rng.choice(MUTATIONS)(rng, text)
    data = text.encode("utf-8", "surrogatepass")
    if rng.random() < 0.03:
        i = rng.randrange(len(data) + 1)
        data = data[:i] + rng.randbytes(rng.choice((1, 4, 64))) + data[i:]
    return data


def require_sound(table: Astrometry) -> None:
    """What every table must be, whatever it was read from."""
    n = len(table)
    assert n > 0
    assert np.isfinite(table.psi).all()
    assert np.all((table.psi[:, 0] >= 0.0) & (table.psi[:, 0] < 2.0 * np.pi) & (np.abs(table.psi[:, 1]) <= np.pi / 2.0))
    assert np.isfinite(table.t_s).all()
    assert np.min(table.t_s) >= 0.0
    assert not (table.sigma_rad <= 0.0).any()
    assert np.isnan(table.sigma_rad).all(axis=1).tolist() == np.isnan(table.sigma_rad).any(axis=1).tolist()
    assert np.all(np.abs(table.correlation) < 1.0)
    placed = table.centre != ""
    assert np.isfinite(table.position_km[placed]).all()
    assert np.isnan(table.position_km[~placed]).all()
    assert all(table.designation)
    assert all(len(code) >= 3 for code in table.station)


@pytest.mark.parametrize("kind", SEEDS)
def test_a_file_before_its_mutation_is_read_whole(kind: str) -> None:
    source = SourceFile("f", SEEDS[kind].encode())
    assert format_of(source) == kind
    table = parse_astrometry(source)
    require_sound(table)
    assert (len(table), sum(table.left_out.values())) == (4, 1)


def outcome(data: bytes) -> Astrometry | str:
    """The table, or the message of the refusal."""
    try:
        return parse_astrometry(SourceFile("f", data))
    except InputError as error:
        return str(error)


def require_placed(message: str) -> None:
    """Each line names the file, the first one a line of it, and none could disturb a terminal."""
    lines = message.split("\n")
    assert all(line.startswith("f:") and line.isprintable() for line in lines), message
    assert lines[0].split(":")[1].isdigit(), message
    assert max(map(len, lines)) < 500, message


@pytest.mark.parametrize("kind", SEEDS)
def test_mutated_files_always_get_a_sound_table_or_a_sentence(kind: str) -> None:
    refused = 0
    for seed in range(CASES):
        data = mutant(kind, seed)
        began = time.process_time()
        try:
            answer = outcome(data)
            if isinstance(answer, str):
                require_placed(answer)
                refused += 1
            else:
                require_sound(answer)
        except Exception as error:
            raise AssertionError(f"{kind} {seed}: {data!r}") from error
        assert time.process_time() - began < LIMIT_S, f"{kind} {seed}"
    assert refused > CASES // 4, "the mutations hardly ever break a file"
    assert refused < CASES - CASES // 50, "the mutations never leave a file whole"
