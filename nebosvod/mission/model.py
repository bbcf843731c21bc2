"""The whole mission: what a file says, in internal units, and the questions the stages ask of it.

Attributes mirror the keys of the file. Angles are rad, lengths km, times s, epochs `Epoch`; a radius is m,
a mass kg, A1..A3 au/d^2.
"""

import hashlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Discriminator, Field, PrivateAttr, Tag, ValidationError

from nebosvod.borders.treatment import Treatment
from nebosvod.errors import InputError
from nebosvod.mission.covariance import COMETARY_SCALE, STATE_SCALE, Array
from nebosvod.mission.editing import as_text, as_tree, edited
from nebosvod.mission.fields import Block, Several, Text, When
from nebosvod.mission.found import FileOrbit, files_of
from nebosvod.mission.orbit import Representation, SbdbOrbit
from nebosvod.mission.request import (
    Arc,
    Estimator,
    ForcePlan,
    MonteCarlo,
    NuisancePlan,
    Prediction,
    Prior,
    ReportPlan,
    internal_covariance,
)
from nebosvod.mission.slugs import slug
from nebosvod.mission.sources import Shared, Source, sources
from nebosvod.mission.target import Parameter, Target
from nebosvod.mission.telescope import Telescope
from nebosvod.mission.yaml.inherit import MAX_TELESCOPES, resolve_like
from nebosvod.mission.yaml.yamlfile import parse_yaml, shown
from nebosvod.timescale import Epoch

SCHEMA_VERSION = 1
PriorChoice = Annotated[
    Annotated[Prior, Tag("block")] | Annotated[Literal["none", "orbit"], Tag("word")],
    Discriminator(lambda value: "block" if isinstance(value, dict | Prior) else "word"),
]
DEFAULT_ESTIMATOR = Estimator(name="batch", method="batch_qr")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CovariancePrior:
    """A covariance of the orbit, possibly joint with A1..A3, in internal units.

    Attributes
    ----------
    names : of rows and columns: e q tp node peri i (cometary) or x y z vx vy vz (state), and A1 A2 A3.
    covariance : (k, k); km, s, rad; km/s; au/d^2. Symmetric positive definite.
    epoch : when the elements or the state are meant.
    representation : "cometary" or "state".
    frame : axes of the elements or of the state.
    """

    names: tuple[str, ...]
    covariance: Array
    epoch: Epoch
    representation: Representation
    frame: Literal["ecliptic_j2000", "icrf"]


def _of_file(source: FileOrbit | Prior) -> CovariancePrior:
    """The covariance of an orbit file."""
    found = source.read
    return CovariancePrior(
        names=found.labels, covariance=found.factor @ found.factor.T, epoch=found.epoch, representation="state",
        frame="icrf",
    )  # fmt: skip


def as_method(estimator: Estimator, treatment: Treatment) -> Treatment:
    """What a method makes of a treatment: the filter as printed estimates the state alone and considers the rest."""
    return "considered" if estimator.method == "as_printed" and treatment == "estimated" else treatment


class Mission(Block):
    """One mission file."""

    schema_version: Annotated[int, Field(ge=1, le=SCHEMA_VERSION)]
    name: Text
    title: Text | None = None
    reference_epoch: When = Field(description="Epoch of the estimated state")
    object: Target
    telescopes: Annotated[Several[Telescope], Field(min_length=1, max_length=MAX_TELESCOPES)]
    shared: Annotated[Several[Shared], Field(max_length=MAX_TELESCOPES)] = ()
    schedule: Annotated[Several[Arc], Field(min_length=1, max_length=1000)]
    prior: PriorChoice = "none"
    estimators: Annotated[Several[Estimator], Field(min_length=1, max_length=100)] = (DEFAULT_ESTIMATOR,)
    predictions: Annotated[Several[Prediction], Field(max_length=1000)] = ()
    monte_carlo: MonteCarlo | None = None
    noise_to_nuisance: NuisancePlan = NuisancePlan()
    force_model: ForcePlan = ForcePlan()
    report: ReportPlan = ReportPlan()

    _path: Path | None = PrivateAttr(default=None)
    _text: str = PrivateAttr(default="")
    _as_read: dict[str, Any] = PrivateAttr(default_factory=dict)  # the fields that `_text` says
    _read_again: Callable[[str, str, Path | None], Self] | None = PrivateAttr(default=None)

    @property
    def path(self) -> Path | None:
        """The file it came from; None for text."""
        return self._path

    @property
    def was_read(self) -> bool:
        """Whether it came from a file or text; a mission that Python or a command line made did not."""
        return self._read_again is not None

    @property
    def ephemeris_path(self) -> Path | None:
        """The ephemeris file the mission asks for, beside it; None = the one that is found."""
        if self.force_model.ephemeris is None or self._path is None:
            return None
        return (self._path.parent / self.force_model.ephemeris).resolve()

    @property
    def input_files(self) -> tuple[Path, ...]:
        """Files beside the mission file that it reads, for the record."""
        carriers = (telescope.orbit for telescope in self.telescopes)
        named = [getattr(orbit, "file", None) for orbit in (self.object.orbit, *carriers)]
        named += [self.force_model.ephemeris, getattr(self.prior, "file", None)]
        given = dict.fromkeys(name for name in named if name is not None)
        return tuple(file for name in given if self._path for file in files_of(self.beside(name)))

    def beside(self, name: str) -> Path:
        """The path of a file named in the mission, relative to the mission's own."""
        folder = self._path.parent if self._path is not None else Path()
        return (folder / name).resolve()

    @property
    def text(self) -> str:
        """The text it came from; of a mission made or changed in Python the text of a file that would say the same."""
        same = self._as_read and all(self.__dict__[key] is value for key, value in self._as_read.items())
        return self._text if same else as_text(as_tree(self))

    @property
    def sha256(self) -> str:
        """Of the text."""
        return hashlib.sha256(self.text.encode("utf-8")).hexdigest()

    def with_(self, path: str | Sequence[str | int] | Mapping[str, Any], value: Any = None) -> Self:
        """The mission with another value at one place, or at several, checked as a file is.

        Parameters
        ----------
        path : keys as in the file joined by points, or a sequence of keys; in a list an index, the name of an element,
            or `*` for all: `telescopes.*.noise.sigma`, `predictions.encounter.near`. Or a mapping of several paths to
            their values, which are changed together and checked once.
        value : as the file would say it ("0.05 arcsec", 20, a block as a dict), an astropy Quantity or Time, a datetime
            with a zone; None leaves the key out.

        Raises
        ------
        InputError
            If the path leads nowhere, or the mission would be refused as a file; the message names the path.
        """
        tree, _, _ = resolve_like(parse_yaml(self.text, self.name))
        if isinstance(tree, dict) and isinstance(tree.get("telescopes"), list):
            rows = tree["telescopes"]
            tree = {**tree, "telescopes": [{k: v for k, v in row.items() if k != "like"} for row in rows]}  # type: ignore[union-attr]
        for one, new in path.items() if isinstance(path, Mapping) else [(path, value)]:
            tree = edited(tree, one, new)
        return self._again(as_text(tree))

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """A copy; with changed fields it is checked as a file is, and its text says what it holds."""
        made = super().model_copy(update=update, deep=deep)
        if deep and not update and self.text is self._text:  # its values are other objects that say the same
            made._as_read = {key: made.__dict__[key] for key in self._as_read}
        return made._again(made.text) if update else made

    def standing_for(self, **fields: Any) -> Self:
        """A copy with other fields that keeps the text of this one: for values the program finds, not the user."""
        made = super().model_copy(update=fields)
        made._text, made._as_read = self.text, dict(made.__dict__)
        return made

    def _again(self, text: str) -> Self:
        """The mission that a text says, beside the same files."""
        if self._read_again is None:
            try:
                made = type(self).model_validate(parse_yaml(text, self.name).tree)
            except ValidationError as error:
                raise InputError(f"{shown(self.name)}: {error}") from None
            made._path = self._path
            return made
        return self._read_again(text, f"{self._path or shown(self.name)}, edited", self._path)

    @property
    def slug(self) -> str:
        """The name as a safe file name."""
        return slug(self.name)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Every dynamic parameter that acts, fixed ones included.

        With `prior: orbit`, A1..A3 that came with the orbit are estimated: the covariance is joint with them.
        """
        joint = self.prior == "orbit"
        orbit = self.object.orbit
        known = orbit.labels if isinstance(orbit, FileOrbit) else None  # others may have come without a covariance
        return tuple(
            replace(p, treatment="estimated")
            if joint and p.origin == "orbit" and (known is None or p.group in known)
            else p
            for p in self.object.parameters
        )

    @property
    def free_parameters(self) -> tuple[Parameter, ...]:
        """Parameters that at least one estimator does not hold fixed: the columns of zeta."""
        return tuple(p for p in self.parameters if any(self.treatment(e, p.group) != "fixed" for e in self.estimators))

    @property
    def sources(self) -> tuple[Source, ...]:
        """Everything uncertain about the telescopes, in the order of the file."""
        return tuple(sources(self.telescopes, self.shared, self.object))

    @property
    def notices(self) -> tuple[str, ...]:
        """What is doubtful, and what is said and not used: a sigma of something that all, and the truth, hold fixed."""
        free = {parameter.name for parameter in self.free_parameters}
        held = [p.key for p in self.parameters if p.sigma is not None and p.name not in free]
        held += [
            source.name
            for source in self.sources
            if source.error.has_sigma
            and all(self.source_treatment(estimator, source) == "fixed" for estimator in self.estimators)
        ]
        text = "is fixed: it has no error in this mission, in truth neither, and its sigma is not used"
        read = (getattr(one, "found", None) for one in (self.object.orbit, self.prior))
        told = [notice for found in read if found is not None for notice in found.notices]
        doubts = [f"{t.name}: {doubt}" for t in self.telescopes for doubt in getattr(t.orbit, "doubts", ())]
        return (*(f"{name} {text} (ignored or considered would count it)" for name in held), *told, *doubts)

    def treatment(self, estimator: Estimator, group: str) -> Treatment:
        """What an estimator does with a group of dynamic parameters (`Parameter.group`)."""
        if group in estimator.treatment:
            return as_method(estimator, estimator.treatment[group])
        return as_method(estimator, next((p.treatment for p in self.parameters if p.group == group), "fixed"))

    @staticmethod
    def source_treatment(estimator: Estimator, source: Source) -> Treatment:
        """What an estimator does with a source: its own word, the most particular one, else the mission's."""
        own = (estimator.treatment[key] for key in source.keys if key in estimator.treatment)
        treatment = next(own, source.error.treatment)
        return treatment if source.fresh else as_method(estimator, treatment)

    def telescope(self, name: str) -> Telescope:
        """The telescope of a name."""
        return next(t for t in self.telescopes if t.name == name)

    def times_s(self, telescope: str, arc: int | None = None) -> Array:
        """Scheduled epochs (n,) of a telescope: TDB seconds after the reference epoch, ascending, each once.

        Parameters
        ----------
        arc : number of one arc of the schedule; all of them when absent.
        """
        parts = [
            (one.start - self.reference_epoch) + one.after_start_s()
            for one in (self.schedule if arc is None else self.schedule[arc : arc + 1])
            if one.telescopes == "all" or telescope in one.telescopes
        ]
        return np.unique(np.round(np.concatenate(parts), 6)) if parts else np.zeros(0)

    @property
    def covariance_prior(self) -> CovariancePrior | None:
        """The prior as a covariance, from `prior.covariance` or, for the prior `orbit`, from the SBDB block."""
        if isinstance(self.prior, str):
            orbit = self.object.orbit
            if self.prior == "orbit" and isinstance(orbit, FileOrbit):
                return _of_file(orbit)
            if self.prior == "none" or not isinstance(orbit, SbdbOrbit):
                return None
            names, matrix, epoch = orbit.covariance.labels, orbit.covariance.data, orbit.epoch
            frame = orbit.frame
        elif self.prior.file is not None:
            return _of_file(self.prior)
        elif self.prior.covariance is None or self.prior.names is None:
            return None
        else:
            names, matrix, epoch = self.prior.names, self.prior.covariance, self.prior.epoch or self.reference_epoch
            frame = self.prior.frame or ("icrf" if "x" in self.prior.names else "ecliptic_j2000")
        return CovariancePrior(
            names=names,
            covariance=internal_covariance(names, matrix, names),
            epoch=epoch,
            representation="state" if "x" in names else "cometary",
            frame=frame,
        )

    @property
    def joint_parameters(self) -> tuple[str, ...]:
        """Names among A1, A2, A3 that the prior's covariance contains."""
        prior = self.covariance_prior
        return tuple(n for n in prior.names if n not in COMETARY_SCALE | STATE_SCALE) if prior else ()

    def epochs(self) -> Iterable[tuple[tuple[str | int, ...], Epoch]]:
        """Every epoch at which the ephemeris is needed, with its path in the file; predictions may lie outside."""
        yield ("reference_epoch",), self.reference_epoch
        yield ("object", "orbit", "epoch"), self.object.orbit.epoch
        for i, arc in enumerate(self.schedule):
            yield ("schedule", i, "start"), arc.start
            yield ("schedule", i, "end"), arc.end
        if isinstance(self.prior, Prior) and self.prior.epoch is not None:
            yield ("prior", "epoch"), self.prior.epoch
