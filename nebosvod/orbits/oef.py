"""Orbital element files of OrbFit and of ESA's NEO Coordination Centre (OEF1.1, OEF2.0; .ke0 .ke1 .eq0 .fel .oel).

A header names the format and the reference system. Each object follows by its name, a line of elements (KEP, EQU, COM
or CAR), the epoch (MJD), and optionally MAG, LSP with NGR, COV and NOR. Lengths are au, angles deg, times d; the
covariance (COV) and the normal matrix (NOR) are upper triangles, row by row, in the same units, COR repeats the first
as correlations. The dynamic parameters of LSP model 1 are the area-to-mass ratio (m^2/t) and A2 (1e-10 au/d^2).
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import Nongrav, RadiationPressure
from nebosvod.errors import InputError
from nebosvod.orbits.conversion import (
    Elements,
    Frame,
    Given,
    balanced_factor,
    factor_of,
    factor_of_normal,
    full,
    sphere_of,
)
from nebosvod.timescale import SCALES, Epoch
from nebosvod.units import AU_KM, DAY_S, DEG

Array = npt.NDArray[np.float64]
GAUSS_GM_KM3_S2 = 0.01720209895**2 * AU_KM**3 / DAY_S**2  # k^2: OrbFit converts elements with Gauss' constant
FRAMES: dict[str, Frame] = {"ECLM J2000": "ecliptic_j2000", "EQUM J2000": "icrf"}
KINDS: dict[str, Elements] = {"KEP": "keplerian", "EQU": "equinoctial", "COM": "cometary", "CAR": "state"}
SPEED = AU_KM / DAY_S
UNITS: dict[str, tuple[float, ...]] = {
    "KEP": (AU_KM, 1.0, DEG, DEG, DEG, DEG),
    "EQU": (AU_KM, 1.0, 1.0, 1.0, 1.0, DEG),
    "COM": (AU_KM, 1.0, DEG, DEG, DEG, DAY_S),  # q, e, i, node, peri, tp
    "CAR": (AU_KM, AU_KM, AU_KM, SPEED, SPEED, SPEED),
}
ORDER = {"COM": (1, 0, 5, 3, 4, 2)}  # of `cometary_to_state`: e, q, tp, node, peri, i
SCALE_OF = {"TDT": "tt", "TDB": "tdb", "TT": "tt", "ET": "tdb", "UTC": "utc"}
SCALE_NGR = {"area": 1e-3, "a2": 1e-10}  # m^2/t -> m^2/kg; -> au/d^2
MOST = 100_000  # objects of a file


@dataclass(slots=True)
class _Block:
    """One object as it stands in the file, with the number of the line of each thing."""

    name: str
    line: int
    elements: tuple[str, list[float]] | None = None
    epoch: Epoch | None = None
    magnitude: tuple[float, float] | None = None
    solved: tuple[int, ...] = ()
    dimension: int = 6
    physical: tuple[float, ...] = ()
    triangles: dict[str, list[float]] = field(default_factory=dict)
    at: dict[str, int] = field(default_factory=dict)


def read_oef(path: Path, text: str) -> Given:
    """The orbit in a file with one object.

    Raises
    ------
    InputError
        With file and line, for whatever cannot be used: no covariance, several objects, an indefinite matrix.
    """
    frame, blocks = _Reader(path.name, text).read()
    if len(blocks) > 1:
        names = ", ".join(block.name for block in blocks[:5])
        raise InputError(f"{path.name}: holds {len(blocks)} orbits ({names}); keep one of them in a file of its own")
    return _given(path.name, frame, blocks[0])


class _Reader:
    """Walks through the lines once; knows where it is, for messages."""

    def __init__(self, name: str, text: str) -> None:
        self.name, self.number = name, 0
        self.text = text

    def wrong(self, what: str) -> InputError:
        return InputError(f"{self.name}:{self.number}: {what}")

    def _lines(self) -> Iterator[str]:
        for number, line in enumerate(self.text.splitlines(), start=1):
            self.number = number
            plain = line.partition("!")[0].strip()
            if plain:
                yield plain

    def read(self) -> tuple[Frame, list[_Block]]:
        frame: Frame | None = None
        blocks: list[_Block] = []
        inside = False
        for line in self._lines():
            if not inside:
                inside = line == "END_OF_HEADER"
                frame = self._header(line) or frame
                continue
            key, _, rest = line.partition(" ")
            if key not in ("KEP", "EQU", "COM", "CAR", "COT", "ATT", "MJD", "MAG", "LSP", "NGR", "COV", "COR", "NOR"):
                blocks.append(_Block(line.strip("'"), self.number))
            elif not blocks:
                raise self.wrong(f"{key} stands before the name of an object")
            else:
                self._item(blocks[-1], key, rest)
            if len(blocks) > MOST:
                raise self.wrong(f"more than {MOST} objects")
        if not inside or frame is None:
            raise self.wrong("the header lacks refsys or END_OF_HEADER; the file may be cut short")
        if not blocks:
            raise self.wrong("no orbit found")
        return frame, blocks

    def _header(self, line: str) -> Frame | None:
        key, _, value = (part.strip().strip("'") for part in line.partition("="))
        if key == "rectype" and value != "ML":
            raise self.wrong(f"rectype {value}: a catalogue of one line an orbit has no covariance; give one of ML")
        if key != "refsys":
            return None
        if value not in FRAMES:
            raise self.wrong(f"refsys {value}: one of {', '.join(FRAMES)} is read")
        return FRAMES[value]

    def _item(self, block: _Block, key: str, rest: str) -> None:
        """One line of an object."""
        block.at.setdefault(key, self.number)
        words = rest.split()
        if key in ("COV", "COR", "NOR"):
            block.triangles.setdefault(key, []).extend(self._numbers(words))
        elif key == "MJD":
            block.epoch = self._epoch(words)
        elif key == "MAG":
            H, G = ([*self._numbers(words[:2]), 0.15] if words else [99.0, 0.15])[:2]
            block.magnitude = (H, G) if H < 90.0 else None
        elif key == "LSP":
            self._dimensions(block, words)
        elif key == "NGR":
            block.physical = tuple(self._numbers(words))
        elif key in KINDS:
            numbers = self._numbers(words)
            if len(numbers) != 6:
                raise self.wrong(f"{key} needs six elements (got {len(numbers)})")
            block.elements = (key, numbers)
        else:
            raise self.wrong(f"elements {key} are not read (allowed: {', '.join(KINDS)})")

    def _numbers(self, words: list[str]) -> list[float]:
        try:
            values = [float(word.replace("D", "E").replace("d", "e")) for word in words]
        except ValueError:
            raise self.wrong(f'expected numbers, got "{" ".join(words)[:60]}"') from None
        if not np.isfinite(values).all():
            raise self.wrong("expected finite numbers")
        return values

    def _epoch(self, words: list[str]) -> Epoch:
        scale = SCALE_OF.get(words[1].upper()) if len(words) > 1 else None
        if scale not in SCALES:
            raise self.wrong(f"MJD needs a date and one of {', '.join(SCALE_OF)} (got {' '.join(words)[:40]})")
        try:
            return Epoch.parse(f"{words[0]} MJD {scale.upper()}")
        except InputError as error:
            raise self.wrong(str(error)) from None

    def _dimensions(self, block: _Block, words: list[str]) -> None:
        """`LSP model number dimension [parameters solved for]`."""
        try:
            model, _, block.dimension, *solved = (int(word) for word in words)
        except ValueError:
            raise self.wrong(f"LSP needs whole numbers (got {' '.join(words)[:40]})") from None
        block.solved = tuple(solved)
        if model not in (0, 1):
            raise self.wrong(f"LSP model {model} is not read (allowed: 0 and 1, asteroids; 1 has AMRAT and A2)")
        if block.dimension != 6 + len(solved) or not set(solved) <= {1, 2}:
            raise self.wrong(f"LSP: dimension {block.dimension} with solved-for parameters {solved} does not fit")


def _given(name: str, frame: Frame, block: _Block) -> Given:
    """An object in internal units."""
    if block.elements is None or block.epoch is None:
        missing = "elements" if block.elements is None else "MJD"
        raise InputError(f"{name}:{block.line}: {block.name} lacks its line of {missing}")
    key, numbers = block.elements
    raw, notices = _factor(name, block)
    physical = _Physical.of(name, block)
    units = np.array([*UNITS[key], *physical.units])
    order = [*ORDER.get(key, range(6)), *range(6, len(units))]
    values = np.array(numbers) * units[:6]
    if key == "COM":
        values[5] = Epoch.parse(f"{numbers[5]!r} MJD TT") - block.epoch
    return Given(
        name=block.name,
        epoch=block.epoch,
        kind=KINDS[key],
        values=values[order[:6]],
        factor=balanced_factor((units[:, None] * raw)[order]),
        gm_km3_s2=GAUSS_GM_KM3_S2,
        frame=frame,
        parameter_names=physical.names,
        radiation=physical.radiation,
        nongrav=physical.nongrav,
        magnitude=block.magnitude,
        notices=notices,
    )


def _factor(name: str, block: _Block) -> tuple[Array, tuple[str, ...]]:
    """Factor (n, n) of the covariance in the units of the file: of COV, else of NOR, which is its inverse."""
    n = block.dimension
    wanted = n * (n + 1) // 2
    for kind, numbers in block.triangles.items():
        if len(numbers) != wanted:
            where = f"{name}:{block.at[kind]}"
            raise InputError(
                f"{where}: {kind} of dimension {n} needs {wanted} numbers (got {len(numbers)}); cut short?"
            )
    if "COV" in block.triangles:
        return factor_of(full(np.array(block.triangles["COV"]), n), f"{name}:{block.at['COV']}: COV")
    if "NOR" in block.triangles:
        return factor_of_normal(full(np.array(block.triangles["NOR"]), n), f"{name}:{block.at['NOR']}: NOR"), ()
    raise InputError(
        f"{name}:{block.line}: {block.name} has no covariance (COV or NOR); give a file that has one, as .ke0 and .ke1 "
        "of ESA's NEO Coordination Centre, or fit the orbit from its observations: nebosvod fit"
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Physical:
    """The dynamic parameters of an object."""

    names: tuple[str, ...]
    units: tuple[float, ...]
    radiation: RadiationPressure | None
    nongrav: Nongrav | None

    @classmethod
    def of(cls, name: str, block: _Block) -> "_Physical":
        """Area-to-mass ratio and A2, as far as they act."""
        area, a2 = (*block.physical, 0.0, 0.0)[:2]
        ratio = area * SCALE_NGR["area"]
        if ratio < 0.0 or (1 in block.solved and ratio == 0.0):
            raise InputError(f"{name}:{block.at['NGR']}: an area-to-mass ratio of {area} m^2/t cannot be used")
        units = {1: SCALE_NGR["area"] / (ratio or 1.0), 2: SCALE_NGR["a2"]}
        names = {1: "thermal_emission", 2: "a2_au_d2"}
        return cls(
            names=tuple(names[k] for k in block.solved),
            units=tuple(units[k] for k in block.solved),
            radiation=sphere_of(ratio) if ratio > 0.0 else None,
            nongrav=Nongrav(a2_au_d2=a2 * SCALE_NGR["a2"]) if a2 or 2 in block.solved else None,
        )
