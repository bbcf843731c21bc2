"""What is asked of an object, whether measurements are planned or recorded: the common part of the two files.

`Mission` (telescopes and a schedule, to be simulated) and `FitMission` (recorded observations) are brothers: both have
an object, forces, what is known beforehand, estimators and predictions, and say what is uncertain. Whatever comes after
the file asks for no more than this.
"""

import hashlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self

from pydantic import Discriminator, PrivateAttr, Tag, ValidationError

from nebosvod.borders.treatment import Treatment
from nebosvod.errors import InputError
from nebosvod.mission.covariance import COMETARY_SCALE, STATE_SCALE, Array
from nebosvod.mission.editing import as_text, as_tree, edited
from nebosvod.mission.fields import Block, KeyPath
from nebosvod.mission.found import FileOrbit
from nebosvod.mission.orbit import Representation, SbdbOrbit
from nebosvod.mission.parameter import Parameter
from nebosvod.mission.request import Estimator, ForcePlan, Prediction, Prior, internal_covariance
from nebosvod.mission.slugs import slug
from nebosvod.mission.sources import Source
from nebosvod.mission.spacecraft import TelescopeOrbit
from nebosvod.mission.target import Body, Orbit
from nebosvod.mission.yaml.inherit import resolve_like
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


class Question(Block):
    """The common part of a mission that is simulated and a fit of recorded observations."""

    kind: ClassVar[Literal["mission", "fit"]]

    if TYPE_CHECKING:  # fields of both brothers, each in the order of its own file

        @property
        def name(self) -> str: ...
        @property
        def title(self) -> str | None: ...
        @property
        def object(self) -> Body: ...
        @property
        def prior(self) -> Prior | Literal["none", "orbit"]: ...
        @property
        def estimators(self) -> tuple[Estimator, ...]: ...
        @property
        def predictions(self) -> tuple[Prediction, ...]: ...
        @property
        def force_model(self) -> ForcePlan: ...
        @property
        def reference_epoch(self) -> Epoch: ...
        @property
        def sources(self) -> tuple[Source, ...]: ...
        @property
        def input_files(self) -> tuple[Path, ...]: ...

        @property
        def given_orbits(self) -> dict[KeyPath, Orbit]: ...

        def carrier(self, telescope: str) -> TelescopeOrbit | None: ...
        def epochs(self) -> Iterable[tuple[tuple[str | int, ...], Epoch]]: ...

    _path: Path | None = PrivateAttr(default=None)
    _text: str = PrivateAttr(default="")
    _as_read: dict[str, Any] = PrivateAttr(default_factory=dict)  # the fields that `_text` says
    _read_again: Callable[[str, str, Path | None], Any] | None = PrivateAttr(default=None)

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
    def orbit(self) -> Orbit:
        """The orbit that the problem is about.

        Raises
        ------
        InputError
            If none is known yet.
        """
        if self.object.orbit is None:
            raise InputError(f"{shown(self.name)}: its orbit is not known yet")
        return self.object.orbit

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
        made = self._read_again(text, f"{self._path or shown(self.name)}, edited", self._path)
        if not isinstance(made, type(self)):
            raise InputError(f"{shown(self.name)}: fit: a mission and a fit do not change into each other")
        return made

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
    def notices(self) -> tuple[str, ...]:
        """What the files read say, and what is said and not used: a sigma of what all, and the truth, hold fixed."""
        free = {parameter.name for parameter in self.free_parameters}
        held = [p.key for p in self.parameters if p.sigma is not None and p.name not in free]
        held += [
            source.name
            for source in self.sources
            if source.error.has_sigma
            and source.shadows is None
            and all(self.source_treatment(estimator, source) == "fixed" for estimator in self.estimators)
        ]
        text = "is fixed: it has no error in this mission, in truth neither, and its sigma is not used"
        read = (getattr(one, "found", None) for one in (self.object.orbit, self.prior))
        told = [notice for found in read if found is not None for notice in found.notices]
        return (*(f"{name} {text} (ignored or considered would count it)" for name in held), *told)

    def treatment(self, estimator: Estimator, group: str) -> Treatment:
        """What an estimator does with a group of dynamic parameters (`Parameter.group`)."""
        if group in estimator.treatment:
            return as_method(estimator, estimator.treatment[group])
        return as_method(estimator, next((p.treatment for p in self.parameters if p.group == group), "fixed"))

    @staticmethod
    def source_treatment(estimator: Estimator, source: Source) -> Treatment:
        """What an estimator does with a source: its own word, the most particular one, else the mission's."""
        if source.shadows is not None:
            return "fixed" if Question.source_treatment(estimator, source.shadows) == "fixed" else "ignored"
        own = (estimator.treatment[key] for key in source.keys if key in estimator.treatment)
        treatment = next(own, source.error.treatment)
        return treatment if source.fresh else as_method(estimator, treatment)

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
