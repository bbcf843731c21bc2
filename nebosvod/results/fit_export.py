"""The fitted orbit for other programs: a CCSDS OEM with covariance, and an SPK file."""

import tempfile
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from nebosvod.estimation.accuracy.formed import formed
from nebosvod.fits.answer import Answer
from nebosvod.timescale import SECONDS_PER_DAY

MOST_STATES = 4000  # of an OEM; a day apart where they suffice
NUMBERED, UNNUMBERED = 20_000_000, 59_999_999  # NAIF: 20000000 + number; without a number, none is given out
NAME_LENGTH = 40


def exports(found: Answer) -> Mapping[str, bytes]:
    """Files of a run folder by name: orbit.oem and orbit.bsp; nothing where the fit has no covariance.

    Notes
    -----
    Both cover the observations and everything the answer asks for. The covariance of the OEM is the true one of the
    state, carried by the transition matrix alone: that of uncertain dynamic parameters beyond the fit is not in it. One
    that double precision cannot hold is left out.
    """
    if found.trajectory is None or found.amid is None:
        return {}
    name = found.fit.mission.object.name
    first, last = found.trajectory.span_s
    step = max(SECONDS_PER_DAY, (last - first) / MOST_STATES)
    times = np.arange(np.ceil(first / step), np.floor(last / step) + 1.0) * step
    along = found.trajectory.at(times if len(times) else np.array([0.0]))
    plain = name.encode("ascii", "replace").decode("ascii")
    with tempfile.TemporaryDirectory() as folder:
        oem, spk = Path(folder) / "orbit.oem", Path(folder) / "orbit.bsp"
        along.to_oem(
            oem,
            object_name=plain,
            object_id=plain,
            created=datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%S"),
            covariance=found.amid.covariance if formed(found.amid.S) else None,
        )
        found.trajectory.to_spk(spk, naif_number(name), plain[:NAME_LENGTH])
        return {"orbit.oem": oem.read_bytes(), "orbit.bsp": spk.read_bytes()}


def naif_number(designation: str) -> int:
    """The number an SPK file knows the object by."""
    return NUMBERED + int(designation) if designation.isdigit() and int(designation) < NUMBERED else UNNUMBERED
