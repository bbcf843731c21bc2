"""The answer of the first hour: from a tracklet to probabilities, orbits, sizes, the sky and the ground."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics.constants import DAY_S
from nebosvod.estimation.filters.combined import EquivalentMeasurement, equivalent_measurement
from nebosvod.first_hour.condensed import Few, condensed
from nebosvod.first_hour.conditional import Conditional
from nebosvod.first_hour.corridor import Corridor, corridor
from nebosvod.first_hour.draws import Draws
from nebosvod.first_hour.equivalent import block, wide
from nebosvod.first_hour.falls import WITHIN_D, Chance, Falls, chance, fall
from nebosvod.first_hour.grid import ENOUGH, HEADLINE, Grid
from nebosvod.first_hour.look import Field, fields_of
from nebosvod.first_hour.nights import grid_of_all
from nebosvod.first_hour.possible import next_possible
from nebosvod.first_hour.posterior import Numbers, numbers
from nebosvod.first_hour.region import Region
from nebosvod.first_hour.tracklet import Tracklet
from nebosvod.observation import Telescope
from nebosvod.timescale import Epoch

Array = npt.NDArray[np.float64]
KNOWN = 0.1  # sigma of ln(range), below which least squares may be believed as well


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Question:
    """What is asked of a tracklet.

    Attributes
    ----------
    within_d : days from the reference time in which an impact counts.
    region : which orbits count.
    seed : of the draws.
    """

    region: Region = field(default_factory=Region)
    within_d: float = WITHIN_D
    seed: int = 1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Alert:
    """The whole answer.

    Attributes
    ----------
    grid, falls : the posterior, and the orbits drawn of it with what becomes of them.
    chances, moon : probability to hit the Earth by prior, and the Moon under the headline one.
    numbers : elements and sizes of the drawn orbits.
    corridor : where they come down; None where none does.
    fields : where to look next.
    ahead : where none of the fields can be seen, who can first after the last record, and when; None: nobody.
    """

    tracklet: Tracklet
    question: Question
    grid: Grid
    falls: Falls
    chances: Mapping[str, Chance]
    moon: Chance
    numbers: Numbers
    corridor: Corridor | None
    fields: Sequence[Field]
    ahead: tuple[str, Epoch] | None = None

    @property
    def draws(self) -> Draws:
        """The drawn orbits."""
        return self.falls.draws

    @property
    def headline(self) -> Chance:
        """Under the uniform prior."""
        return self.chances[HEADLINE]

    @property
    def enough(self) -> bool:
        """Whether enough nodes carry the weight."""
        return self.grid.effective() >= ENOUGH

    @property
    def equivalent(self) -> EquivalentMeasurement:
        """What a filter takes in place of the observations: of the six coordinates, after a prior that says nothing."""
        posterior = block(self.grid)
        return equivalent_measurement(wide(posterior), posterior)

    @property
    def bounds(self) -> Array:
        """(g, 3) ln(range), least and largest range rate of the region."""
        lines = self.grid.lines
        low, high = self.question.region.rates(self.grid.conditional, lines.coordinates)
        return np.stack([lines.coordinates[:, 0], low, high], axis=1)

    @property
    def sigma_log_range(self) -> float:
        """Of ln(range)."""
        return float(np.sqrt(self.grid.moments()[1][0, 0]))


def alert(
    tracklet: Tracklet, question: Question, telescopes: Sequence[Telescope] = (), after_s: Array | None = None,
    few: Few | None = None,
) -> Alert:  # fmt: skip
    """Answer.

    Parameters
    ----------
    telescopes, after_s : who may look, and when, (n,) seconds after the last measurement.
    few : what stands for the tracklet, where that is known.

    Raises
    ------
    GeometryError
        If no orbit of the region fits.
    """
    rng = np.random.default_rng(np.random.SeedSequence(question.seed))
    few = condensed(tracklet, question.region) if few is None else few
    grid = grid_of_all(Conditional(few.tracklet), question.region)
    falls = fall(grid, question.within_d, rng)
    asked = np.empty(0) if after_s is None else float(tracklet.exposures.t_s.max()) + np.asarray(after_s)
    asked = asked[asked < question.within_d * DAY_S]
    place = corridor(tracklet, falls, rng)
    fields = fields_of(tracklet, falls, telescopes, asked, rng) if telescopes and asked.size else []
    ahead = None
    if fields and not any(one.possible.visible is not False for one in fields):
        span_s = float(tracklet.exposures.t_s.max()), question.within_d * DAY_S
        spare = np.random.default_rng(np.random.SeedSequence(question.seed, spawn_key=(9,)))
        ahead = next_possible(tracklet, falls, telescopes, span_s, spare)
    return Alert(
        tracklet=tracklet,
        question=question,
        grid=grid,
        falls=falls,
        chances={prior: chance(grid, falls, prior) for prior in grid.priors},
        moon=chance(grid, falls, HEADLINE, "moon"),
        numbers=numbers(tracklet, falls.draws),
        corridor=place,
        fields=fields,
        ahead=ahead,
    )
