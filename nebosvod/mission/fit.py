"""A file for `nebosvod fit`: real observations in place of telescopes and a schedule."""

from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, PrivateAttr

from nebosvod.errors import InputError
from nebosvod.mission.bias import Bias
from nebosvod.mission.covariance import Array, Matrix
from nebosvod.mission.fields import (
    Block,
    Duration,
    KeyPath,
    ObservationTime,
    Parsed,
    PositiveNumber,
    Several,
    Text,
    When,
    line_of_text,
)
from nebosvod.mission.found import STATE_LABELS, FileOrbit, files_of
from nebosvod.mission.orbit import Frame, SbdbOrbit, StateOrbit
from nebosvod.mission.parameter import LOGARITHMS
from nebosvod.mission.position import Position
from nebosvod.mission.question import DEFAULT_ESTIMATOR, SCHEMA_VERSION, CovariancePrior, PriorChoice, Question
from nebosvod.mission.request import (
    Estimator,
    ForcePlan,
    Prediction,
    Prior,
    ReportPlan,
    TelescopeNames,
    internal_covariance,
    scales,
)
from nebosvod.mission.sources import KINDS, Source, of_object
from nebosvod.mission.spacecraft import OemFile, Spk, Tabulated
from nebosvod.mission.target import Body, Orbit
from nebosvod.mission.uncertainty import Error, Group, Timing
from nebosvod.timescale import Epoch

Complaint = tuple[KeyPath, str]
MAX_FILES = 1000
NIGHT_LIMIT = 4  # that of observation.weights, which is too heavy to be loaded for it
MAX_NAMES = 100
J2000 = "2000-01-01T12:00:00 TDB"
TITLES: dict[str, str] = {"bias": "bias", "position": "telescope position", "timing": "timing"}


def _state_orbit(epoch: Epoch, state: Array) -> StateOrbit:
    """An orbit from numbers in internal units, which the fields would want as text with units."""
    numbers = tuple(np.asarray(state).tolist())
    return StateOrbit.model_construct(
        kind="state", frame="icrf", epoch=epoch, position=numbers[:3], velocity=numbers[3:]
    )


class FitObject(Body):
    """The object of a fit: everything about it may be left to the observations."""

    name: Text = "object"
    orbit: Orbit | None = Field(None, description="A start; found from the observations when absent")


class StationUncertainty(Block):
    """One kind of error of some stations: of each its own, or one that all of them share."""

    stations: TelescopeNames = "all"
    shared: Text | None = Field(None, description="Name of the one source they share; each has its own when absent")
    bias: Bias | None = None
    position: Position | None = None
    timing: Timing | None = None

    def complaints(self) -> list[Complaint]:
        """Exactly one kind; a fresh draw at every exposure cannot be shared."""
        said = [kind for kind in KINDS if getattr(self, kind) is not None]
        if len(said) != 1:
            got = f"got {' and '.join(said)}" if said else "got none"
            return [((), f"needs exactly one of bias, position, timing ({got}); write one entry for each")]
        if self.shared and self.position is not None and self.position.correlation in ("white", "orbit_error"):
            text = f"{self.position.correlation} errors cannot be shared by stations; use constant or gauss_markov"
            return [(("position", "correlation"), text)]
        return []

    @property
    def group(self) -> Group:
        """The kind."""
        return next(kind for kind in KINDS if getattr(self, kind) is not None)

    @property
    def error(self) -> Error:
        """The block of the kind."""
        error: Error = getattr(self, self.group)
        return error


def _designations(value: Any) -> tuple[str, ...]:
    """One designation, or a list of several of one object; numbers need no quotes."""
    several = value if isinstance(value, list) else [value]
    if not several or len(several) > MAX_NAMES:
        raise InputError(f"needs a designation, or a list of 1 to {MAX_NAMES} of one object (got {len(several)})")
    whole = [str(one) if isinstance(one, int) and not isinstance(one, bool) else one for one in several]
    return tuple(line_of_text(one) for one in whole)


Designations = Annotated[
    tuple[str, ...],
    Parsed(
        _designations,
        {"anyOf": [{"type": ["string", "integer"]}, {"type": "array", "items": {"type": ["string", "integer"]}}]},
    ),
]


class Rejection(Block):
    """When an observation is left out, in chi squared of its two components (Carpino et al. 2003)."""

    enabled: bool = True
    reject: Annotated[float, Field(gt=0.0, le=1e6, description="Left out above this")] = 8.0
    recover: Annotated[float, Field(gt=0.0, le=1e6, description="Taken back below this")] = 7.0
    fraction: Annotated[float, Field(ge=0.0, lt=1.0, description="Of the largest: only those above go at once")] = 0.25
    fudge: Annotated[float, Field(ge=0.0, le=1e9, description="More for few observations: fudge / 1.2^n")] = 400.0

    def complaints(self) -> list[Complaint]:
        """Nothing goes to and fro."""
        if self.recover > self.reject:
            return [(("recover",), f"must not exceed reject (got {self.recover:g}; reject {self.reject:g})")]
        return []


class SharedErrors(Block):
    """What happens to a station whose records share an error that their weights do not know."""

    treatment: Literal["lighter", "told", "off"] | None = Field(
        None,
        description="lighter: it weighs as one record of that size; told: its weight stays; off: nobody asks. "
        "lighter if absent, told where rejection is off",
    )


class Reference(Block):
    """An orbit to compare with, in sigmas; its covariance too, where it has one."""

    name: Text = "reference"
    orbit: Orbit
    covariance: Matrix | None = Field(None, description="Of the orbit; kinds sbdb and file bring their own")
    names: Several[str] | None = Field(None, description="Of its rows: e q tp node peri i, or x y z vx vy vz")
    frame: Frame | None = None

    def complaints(self) -> list[Complaint]:
        """Names fit the matrix."""
        if (self.covariance is None) != (self.names is None):
            return [(("names",), "covariance and names go together")]
        if self.covariance is None or self.names is None:
            return []
        try:
            scales(self.names, len(self.covariance))
        except InputError as error:
            return [(("names",), str(error))]
        return []

    @property
    def joint(self) -> CovariancePrior | None:
        """The covariance of elements or state in internal units, if there is one."""
        names, matrix, frame = self.names, self.covariance, self.frame
        if isinstance(self.orbit, FileOrbit) and matrix is None:
            found = self.orbit.read
            return CovariancePrior(
                names=STATE_LABELS, covariance=found.factor[:6] @ found.factor[:6].T, epoch=found.epoch,
                representation="state", frame="icrf",
            )  # fmt: skip
        if isinstance(self.orbit, SbdbOrbit) and matrix is None:
            names, matrix, frame = self.orbit.covariance.labels, self.orbit.covariance.data, self.orbit.frame
        if names is None or matrix is None:
            return None
        keep = tuple(name for name in names if name not in ("A1", "A2", "A3"))
        return CovariancePrior(
            names=keep,
            covariance=internal_covariance(names, matrix, keep),
            epoch=self.orbit.epoch,
            representation="state" if "x" in names else "cometary",
            frame=frame or ("icrf" if "x" in names else "ecliptic_j2000"),
        )


StationOrbit = Annotated[Tabulated | Spk | OemFile, Field(discriminator="kind")]


class FitPlan(Block):
    """Which observations, what they weigh, what is uncertain beside their noise, and what is asked."""

    observations: Annotated[Several[Text], Field(min_length=1, max_length=MAX_FILES, description="Files beside it")]
    designation: Designations = Field((), description="Of the object, where the files hold several; or all its names")
    since: ObservationTime | None = Field(None, alias="from", description="Earlier observations are left out")
    until: ObservationTime | None = Field(None, alias="to", description="Those at this time and later are left out")
    weights: Text | None = Field(None, description="A table of weight rules that come before the built-in ones")
    debias: Text | None = Field(None, description="The table of star-catalogue biases (Eggl et al. 2020)")
    rejection: Rejection = Rejection()
    shared_errors: SharedErrors = SharedErrors()
    night_limit: Annotated[int, Field(ge=1, le=100000)] | Literal["off"] | None = Field(
        None,
        description="Records of one station in one night that weigh as independent; off: all. 4 if absent, off for "
        "stations of which uncertainty names a bias that is estimated or considered",
    )
    uncertainty: Annotated[Several[StationUncertainty], Field(max_length=1000)] = ()
    spacecraft: dict[Text, StationOrbit] = Field(default_factory=dict, description="Trajectories, by station")
    epoch: When | None = Field(None, description="Of the answer; 0h TDB amid the observations when absent")
    epochs: Annotated[Several[When], Field(max_length=1000, description="More epochs for the table of states")] = ()
    iterations: Annotated[int, Field(ge=1, le=200, description="Cap of Gauss-Newton iterations")] = 30
    clock: Duration = Field(
        1.0, description="Sigma of the time of records on the ground that state none; 1 s if absent"
    )
    noise_scale: PositiveNumber | Literal["by_station"] = Field(
        1.0,
        description="Factor on every sigma of the observations; by_station: one of each station's own, as the "
        "residuals have it",
    )
    reference: Reference | None = None

    @property
    def of_shared_errors(self) -> str:
        """What happens to a station with a shared error; with rejection off its weight stays."""
        return self.shared_errors.treatment or ("lighter" if self.rejection.enabled else "told")

    def thins(self, station: str) -> int | None:
        """How many records of a night of a station weigh as independent; None where all do."""
        if self.night_limit is not None:
            return None if self.night_limit == "off" else self.night_limit
        named = (
            entry.bias is not None
            and entry.bias.treatment in ("estimated", "considered")
            and (entry.stations == "all" or station in entry.stations)
            for entry in self.uncertainty
        )
        return None if any(named) else NIGHT_LIMIT

    def complaints(self) -> list[Complaint]:
        """The dates leave room between them."""
        text = empty_interval(self.since, self.until)
        return [(("to",), text)] if text else []


def empty_interval(since: Epoch | None, until: Epoch | None) -> str:
    """What is wrong with the dates of observations to use; empty where nothing is."""
    if since is None or until is None or since < until:
        return ""
    return f"must come after from (got to {until.iso('utc', 0)}; from {since.iso('utc', 0)}); exchange or remove them"


class FitMission(Question):
    """One file for `nebosvod fit`, or the same made from a command line."""

    kind = "fit"

    schema_version: Annotated[int, Field(ge=1, le=SCHEMA_VERSION)]
    name: Text
    title: Text | None = None
    object: FitObject = Field(default_factory=FitObject)
    prior: PriorChoice = "none"
    predictions: Annotated[Several[Prediction], Field(max_length=1000)] = ()
    force_model: ForcePlan = ForcePlan()
    report: ReportPlan = ReportPlan()
    fit: FitPlan

    _stations: tuple[str, ...] = PrivateAttr(default=())
    _epoch: Epoch | None = PrivateAttr(default=None)
    _found: StateOrbit | None = PrivateAttr(default=None)

    def complaints(self) -> list[Complaint]:
        """A prior orbit must be given, and errors are those that recorded observations can have."""
        found: list[Complaint] = []
        if self.prior == "orbit" and self.object.orbit is None:
            found.append((("prior",), "orbit means the covariance that came with object.orbit, and there is none"))
        found += [
            (("object", parameter.key, "distribution"), "lognormal is for missions that are simulated; use normal here")
            for parameter in self.object.parameters
            if parameter.name in LOGARITHMS
        ]
        shared = [entry.shared for entry in self.fit.uncertainty if entry.shared]
        if len(set(shared)) != len(shared):
            found.append((("fit", "uncertainty"), "two entries share one name; give each its own"))
        return found

    @property
    def reference_epoch(self) -> Epoch:
        """Epoch of the state: that of the fit (`of`); J2000 stands for it until the records are read."""
        return self._epoch if self._epoch is not None else Epoch.parse(J2000)

    @property
    def estimators(self) -> tuple[Estimator, ...]:
        """The one estimator of a fit."""
        return (DEFAULT_ESTIMATOR.model_copy(update={"iterations": self.fit.iterations}),)

    def of(self, designation: str, stations: tuple[str, ...], epoch: Epoch, state: Array) -> "FitMission":
        """The same for one object seen by these telescopes, with an orbit found: its heliocentric ICRF state (6,)."""
        name = designation if "name" not in self.object.model_fields_set else self.object.name
        made = self.standing_for(object=self.object.model_copy(update={"name": name}))
        made._stations, made._epoch, made._found = stations, epoch, _state_orbit(epoch, state)
        return made

    @property
    def orbit(self) -> Orbit:
        """The orbit found (`of`), else the one given, whose forces and covariance count all the same."""
        return super().orbit if self._found is None else self._found

    @property
    def sources(self) -> tuple[Source, ...]:
        """What the file says is uncertain about the stations that observed, and about what they saw."""
        found = []
        for i, entry in enumerate(self.fit.uncertainty):
            whom = tuple(name for name in self._stations if entry.stations == "all" or plain(name) in entry.stations)
            path = ("fit", "uncertainty", i, entry.group)
            groups = [(entry.shared, whom)] if entry.shared else [(None, (name,)) for name in whom]
            for shared, names in groups:
                if names:
                    title = shared or f"{_title(entry)} {names[0]}"
                    found.append(
                        Source(
                            name=title,
                            group=entry.group,
                            keys=(title, entry.group),
                            telescopes=names,
                            error=entry.error,
                            path=path,
                        )
                    )
        return (*found, *of_object(self.object, self._stations))

    def carrier(self, telescope: str) -> StationOrbit | None:
        """The trajectory given for the station of a telescope, if one is."""
        return self.fit.spacecraft.get(plain(telescope))

    @property
    def given_orbits(self) -> dict[KeyPath, Orbit]:
        """The orbits the file gives, to start from and to compare with, by their places in it."""
        start, reference = self.object.orbit, self.fit.reference
        given: dict[KeyPath, Orbit] = {} if start is None else {("object", "orbit"): start}
        return given if reference is None else given | {("fit", "reference", "orbit"): reference.orbit}

    @property
    def input_files(self) -> tuple[Path, ...]:
        """Files beside this one that it reads, for the record."""
        named = [*self.fit.observations, self.fit.weights, self.fit.debias, self.force_model.ephemeris]
        named += [orbit.file for orbit in self.fit.spacecraft.values()]
        named += [getattr(orbit, "file", None) for orbit in (*self.given_orbits.values(), self.prior)]
        there = (self.beside(name) for name in dict.fromkeys(named) if name is not None)
        return tuple(file for path in there for file in files_of(path))

    def epochs(self) -> Iterable[tuple[KeyPath, Epoch]]:
        """Every epoch at which the ephemeris is needed, with its path in the file; predictions may lie outside."""
        for path, orbit in self.given_orbits.items():
            yield (*path, "epoch"), orbit.epoch
        if self.fit.epoch is not None:
            yield ("fit", "epoch"), self.fit.epoch
        for i, epoch in enumerate(self.fit.epochs):
            yield ("fit", "epochs", i), epoch
        if isinstance(self.prior, Prior) and self.prior.epoch is not None:
            yield ("prior", "epoch"), self.prior.epoch


def plain(telescope: str) -> str:
    """The station of a telescope; several places of one station at one time are told apart as "247", "247/2"."""
    return telescope.partition("/")[0]


def _title(entry: StationUncertainty) -> str:
    if isinstance(entry.error, Position) and entry.error.correlation == "orbit_error":
        return "orbit error"
    return TITLES[entry.group]
