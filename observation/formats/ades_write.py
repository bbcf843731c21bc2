"""Writing ADES 2022, as PSV and as XML that the official schema accepts, with the residuals of a fit if given."""

import re
from dataclasses import dataclass
from html import escape

import erfa
import numpy as np

from nebosvod.errors import InputError
from nebosvod.observation.contracts import Array, Flags
from nebosvod.observation.formats.designations import kind
from nebosvod.observation.formats.records import Astrometry
from nebosvod.units import ARCSEC

CENTRES = {"earth": "399", "sun": "10", "ssb": "0"}
# the order that the schema prescribes
COLUMNS = (
    "permID", "provID", "artSat", "trkSub", "mode", "stn", "sys", "ctr", "pos1", "pos2", "pos3",
    "posCov11", "posCov12", "posCov13", "posCov22", "posCov23", "posCov33", "obsTime", "rmsTime", "ra", "dec",
    "rmsRA", "rmsDec", "rmsCorr", "astCat", "mag", "band", "disc",
    "orbProd", "orbID", "resRA", "resDec", "selAst", "sigRA", "sigDec", "sigCorr",
)  # fmt: skip
OWN_NAME = re.compile(r"[- ?+@./()\\A-Za-z0-9_]{1,8}")
FULL_TIME = re.compile(r"(.*\.\d{6})\d*Z")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Residuals:
    """What a fit made of the observations that are written.

    Attributes
    ----------
    orbit : name of the orbit, at most 25 letters.
    residual_rad : (n, 2) observed minus computed RA cos Dec and Dec.
    sigma_rad : (n, 2) the sigmas that the fit used.
    correlation : (n,) their correlation.
    accepted : (n,) whether the observation took part in the fit.
    """

    orbit: str
    residual_rad: Array
    sigma_rad: Array
    correlation: Array
    accepted: Flags


def write_psv(astrometry: Astrometry, residuals: Residuals | None = None) -> str:
    """The observations as an ADES PSV file.

    Raises
    ------
    InputError
        If the residuals are of another number of observations.
    """
    rows = _rows(astrometry, residuals)
    names = [name for name in COLUMNS if any(row.get(name) for row in rows)]
    width = {name: max(len(name), *(len(row.get(name, "")) for row in rows)) for name in names}
    lines = ["# version=2022", "|".join(name.ljust(width[name]) for name in names)]
    lines += ["|".join(row.get(name, "").ljust(width[name]) for name in names) for row in rows]
    return "\n".join(line.rstrip() if not line.rstrip().endswith("|") else line for line in lines) + "\n"


def write_xml(astrometry: Astrometry, residuals: Residuals | None = None) -> str:
    """The observations as an ADES XML file; raises as `write_psv`."""
    lines = ['<?xml version="1.0" encoding="UTF-8"?>', '<ades version="2022">']
    for row in _rows(astrometry, residuals):
        fields = (f"    <{name}>{escape(row[name], quote=False)}</{name}>" for name in COLUMNS if row.get(name))
        lines += ["  <optical>", *fields, "  </optical>"]
    return "\n".join([*lines, "</ades>"]) + "\n"


def _rows(astrometry: Astrometry, residuals: Residuals | None) -> list[dict[str, str]]:
    """The texts of each record by name; those absent or empty are not written."""
    n = len(astrometry)
    if not n:
        raise InputError("no observations to write")
    if residuals is not None and len(residuals.residual_rad) != n:
        raise InputError(f"{len(residuals.residual_rad)} residuals for {n} observations")
    psi = np.degrees(astrometry.psi)
    sigma = astrometry.sigma_rad / ARCSEC
    rows = []
    for i in range(n):
        stated = bool(np.isfinite(sigma[i]).all())
        row = {
            **_identity(str(astrometry.designation[i])),
            "mode": str(astrometry.mode[i]) or "UNK",
            "stn": str(astrometry.station[i]),
            **_place(astrometry, i),
            "obsTime": FULL_TIME.sub(r"\1Z", str(astrometry.utc[i])),
            "rmsTime": _short(float(astrometry.timing_sigma_s[i]), 8),
            "ra": _right_ascension(psi[i, 0]),
            "dec": f"{psi[i, 1]:+.9f}",
            "rmsRA": _short(sigma[i, 0], 7) if stated else "",
            "rmsDec": _short(sigma[i, 1], 7) if stated else "",
            "rmsCorr": f"{astrometry.correlation[i]:.6f}" if stated and astrometry.correlation[i] else "",
            "astCat": str(astrometry.catalogue[i]) or "UNK",
            "disc": "*" if astrometry.discovery[i] else "",
        }
        if np.isfinite(astrometry.magnitude[i]):
            row |= {"mag": f"{astrometry.magnitude[i]:.2f}", "band": str(astrometry.band[i]) or "UNK"}
        if residuals is not None:
            row |= _residual(residuals, i)
        rows.append(row)
    return rows


def _identity(name: str) -> dict[str, str]:
    """The element that holds this designation."""
    element = {"number": "permID", "provisional": "provID"}.get(kind(name))
    return {element or ("trkSub" if OWN_NAME.fullmatch(name) else "artSat"): name}


def _right_ascension(degrees: float) -> str:
    """Nine decimals; what would round to 360 is 0."""
    text = f"{degrees:.9f}"
    return "0.000000000" if text.startswith("360") else text


def _short(value: float, width: int) -> str:
    """A positive number without an exponent in at most `width` characters, "" for nan; never rounded to zero."""
    if not np.isfinite(value):
        return ""
    places = width - 2
    text = f"{value:.{places}f}"
    whole = text.index(".")
    text = f"{value:.{max(places + 1 - whole, 0)}f}" if whole > 1 else text
    return text if float(text) > 0.0 else "0." + "0" * (places - 1) + "1"


def _place(astrometry: Astrometry, i: int) -> dict[str, str]:
    """sys, ctr, positions and covariance of a record that carries them."""
    centre = str(astrometry.centre[i])
    if not centre:
        return {}
    position = astrometry.position_km[i]
    if astrometry.roving[i]:
        longitude, latitude, altitude = erfa.gc2gd(1, position * 1e3)
        values = (f"{np.degrees(longitude) % 360.0:.7f}", f"{np.degrees(latitude):.7f}", f"{altitude:.2f}")
        return {"sys": "WGS84", "ctr": "399", **dict(zip(("pos1", "pos2", "pos3"), values))}
    # thirteen characters are allowed after the sign: as many decimals as they leave
    places = max(0, 12 - len(f"{np.max(np.abs(position)):.0f}"))
    row = {"sys": "ICRF_KM", "ctr": CENTRES[centre]}
    row |= {f"pos{axis + 1}": f"{position[axis]:.{min(places, 6)}f}" for axis in range(3)}
    covariance = astrometry.position_covariance_km2[i]
    if np.isfinite(covariance).all():
        for k, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)):
            row[f"posCov{k + 1}{j + 1}"] = f"{covariance[k, j]:.10e}"
    return row


def _residual(residuals: Residuals, i: int) -> dict[str, str]:
    """The residual group of one record, arcsec."""
    residual, sigma = residuals.residual_rad[i] / ARCSEC, residuals.sigma_rad[i] / ARCSEC
    return {
        "orbProd": "nebosvod",
        "orbID": residuals.orbit[:25] or "orbit",
        "resRA": _signed(residual[0]),
        "resDec": _signed(residual[1]),
        "selAst": "A" if residuals.accepted[i] else "d",
        "sigRA": _short(sigma[0], 7),
        "sigDec": _short(sigma[1], 7),
        "sigCorr": f"{residuals.correlation[i]:.6f}" if residuals.correlation[i] else "",
    }


def _signed(value: float) -> str:
    """A number in at most seven characters: three decimals while they fit."""
    text = f"{value:+.3f}"
    return text if len(text) <= 7 else f"{value:+.0e}".replace("e+0", "e")
