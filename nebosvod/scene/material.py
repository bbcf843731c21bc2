"""The observations of one object with all that is needed to use them: observers, weights, corrections.

files -> Astrometry -> one object, by time -> where each observer was, what each weighs -> `Exposures`, `Sky`
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import Ephemeris
from nebosvod.errors import CoverageError, InputError, noting
from nebosvod.mission import FitMission
from nebosvod.mission.fit import FitPlan
from nebosvod.mission.reading.flight import too_often
from nebosvod.mission.reading.places import asking
from nebosvod.observation import Observation, Spacecraft
from nebosvod.observation.formats.reading import read_astrometry
from nebosvod.observation.formats.records import Astrometry, joined
from nebosvod.observation.measurement.direction import offset
from nebosvod.observation.measurement.exposures import Exposures, Sky
from nebosvod.observation.measurement.telescope import Telescope
from nebosvod.observation.reduction import debias, stated_weights, weights
from nebosvod.observation.reduction.observers import Observers, telescopes
from nebosvod.observation.reduction.weight_rules import read_rules
from nebosvod.scene.dates import dated
from nebosvod.scene.instruments import SPACECRAFT
from nebosvod.timescale import SECONDS_PER_DAY, Epoch

Array = npt.NDArray[np.float64]
Texts = npt.NDArray[np.str_]
LISTED = 8  # objects named when a file holds several


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Material:
    """One object's observations, by time.

    Attributes
    ----------
    astrometry, observers : the records and the places of those who made them.
    ephemeris : that placed them.
    observed : (n, 2) RA and Dec, rad, with the biases of their star catalogues taken out.
    exposures : the same as exposures, counted from the epoch of the records: telescopes are those who observed, each
        once, in the order of their first observation, their own sigma a mean one, for each record has its own weight;
        the sigma of the time is as stated, else as the file says of clocks on the ground.
    rule : (n,) where the sigma came from.
    night, thinning : (n,) number of the night of the station, and the factor in sigma for its many observations.
    notices : what a user should know about all this.
    """

    astrometry: Astrometry
    observers: Observers
    ephemeris: Ephemeris
    observed: Array
    exposures: Exposures
    rule: Texts
    night: npt.NDArray[np.int64]
    thinning: Array
    notices: tuple[str, ...]

    def __len__(self) -> int:
        """Number of observations."""
        return len(self.astrometry)

    @property
    def sigma_rad(self) -> Array:
        """Of RA cos Dec and Dec (n, 2)."""
        return self.exposures.sigma_rad

    @property
    def names(self) -> tuple[str, ...]:
        """Of those who observed, in the order of their first observation."""
        return tuple(telescope.name for telescope in self.exposures.telescopes)

    @property
    def middle(self) -> Epoch:
        """0h TDB of the day nearest to the middle of the arc: where the orbit is known best."""
        t_s = self.astrometry.t_s
        days = float(np.round((t_s.min() + t_s.max()) / 2.0 / SECONDS_PER_DAY))
        return self.astrometry.epoch + days * SECONDS_PER_DAY

    def sky(self, epoch: Epoch) -> Sky:
        """The observations as arrays, counted from an epoch, with the noise of the measurement alone."""
        return Sky.measured(self.exposures.counted_from(epoch), self.observed, self.exposures.noise())

    @property
    def has_timing(self) -> bool:
        """Whether any time is uncertain."""
        return bool(self.exposures.timing_sigma_s.any())

    @property
    def position_rows(self) -> npt.NDArray[np.int64]:
        """Records (r,) that state the covariance of the observer's place."""
        return np.flatnonzero(np.isfinite(self.astrometry.position_covariance_km2).all(axis=(1, 2)))

    def weighed(self, sky: Sky, seen: Observation) -> Sky:
        """The sky with everything in its weights that is drawn anew at each record: noise, time, stated places."""
        return sky.weighed(self.total_noise(seen)) if self.has_timing or self.position_rows.size else sky

    def lighter(self, added_rad2: Array, note: npt.NDArray[np.object_]) -> "Material":
        """The same with more variance (n, 2), RA cos Dec and Dec, and a note (n,) of why in the rule."""
        sigma = np.sqrt(self.sigma_rad**2 + added_rad2)
        made, _ = _telescopes(self.observers, sigma)
        rule = (self.rule.astype(object) + note).astype(np.str_)
        return replace(self, exposures=replace(self.exposures, sigma_rad=sigma, telescopes=made), rule=rule)

    def scaled(self, factor: Array) -> "Material":
        """The same with the sigmas of each record times a factor (n,), noted in the rule."""
        note = np.array(["" if one == 1.0 else f", sigma x {one:.3g}" for one in factor.tolist()], dtype=object)
        return self.lighter((factor[:, None] ** 2 - 1.0) * self.sigma_rad**2, note)

    def total_noise(self, seen: Observation) -> Array:
        """Covariance (n, 2, 2), rad^2, of all that is drawn anew at each record: noise, and places as stated."""
        R, places = self.exposures.noise(seen.rate), self.position_rows
        H = seen.H_z[places]
        R[places] += H @ self.astrometry.position_covariance_km2[places] @ H.transpose(0, 2, 1)
        return R


def gather(mission: FitMission) -> Astrometry:
    """Every record of the files of a fit.

    Raises
    ------
    DataError, InputError
        If a file is missing or wrong; with file and line.
    """
    paths = [mission.beside(name) if mission.path is not None else Path(name) for name in mission.fit.observations]
    return joined([read_astrometry(path) for path in paths])


def one_object(records: Astrometry, designations: Sequence[str], hint: str) -> Astrometry:
    """The records of one object, by one of its designations or by several that are to be joined.

    Raises
    ------
    InputError
        If there are several objects and none is named, or the named one is not there.
    """
    if designations:
        return records.of(*designations)
    if len(records.objects) > 1:
        listed = ", ".join(records.objects[:LISTED]) + (", ..." if len(records.objects) > LISTED else "")
        raise InputError(f"observations of {len(records.objects)} objects ({listed}), and one orbit fits one; {hint}")
    return records


def looked_at(mission: FitMission, ephemeris: Ephemeris) -> Astrometry:
    """The records a fit would use, of one object or of all there are, once everything it needs of files was tried.

    Raises
    ------
    InputError, CoverageError, DataError
        As a fit does before it looks for an orbit.
    """
    _spacecraft(mission)
    if mission.fit.weights is not None:
        with asking(mission, "fit", "weights"):
            read_rules(mission.beside(mission.fit.weights))
    records = gather(mission)
    with noting(records.notices):
        records = records.of(*mission.fit.designation) if mission.fit.designation else records
        records = dated(records, mission)
        if len(records.objects) > 1:
            return records
        require_few_steps(mission, records)
        return replace(records, notices=prepare(records, mission, ephemeris).notices)


def require_few_steps(mission: FitMission, records: Astrometry) -> None:
    """Refuse an orbit that goes round the Sun too often on its way to the records, before it is flown.

    Raises
    ------
    InputError
        By the place of the orbit in the file.
    """
    start = mission.object.orbit
    if start is None:
        return
    first, last = (records.epoch + float(t_s) for t_s in (records.t_s.min(), records.t_s.max()))
    arc = last - first
    way = abs(first + arc / 2.0 - start.epoch)
    between = "its epoch and the observations" if way > arc else "the first and the last observation"
    if text := too_often(start, max(way, arc), between):
        advice = "check the units of its elements and its epoch, or leave out observations by fit.from and fit.to"
        with asking(mission, "object", "orbit"):
            raise InputError(f"{text}; {advice}")


def prepare(records: Astrometry, mission: FitMission, ephemeris: Ephemeris) -> Material:
    """Place the observers and weigh the observations of one object.

    Raises
    ------
    InputError, CoverageError, DataError
        If a station has no place, the ephemeris does not reach, or a table cannot be used.
    """
    plan, records = mission.fit, records.by_time()
    _require_covered(records, ephemeris, mission.force_model.asteroids)
    places = telescopes(records, ephemeris, files=_spacecraft(mission))
    rules = mission.beside(plan.weights) if plan.weights is not None else None
    with asking(mission, "fit", "weights"):
        found = weights.weigh(records, rules, night_limit=plan.thins)
    found = found if rules is not None else stated_weights.kept(found, records)
    table = mission.beside(plan.debias) if plan.debias is not None else None
    with asking(mission, "fit", "debias"):
        correction, notices = debias.debias(records, table)
    sigma = found.sigma_rad if plan.noise_scale == "by_station" else plan.noise_scale * found.sigma_rad
    made, index = _telescopes(places, sigma)
    return Material(
        astrometry=records,
        observers=places,
        ephemeris=ephemeris,
        observed=offset(records.psi, -correction),
        exposures=Exposures.at(
            records.epoch,
            records.t_s,
            places.state_km_km_s,
            ephemeris,
            telescopes=made,
            telescope_index=index,
            sigma_rad=sigma,
            correlation=found.correlation,
            timing_sigma_s=_clocks(records, _ground_clocks(records, plan), found.night_count),
        ),
        rule=found.rule,
        night=found.night,
        thinning=found.thinning,
        notices=tuple(dict.fromkeys((*records.notices, *places.notices, *found.notices, *notices))),
    )


def _require_covered(records: Astrometry, ephemeris: Ephemeris, asteroids: bool) -> None:
    """Refuse an observation outside the ephemeris, by its file and line."""
    for row in (0, len(records) - 1):  # in the order of time
        try:
            ephemeris.require(records.epoch, float(records.t_s[row]), asteroids=asteroids)
        except CoverageError as error:
            error.say_place(f"{records.path[row]}:{records.line[row]}")
            raise


def _telescopes(places: Observers, sigma: Array) -> tuple[tuple[Telescope, ...], npt.NDArray[np.int64]]:
    """Telescopes, and which of them made each observation (n,)."""
    names = tuple(dict.fromkeys(places.telescope.tolist()))
    number = {name: k for k, name in enumerate(names)}
    index = np.array([number[name] for name in places.telescope.tolist()], dtype=np.int64)
    count = np.bincount(index, minlength=len(names))
    mean = np.column_stack([np.bincount(index, sigma[:, k] ** 2, len(names)) for k in range(2)]) / count[:, None]
    made = tuple(
        Telescope(name=name, spacecraft=places.spacecraft[name], sigma_rad=np.sqrt(mean[k]))
        for k, name in enumerate(names)
    )
    return made, index


def _ground_clocks(records: Astrometry, plan: FitPlan) -> Array:
    """Sigma (n,) of a clock on the ground, s; 0 by default where a source of the file says it, lest it count twice."""
    ground_s = np.full(len(records), plan.clock)
    if "clock" not in plan.model_fields_set:
        for entry in plan.uncertainty:
            if entry.timing is not None:
                ground_s[np.isin(records.station, entry.stations) | (entry.stations == "all")] = 0.0
    return ground_s


def _clocks(records: Astrometry, ground_s: Array, night_count: npt.NDArray[np.int64]) -> Array:
    """Sigma (n,) of the time: stated, else that of a clock on the ground; spacecraft and occultations keep time.

    Notes
    -----
    The weights by station and catalogue come from objects that hardly move; one that crosses an arcsecond a second
    shows the clocks as well. A clock is wrong by the same time all night: the N records of a station's night together
    weigh as one reading, sigma_t sqrt(N).
    """
    ground = ((records.centre == "") | records.roving) & (records.mode != "OCC")
    unstated = np.where(ground, ground_s * np.sqrt(night_count), 0.0)
    return np.where(np.isfinite(records.timing_sigma_s), records.timing_sigma_s, unstated)


def _spacecraft(mission: FitMission) -> Mapping[str, Spacecraft]:
    """Trajectories given for stations."""
    found = ((code, carrier_of(mission, code)) for code in mission.fit.spacecraft)
    return MappingProxyType({code: carrier for code, carrier in found if carrier is not None})


def carrier_of(mission: FitMission, code: str) -> Spacecraft | None:
    """The trajectory given for a station, if one is."""
    orbit = mission.fit.spacecraft.get(code)
    if orbit is None:
        return None
    with asking(mission, "fit", "spacecraft", code):
        return SPACECRAFT[type(orbit)](orbit, mission)
