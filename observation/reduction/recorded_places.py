"""A telescope whose places are known at the times of its records, wherever they came from."""

from dataclasses import dataclass

import numpy as np

from nebosvod.errors import CoverageError
from nebosvod.observation.contracts import Array, Ephemeris
from nebosvod.observation.spacecraft.kinds import Spacecraft
from nebosvod.timescale import Epoch

SAME_S = 5e-6  # the grain of a century in seconds is 5e-7; the observer moves by 0.2 m/s * this: 0.15 mm
LISTED = 3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RecordedPlaces:
    """Barycentric states at certain times, exact there; any other time is asked of `carrier`.

    Parameters
    ----------
    name : of the telescope, for messages.
    centre : "earth" or "sun", whose direction defines the radial axis.
    epoch, t_s : reference epoch and ascending times (k,), TDB seconds after it.
    states : shape (k, 6), barycentric ICRF, km and km/s, by the ephemeris the observers were made with.
    carrier : answers at times between the records, for a site or a trajectory file; None for a telescope that is known
        by its records alone.
    """

    name: str
    centre: str
    epoch: Epoch
    t_s: Array
    states: Array
    carrier: Spacecraft | None = None

    def state_km_km_s(self, ephemeris: Ephemeris, epoch: Epoch, t_s: Array) -> Array:
        """Barycentric ICRF states (n, 6).

        Raises
        ------
        CoverageError
            If a time is not that of a record and there is no carrier.
        """
        local = np.asarray(t_s, dtype=np.float64) + (epoch - self.epoch)
        after = np.clip(np.searchsorted(self.t_s, local), 1, self.t_s.size - 1) if self.t_s.size > 1 else 0
        before = np.maximum(np.asarray(after) - 1, 0)
        nearest = np.where(np.abs(self.t_s[before] - local) <= np.abs(self.t_s[after] - local), before, after)
        states: Array = self.states[nearest]
        strange = np.abs(self.t_s[nearest] - local) > SAME_S
        if strange.any():
            if self.carrier is None:
                raise CoverageError(self._no_place(epoch, np.asarray(t_s)[strange]))
            states[strange] = self.carrier.state_km_km_s(ephemeris, epoch, np.asarray(t_s)[strange])
        return states

    def _no_place(self, epoch: Epoch, t_s: Array) -> str:
        """The sentence about times without a record."""
        moments = ", ".join((epoch + float(t)).iso(digits=1) for t in t_s[:LISTED])
        return (
            f"telescope {self.name}: its place is known at the times of its {self.t_s.size} records alone, not at "
            f"{moments}{' ...' if t_s.size > LISTED else ''}; give its trajectory as an SPK or OEM file"
        )
