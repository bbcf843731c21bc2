"""Recorded observations as a tracklet: what a fit's settings say of them, and errors that a station's records share.

A fit lets an unknown clock be wrong anew at each record, sqrt(N) times as much, and lets many records of a night weigh
as few. In the first hour that would hide the curvature of whatever moves fast. Here each station has one bias and one
clock, which are marginalised.
"""

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import Ephemeris
from nebosvod.dynamics.impact import follow
from nebosvod.errors import GeometryError
from nebosvod.estimation.solvers.rejection import Thresholds
from nebosvod.first_hour.condensed import FEW, Few, condensed, searched
from nebosvod.first_hour.conditional import RATE, Conditional, Nodes
from nebosvod.first_hour.nights import POOR, orbit_of_nights
from nebosvod.first_hour.region import Region
from nebosvod.first_hour.tracklet import Columns, Tracklet, middle_of
from nebosvod.fits.engine import thresholds_of
from nebosvod.fits.photometry import TO_V
from nebosvod.mission import FitMission
from nebosvod.mission.bias import Bias
from nebosvod.mission.fit import StationUncertainty
from nebosvod.mission.uncertainty import Timing
from nebosvod.observation.formats.records import Astrometry
from nebosvod.observation.measurement.astrometry import compute
from nebosvod.scene.dates import dated
from nebosvod.scene.material import Material, prepare
from nebosvod.scene.recorded import scene_of
from nebosvod.scene.scene import force_model, require_epochs
from nebosvod.timescale import SECONDS_PER_DAY
from nebosvod.units import ARCSEC

Array = npt.NDArray[np.float64]
Rows = npt.NDArray[np.int64]
LONGEST_D = 30.0  # arcs on which range and rate are not what is unknown
HALF_AU = -0.7
FOLLOWED_KM_S = 3e4
SEEN_MAG = (0.0, 40.0)  # other magnitudes stand for none, as 99.9 does
MILD = 36.0  # chi squared of a record that moves the orbit by little, one of many
BIAS_RAD = 0.2 * ARCSEC  # that a station's records of a night share, where nobody says otherwise


def prepared(records: Astrometry, mission: FitMission, ephemeris: Ephemeris) -> Material:
    """The records of one object, placed and weighed, with clocks on the ground to be shared.

    Raises
    ------
    GeometryError
        If they are of one time: then a direction is known, and no motion.
    InputError, CoverageError, DataError
        As a fit.
    """
    require_epochs(mission, ephemeris)
    records = dated(records, mission)
    name = records.objects[0]
    if len(np.unique(records.t_s)) < 2:
        what = "one observation" if len(records) == 1 else f"{len(records)} observations of one time"
        raise GeometryError(
            f"{name}: {what}: a direction is known and no motion, so no orbit is more likely than others"
        )
    arc_d = float(np.ptp(records.t_s)) / SECONDS_PER_DAY
    if arc_d > LONGEST_D:
        text = f"the observations span {arc_d:.0f} d (allowed {LONGEST_D:g})"
        raise GeometryError(f"{name}: {text}: range and rate are no longer what is unknown; use nebosvod fit")
    return prepare(records, with_shared(records, mission), ephemeris)


def with_shared(records: Astrometry, mission: FitMission) -> FitMission:
    """The settings, in which every station not named there has a bias and, on the ground, a clock of its own."""
    ground = ((records.centre == "") | records.roving) & (records.mode != "OCC") & ~np.isfinite(records.timing_sigma_s)
    every = tuple(dict.fromkeys(records.station.tolist()))
    entries = []
    if codes := _unnamed(every, mission, "bias"):
        bias = Bias.model_construct(sigma=BIAS_RAD, correlation="constant", treatment="estimated")
        entries.append(
            StationUncertainty.model_construct(stations=codes, shared=None, bias=bias, position=None, timing=None)
        )
    codes = _unnamed(tuple(dict.fromkeys(records.station[ground].tolist())), mission, "timing")
    if codes and "clock" not in mission.fit.model_fields_set:
        clock = Timing.model_construct(sigma=mission.fit.clock, mean=0.0, treatment="estimated")
        entries.append(
            StationUncertainty.model_construct(stations=codes, shared=None, bias=None, position=None, timing=clock)
        )
    plan = mission.fit.model_copy(update={"uncertainty": (*mission.fit.uncertainty, *entries)})
    return mission.model_copy(update={"fit": plan})


def _unnamed(codes: tuple[str, ...], mission: FitMission, kind: str) -> tuple[str, ...]:
    """Stations of which the settings name no error of a kind."""
    named = [entry.stations for entry in mission.fit.uncertainty if getattr(entry, kind) is not None]
    return tuple(code for code in codes if not any(said == "all" or code in said for said in named))


def tracklet_of(material: Material, records: Astrometry, mission: FitMission) -> Tracklet:
    """All records of a material as a tracklet.

    Parameters
    ----------
    mission : the settings, with clocks.
    """
    name = records.objects[0]
    reference = middle_of(material.astrometry.t_s)
    epoch = material.exposures.epoch + float(material.exposures.t_s[reference])
    forces = force_model(mission, material.ephemeris)
    bare = Tracklet.of(name, material.exposures, material.observed, forces, Columns.none(len(material)))
    conditional = Conditional(bare)
    state = conditional.states(conditional.first(np.array([HALF_AU]), np.zeros(1)))[0]
    # a direction that leaps is followed faster than light; what the columns tell does not depend on it
    state[3:] *= min(1.0, FOLLOWED_KM_S / float(np.linalg.norm(state[3:])))
    resolved = mission.of(name, material.names, epoch, state)
    span = (float(bare.exposures.t_s.min()) - SECONDS_PER_DAY, float(bare.exposures.t_s.max()) + 1.0)
    trajectory = follow(state, epoch, span, 0.0, forces, True)
    scene = scene_of(resolved, material, forces, trajectory, np.arange(len(material)))
    columns = Columns.of(scene.nuisances, compute(trajectory, scene.exposures), material.ephemeris)
    return replace(bare, columns=columns, magnitude=apparent_v(material.astrometry))


def apparent_v(records: Astrometry) -> float | None:
    """The median V of the records; None where none states a magnitude of a known band."""
    correction = np.array([TO_V.get(str(band)[-1:], np.nan) for band in records.band])
    values = np.asarray(records.magnitude, dtype=np.float64) + correction
    values = values[(values > SEEN_MAG[0]) & (values < SEEN_MAG[1])]
    return float(np.median(values)) if len(values) else None


def without_gross_errors(tracklet: Tracklet, region: Region, mission: FitMission) -> tuple[Tracklet, Rows, Few | None]:
    """The tracklet without records that no orbit fits, the worst first; the rows (r,) kept; the few that stand for it.

    Notes
    -----
    Thresholds are those of a fit; a record is judged by its noise, at the best of orbits over all ranges. One that was
    left out by little moves that orbit by little: it is followed from where it was.
    """
    thresholds, kept = thresholds_of(mission), np.arange(len(tracklet))
    if thresholds is None:
        return tracklet, kept, None
    chosen, few, orbit = tracklet, None, None
    while len(kept) > 3:
        few = condensed(chosen, region, None if orbit is None else few)
        here, every = Conditional(few.tracklet), Conditional(chosen)
        known = few.orbits if orbit is None else here.solve(here.coordinates(orbit), 2)
        best = _best(here, region, searched(here, region) if known is None else known)
        best = best if orbit is not None else _over_nights(here, region, best)
        orbit = here.states(best[:, :6])
        # coordinates are from the direction at the reference time, which is not the same where records are condensed
        chi2 = _each(every, np.hstack([every.coordinates(orbit), best[:, 6:]]))
        worst = int(np.argmax(chi2))
        if not chi2[worst] > _limit(thresholds, len(kept)):
            return chosen, kept, few
        if chi2[worst] > MILD or len(kept) <= FEW:
            orbit = None
        kept = np.delete(kept, worst)
        chosen = tracklet.select(kept)
    return chosen, kept, None


def _limit(thresholds: Thresholds, n: int) -> float:
    return thresholds.reject + thresholds.fudge * thresholds.decay**n


def _best(conditional: Conditional, region: Region, lines: Nodes) -> Array:
    """Coordinates (1, 6) and nuisances of the best orbit, joined (1, 6 + k), begun at the best of some."""
    found = int(np.argmin(lines.chi2))
    if lines.range_sigma[found] < 0.5:
        full = conditional.solve(lines.coordinates[found : found + 1], 0)
        low, high = replace(region, bound=False).rates(conditional, full.coordinates)
        if full.chi2[0] <= lines.chi2[found] and low[0] <= full.coordinates[0, RATE] <= high[0]:
            return np.hstack([full.coordinates, full.nuisance])
    return np.hstack([lines.coordinates[found : found + 1], lines.nuisance[found : found + 1]])


def _over_nights(conditional: Conditional, region: Region, best: Array) -> Array:
    """The best orbit (1, 6 + k), or one that fits better where it fits badly and there are records of other nights."""
    chi2 = float(_each(conditional, best).sum())
    if chi2 < POOR * len(conditional.tracklet):
        return best
    orbit = orbit_of_nights(conditional, region)
    if orbit is None:
        return best
    found = conditional.solve(orbit, 2)
    other = np.hstack([found.coordinates, found.nuisance])
    return other if float(_each(conditional, other).sum()) < chi2 else best


def _each(conditional: Conditional, best: Array) -> Array:
    """Chi squared (n,) of each record by its noise alone."""
    white = conditional.whitened(best[:, :6], best[:, 6:])
    found: Array = np.sum(white[0] ** 2, axis=1)
    return found
