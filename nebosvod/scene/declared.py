"""A source whose truth is declared beside what is assumed of it: one nuisance of two."""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from nebosvod.borders.treatment import Treatment
from nebosvod.observation import Common, Markov, Nuisance, Observation, Term, White
from nebosvod.observation.contracts import Ephemeris

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Declared:
    """A source as the estimators have it, and as it really is; the same partials serve both.

    Attributes
    ----------
    assumed, true : the same kind of source, with the sizes that are assumed and the true ones.
    mean : (j,) true mean of its first components; None where it is that of `true`.
    """

    assumed: Nuisance
    true: Nuisance
    mean: Array | None

    @property
    def name(self) -> str:
        """The source's name in the error budget."""
        return self.assumed.name

    @property
    def treatment(self) -> Treatment:
        """What the estimators do with it."""
        return self.assumed.treatment

    def term(self, observation: Observation, ephemeris: Ephemeris) -> Term:
        """The assumed term, with the covariances and means of the true one."""
        assumed, true = self.assumed.term(observation, ephemeris), self.true.term(observation, ephemeris)
        if isinstance(assumed, Common) and isinstance(true, Common):
            mean = true.mean if self.mean is None else _whole(self.mean, len(assumed.names))
            return replace(assumed, true_covariance=true.covariance, true_mean=mean)
        own = None if self.mean is None else _whole(self.mean, len(assumed.names))
        if isinstance(assumed, White) and isinstance(true, White):
            return replace(assumed, true_Q=true.Q, true_mean=own)
        if isinstance(assumed, Markov) and isinstance(true, Markov):
            return replace(assumed, true_F=true.F, true_Q=true.Q, true_P0=true.P0, true_mean=own)
        raise TypeError(f"{self.name}: its truth is of another kind")


def as_assumed(nuisance: Nuisance) -> Nuisance:
    """The source as the estimators have it."""
    return nuisance.assumed if isinstance(nuisance, Declared) else nuisance


def _whole(mean: Array, size: int) -> Array:
    """A mean (j,) for all components (size,): the same in each zone of the sky, none of rates and velocities."""
    if len(mean) == 2 and size > 4:  # zones, a pair each
        return np.tile(mean, size // 2)
    return np.concatenate([mean, np.zeros(size - len(mean))])
