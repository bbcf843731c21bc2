"""What the tests of a fit found, in words: missing forces, shared errors, whole stations rejected, sigmas too large."""

from collections.abc import Iterator, Sequence

import numpy as np
import numpy.typing as npt
from scipy.special import chdtr

from nebosvod.errors import counted
from nebosvod.fits import missing_force
from nebosvod.fits.general import General
from nebosvod.fits.leading import NOTE, Led
from nebosvod.fits.shared_errors import LEAST, SharedError, parts
from nebosvod.scene.material import Material
from nebosvod.units import ARCSEC

Rows = npt.NDArray[np.int64]
UNITS = {"bias": "arcsec", "drift": "arcsec/d", "clock": "s", "scatter": "times", "wander": "arcsec"}
SPOKEN = 4  # shared errors, or groups rejected as a whole, spoken of one by one
GENEROUS = 0.5  # of its degrees of freedom, below which a small chi squared is spoken of
RARE = 1e-3  # chance of so small a one


def findings(found: Led, general: General) -> Iterator[str]:
    """Cautions, the gravest first."""
    force = missing_force.words(found.forces)
    if force:
        yield force
    for one in found.errors[:SPOKEN]:
        yield f"{told(one, found.material)}; {_treated(found, one)}"
    if len(found.errors) > SPOKEN:
        names = ", ".join(dict.fromkeys(one.station for one in found.errors[SPOKEN:]))
        yield f"shared errors of more than 5 sigma also at {names}; treated alike"
    whole = list(_deserted(found.material, general))
    yield from whole[:SPOKEN]
    if len(whole) > SPOKEN:
        yield f"and {len(whole) - SPOKEN} more stations, visits or nights of which every record was rejected"


def told(one: SharedError, material: Material) -> str:
    """A shared error as a clause."""
    utc = material.astrometry.utc
    rows = one.rows[np.argsort(material.astrometry.t_s[one.rows])]
    return words(one, (str(utc[rows[0]]), str(utc[rows[-1]])))


def _treated(found: Led, one: SharedError) -> str:
    """What was done about it."""
    if one.kind == "scatter" and any(note.endswith(NOTE) for note in set(found.material.rule[one.rows].tolist())):
        return "so their sigmas were enlarged by that factor and its uncertainty"
    if any(note.endswith(NOTE) for note in set(found.material.rule[one.rows].tolist())):
        return "so they weigh as one record of that size"
    return "their weights were left as they are"


def notices(found: Led, general: General) -> Iterator[str]:
    """What is no caution: sigmas that are larger than the residuals say."""
    estimate, material = general.fit.estimate, found.material
    if estimate.solution is None:
        return
    plain = general.selected.copy()
    for one in found.errors:
        plain[one.rows] = False
    v = general.residual[plain] * (material.thinning / material.sigma_rad.T).T[plain]
    freedom = v.size - len(estimate.names)
    if freedom <= 0:
        return
    chi2 = float(np.sum(v**2))
    if chi2 < GENEROUS * freedom and chdtr(freedom, chi2) < RARE:
        yield (
            f"the residuals are smaller than the weights expect, chi squared {chi2:.3g} for "
            f"{counted(freedom, 'degree')} of freedom before nights are thinned: the sigmas of the records may be "
            f"{np.sqrt(freedom / max(chi2, 1e-12)):.2g} times too large"
        )


def _deserted(material: Material, general: General) -> Iterator[str]:
    """Stations, and visits and nights of others, of which every record was rejected."""
    records, out = material.astrometry, ~general.selected
    for code in np.unique(records.station[out]).tolist():
        rows = np.flatnonzero(records.station == code)
        rows = rows[np.argsort(records.t_s[rows], kind="stable")]
        if out[rows].all() and len(rows) > 1:
            yield f"every one of {counted(len(rows), 'record')} of {code} was rejected"
            continue
        if out[rows].sum() < LEAST:
            continue
        said = np.zeros(len(rows), dtype=np.bool_)
        for part in parts(records.t_s[rows], material.night[rows]):
            if out[rows[part]].all() and not said[part].all():
                said[part] = True
                when = dates(str(records.utc[rows[part[0]]]), str(records.utc[rows[part[-1]]]))
                yield f"every one of {counted(len(part), 'record')} of {code}{when} was rejected"


def words(one: SharedError, date: Sequence[str]) -> str:
    """The shared error as a clause: what, how large, how sure.

    Parameters
    ----------
    date : of the first and the last record.
    """
    unit = UNITS[one.kind]
    pairs = ", ".join(f"{value:+.2g} +- {sigma:.1g}" for value, sigma in zip(one.estimate, one.sigma))
    what = {
        "bias": f"a common bias of {pairs} {unit} in RA*, Dec",
        "drift": f"a bias that drifts by {pairs} {unit} in RA*, Dec",
        "clock": f"a clock that is wrong by {pairs} {unit}",
        "scatter": f"stated sigmas that are {one.estimate[0]:.2g} +- {one.sigma[0]:.1g} times too small",
        "wander": "a slowly changing bias of {:.2g}, {:.2g} arcsec rms".format(*one.size_rad / ARCSEC),
    }[one.kind]
    others = ", ".join(f"{name} {value:.1f}" for name, value in one.significance.items() if name != one.kind)
    when = "" if one.whole else dates(*date)
    told = f"{one.station}, {counted(len(one.rows), 'record')}{when}: {what}, {one.sure:.1f} sigma"
    among_all = f"{one.corrected:.1f} as the surest of {one.tried} tests"
    return f"{told} ({among_all}{'; ' if others else ''}{others})"


def dates(first: str, last: str) -> str:
    """First and last date of some records as a clause."""
    return f" on {first[:10]}" if first[:10] == last[:10] else f" from {first[:10]} to {last[:10]}"
