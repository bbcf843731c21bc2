"""A mission to be simulated: what its file says, in internal units, and the questions the stages ask of it.

Attributes mirror the keys of the file. Angles are rad, lengths km, times s, epochs `Epoch`; a radius is m,
a mass kg, A1..A3 au/d^2.
"""

from collections.abc import Iterable
from html import escape
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import Field

from nebosvod.borders.later import Later
from nebosvod.errors import InputError, counted, listed
from nebosvod.mission.covariance import Array
from nebosvod.mission.fields import KeyPath, Several, Text, When
from nebosvod.mission.found import files_of
from nebosvod.mission.question import DEFAULT_ESTIMATOR, SCHEMA_VERSION, PriorChoice, Question
from nebosvod.mission.request import Arc, Estimator, ForcePlan, MonteCarlo, NuisancePlan, Prediction, Prior, ReportPlan
from nebosvod.mission.sources import Shared, Source, sources
from nebosvod.mission.spacecraft import TelescopeOrbit
from nebosvod.mission.target import Orbit, Target
from nebosvod.mission.telescope import Telescope
from nebosvod.mission.yaml.inherit import MAX_TELESCOPES
from nebosvod.timescale import Epoch


class Mission(Question):
    """One mission file.

    `load_mission` reads one, `with_` changes it, `nebosvod.run` runs it; `plot.geometry()` and `plot.timeline()` show
    where everything is and what can be seen, without running it.
    """

    kind = "mission"
    plot: ClassVar[Any] = Later("nebosvod.notebook.planned", "MissionPlots")  # .geometry(), .timeline()

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

    @property
    def input_files(self) -> tuple[Path, ...]:
        """Files beside the mission file that it reads, for the record."""
        carriers = (telescope.orbit for telescope in self.telescopes)
        named = [getattr(orbit, "file", None) for orbit in (self.object.orbit, *carriers)]
        named += [self.force_model.ephemeris, getattr(self.prior, "file", None)]
        given = dict.fromkeys(name for name in named if name is not None)
        return tuple(file for name in given if self._path for file in files_of(self.beside(name)))

    @property
    def sources(self) -> tuple[Source, ...]:
        """Everything uncertain about the telescopes, in the order of the file."""
        return tuple(sources(self.telescopes, self.shared, self.object))

    @property
    def notices(self) -> tuple[str, ...]:
        """What is doubtful, and what is said and not used."""
        doubts = [f"{t.name}: {doubt}" for t in self.telescopes for doubt in getattr(t.orbit, "doubts", ())]
        return (*super().notices, *doubts)

    def __repr__(self) -> str:
        return f"<Mission {self.name}: {', '.join(f'{what} {value}' for what, value in self._facts())}>"

    __str__ = __repr__

    def _repr_html_(self) -> str:
        rows = "".join(f"<tr><th>{escape(what)}</th><td>{escape(value)}</td></tr>" for what, value in self._facts())
        return f"<p>{escape(self.title or self.name)}</p><table>{rows}</table>"

    def _facts(self) -> list[tuple[str, str]]:
        """What it is about, for who looks at it: words and values."""
        exposures = sum(len(self.times_s(one.name)) for one in self.telescopes)
        facts = [
            ("object", self.object.name),
            ("reference epoch", self.reference_epoch.iso(digits=0)),
            ("telescopes", listed([one.name for one in self.telescopes])),
            ("scheduled", counted(exposures, "exposure")),
            ("estimators", listed([one.name for one in self.estimators])),
        ]
        return [*facts, ("predictions", listed([one.name for one in self.predictions]) or "none")]

    def telescope(self, name: str) -> Telescope:
        """The telescope of a name.

        Raises
        ------
        InputError
            If there is none; names those there are.
        """
        for one in self.telescopes:
            if one.name == name:
                return one
        raise InputError(f"no telescope {name!r} (allowed: {', '.join(t.name for t in self.telescopes)})")

    @property
    def given_orbits(self) -> dict[KeyPath, Orbit]:
        """The orbits the file gives by their places in it."""
        return {("object", "orbit"): self.object.orbit}

    def carrier(self, telescope: str) -> TelescopeOrbit:
        """The orbit of the telescope of a name."""
        return self.telescope(telescope).orbit

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

    def epochs(self) -> Iterable[tuple[tuple[str | int, ...], Epoch]]:
        """Every epoch at which the ephemeris is needed, with its path in the file; predictions may lie outside."""
        yield ("reference_epoch",), self.reference_epoch
        yield ("object", "orbit", "epoch"), self.object.orbit.epoch
        for i, arc in enumerate(self.schedule):
            yield ("schedule", i, "start"), arc.start
            yield ("schedule", i, "end"), arc.end
        if isinstance(self.prior, Prior) and self.prior.epoch is not None:
            yield ("prior", "epoch"), self.prior.epoch
