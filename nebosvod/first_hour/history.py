"""What was known after each observation: the same answer for the first two, three, ... of them."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from nebosvod.first_hour.alert import Alert, Question, alert
from nebosvod.first_hour.corridor import Corridor
from nebosvod.first_hour.falls import Chance
from nebosvod.first_hour.tracklet import Tracklet
from nebosvod.timescale import Epoch


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Moment:
    """The answer after some observations.

    Attributes
    ----------
    number, epoch : how many, and the time of the last.
    chances : by prior. effective : nodes of the grid. sigma_log_range : of ln(range). range_au : its mean.
    corridor : where orbits come down; None where none does.
    """

    number: int
    epoch: Epoch
    chances: Mapping[str, Chance]
    effective: float
    sigma_log_range: float
    range_au: float
    corridor: Corridor | None

    @classmethod
    def of(cls, found: Alert) -> "Moment":
        """A whole answer, in short."""
        tracklet = found.tracklet
        return cls(
            number=len(tracklet),
            epoch=tracklet.epoch + float(tracklet.exposures.t_s.max()),
            chances=found.chances,
            effective=found.grid.effective(),
            sigma_log_range=found.sigma_log_range,
            range_au=float(np.exp(found.grid.moments()[0][0])),
            corridor=found.corridor,
        )


def history(
    tracklet: Tracklet, question: Question, say: Callable[[str], None], most: int | None = None
) -> Iterator[Moment]:
    """The answers after two times of observation and each further one, up to all.

    Parameters
    ----------
    most : of the answers, spread evenly over the observations; all where None.
    """
    t_s = tracklet.exposures.t_s
    order = np.argsort(t_s, kind="stable")
    # after each time of observation but the first: of one time no motion is known
    counts = (np.flatnonzero(np.append(np.diff(t_s[order]) > 0.0, True)) + 1)[1:]
    if most is not None and counts.size > most:
        counts = counts[np.unique(np.linspace(0, counts.size - 1, most).round().astype(int))]
    for k in counts.tolist():
        say(f"after {k} of {len(t_s)} observations")
        yield Moment.of(alert(tracklet.select(np.sort(order[:k])), question))
