"""Figures of an answer: those of its page, each as a figure of matplotlib."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from nebosvod.errors import InputError
from nebosvod.report.fit import figures as fit_figures
from nebosvod.report.kit.facts import leading
from nebosvod.report.kit.plate import Plate
from nebosvod.report.kit.standing import PageFigure, figure_of
from nebosvod.report.run import ellipses, encounters, figures, geometry, ledger, timeline, trust, viewing
from nebosvod.results.folder import Item, RunFolder

Made = Iterable[Plate | None]


class Plots:
    """Figures of an answer by name; each is a method without arguments unless it says otherwise."""

    def __init__(self, owner: str) -> None:
        self._owner = owner

    def __repr__(self) -> str:
        return f"<figures of {self._owner}: {', '.join(f'{name}()' for name in self.names)}>"

    @property
    def names(self) -> tuple[str, ...]:
        """The figures there may be."""
        return tuple(name for name in dir(type(self)) if not name.startswith("_") and name not in ("names", "every"))

    def every(self) -> dict[str, PageFigure]:
        """Every figure that this answer has, by name."""
        found = {}
        for name in self.names:
            try:
                found[name] = getattr(self, name)()
            except InputError:
                continue
        return found

    def _first(self, plates: Made, what: str) -> PageFigure:
        """The first of some figures.

        Raises
        ------
        InputError
            If there is none; says `what` is missing.
        """
        for plate in plates:
            if plate is not None:
                return figure_of(plate)
        raise InputError(f"{self._owner}: has {what}, so there is no such figure")


class RunPlots(Plots):
    """Figures of a run.

    Each raises InputError where the run does not have what it shows.
    """

    def __init__(self, owner: str, run: RunFolder, visible: Mapping[str, Sequence[Any]] | None) -> None:
        super().__init__(owner)
        self._run, self._visible = run, visible

    def budget(self) -> PageFigure:
        """Share of each source in the variance of each quantity."""
        main = self._main
        books = ledger.ledgers(self._run, main) if main else []
        return self._first([ledger.shares_plate(self._run, books)], "no orbit and no budget")

    def remedies(self) -> PageFigure:
        """Sigma of the first prediction (else of the position) if the error of one source vanished or halved."""
        main = self._main
        books = ledger.ledgers(self._run, main) if main else []
        return self._first([ledger.remedies_plate(self._run, books[0])] if books else [], "no orbit and no budget")

    def target_plane(self, prediction: str | None = None) -> PageFigure:
        """The plane of an encounter with the body to scale, drawn orbits by their fate.

        Parameters
        ----------
        prediction : its name; the first encounter by default. Other predictions have an `ellipse`.
        """
        rows = [row for row in self._predictions(prediction) if row["plane"] in ("b_plane", "mtp")]
        plates = [plate for row in rows for plate in encounters.plane_plates(self._run, row)]
        return self._first(plates, f"no prediction in a target plane ({self._named()})")

    def ellipse(self, prediction: str | None = None) -> PageFigure:
        """Ellipses of 1, 2 and 3 sigma of a prediction, true and formal; of the first that has two axes by default."""
        rows = self._predictions(prediction)
        return self._first(self._ellipses(rows), f"no prediction with two axes ({self._named()})")

    def ground(self, prediction: str | None = None, near: bool = False) -> PageFigure:
        """A map of where the orbit comes down.

        Parameters
        ----------
        prediction : its name; the first entry by default.
        near : its neighbourhood, with the ellipse, instead of the world.
        """
        rows = [row for row in self._predictions(prediction) if row["plane"] == "entry"]
        plates = [plate for row in rows for plate in encounters.entry_plates(self._run, row)]
        wanted = [plate for plate in plates if plate.key.endswith("-near") == near]
        missing = "a place of entry as large as a map of the world" if plates and near else "no prediction of an entry"
        return self._first(wanted, missing)

    def geometry(self) -> PageFigure:
        """Sun, Earth, telescopes and the asteroid, seen from the north of the ecliptic."""
        return self._first([geometry.geometry_plate(self._run)], "no measurement")

    def viewing(self) -> PageFigure:
        """Distance and angle from the Sun at each measurement."""
        return self._first([viewing.viewing(self._run)], "no two measurements")

    def timeline(self) -> PageFigure:
        """Every scheduled epoch of each telescope: seen, or lost and why; below, the brightness."""
        return self._first([timeline.timeline_plate(self._run, self._visible)], "no schedule of two epochs")

    def residuals(self) -> PageFigure:
        """Residuals after the fit by telescope, over time."""
        main = self._main
        return self._first([figures.residuals(self._run, main)] if main else [], "no orbit")

    def history(self) -> PageFigure:
        """Position sigma after each measurement."""
        return self._first([figures.sigma_over_time(self._run)], "no history of sigmas")

    def noise_to_nuisance(self) -> PageFigure:
        """Noise of each measurement against its nuisances, decibels."""
        return self._first([figures.noise_to_nuisance(self._run)], "no nuisances")

    def accuracies(self) -> PageFigure:
        """Formal, true, guaranteed, worst and drawn accuracy of each prediction side by side."""
        main = self._main
        return self._first([trust.comparison_plate(self._run, main)] if main else [], "no predictions to compare")

    @property
    def _main(self) -> Item | None:
        return self._run.main

    def _predictions(self, name: str | None) -> list[Item]:
        """Predictions of the main estimator, or the one of a name.

        Raises
        ------
        InputError
            If there is none of that name.
        """
        rows = leading(self._run, self._main) if self._main else []
        if name is None:
            return rows
        chosen = [row for row in rows if row["name"] == name]
        if not chosen:
            raise InputError(f"{self._owner}: has no prediction {name!r} ({self._named()})")
        return chosen

    def _named(self) -> str:
        names = ", ".join(f"{row['name']} ({row['plane']})" for row in self._predictions(None))
        return f"predictions: {names or 'none'}"

    def _ellipses(self, rows: list[Item]) -> Iterable[Plate | None]:
        return (ellipses.ellipse_plate(row, ellipses.drawn_orbits(self._run, row)) for row in rows)


class FitPlots(RunPlots):
    """Figures of a fit to real observations."""

    @property
    def _main(self) -> Item | None:
        return self._run.estimators[0] if self._run.summary["orbit"] is not None else None

    def residuals(self) -> PageFigure:
        """Residuals in RA cos Dec and Dec over time, rejected ones apart."""
        return self._first(fit_figures.residual_plates(self._run), "no residuals")

    def stations(self) -> PageFigure:
        """How well each station measured."""
        return self._first(
            [fit_figures.station_plate(list(self._run.summary["fit"]["stations"]))], "no two stations to compare"
        )

    def correlation(self) -> PageFigure:
        """Correlations of the orbital elements."""
        orbit = self._run.summary["orbit"]
        known = orbit is not None and orbit["elements"] is not None
        return self._first([fit_figures.correlation_plate(orbit["elements"])] if known else [], "no orbital elements")


# names that answers share -> how those of their figures begin
FIRST = {"target_plane": ("target", "plane"), "budget": ("budget", "shares", "blame")}


class PagePlots(Plots):
    """Figures of another answer: those of its page, by their names."""

    def __init__(self, owner: str, plates: Sequence[Plate]) -> None:
        super().__init__(owner)
        self._plates = {plate.key.replace("-", "_"): plate for plate in plates}

    @property
    def names(self) -> tuple[str, ...]:
        """The figures there are."""
        return tuple(self._plates)

    def __dir__(self) -> list[str]:
        """What Tab offers: figures that there are, not every one that another answer has."""
        absent = {name for name, words in FIRST.items() if not self._beginning(words)}
        return [name for name in {*super().__dir__(), *self._plates} if name not in absent]

    def __getattr__(self, name: str) -> Callable[[], PageFigure]:
        plates: Mapping[str, Plate] = self.__dict__.get("_plates", {})
        if name not in plates:
            raise AttributeError(f"no figure {name!r}; there are: {', '.join(plates) or 'none'}")
        return lambda: figure_of(plates[name])

    def _of(self, *beginnings: str) -> PageFigure:
        """The first figure whose name begins with one of some words."""
        for plate in self._beginning(beginnings):
            return figure_of(plate)
        raise InputError(f"{self._owner}: has no such figure (there are: {', '.join(self._plates) or 'none'})")

    def _beginning(self, beginnings: tuple[str, ...]) -> list[Plate]:
        return [plate for name, plate in self._plates.items() if name.startswith(beginnings)]

    def target_plane(self) -> PageFigure:
        """The target plane of the first encounter, with the body to scale."""
        return self._of(*FIRST["target_plane"])

    def budget(self) -> PageFigure:
        """What each source contributes."""
        return self._of(*FIRST["budget"])


def texts(columns: Mapping[str, npt.NDArray[Any]]) -> Mapping[str, Sequence[str]]:
    """Columns as the text that a file of them holds."""
    return {name: [str(value) for value in np.asarray(column).tolist()] for name, column in columns.items()}
