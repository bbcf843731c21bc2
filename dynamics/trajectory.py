"""Trajectory: epochs, states, Phi and zeta, and the same at any other time of the integrated span."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt

from nebosvod.borders.quantities import bordered
from nebosvod.dynamics.dense import StepTable
from nebosvod.dynamics.model import ForceModel
from nebosvod.errors import CoverageError, InputError
from nebosvod.timescale import Epoch

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """An integrated orbit.

    Attributes
    ----------
    epoch : t = 0; Phi and zeta start here.
    t_s : shape (n,), TDB seconds after `epoch`, in the order asked for.
    state : shape (n, 6), heliocentric ICRF position and velocity, km, km/s.
    Phi : shape (n, 6, 6), d state(t) / d state(0).
    zeta : shape (n, 6, m), d state(t) / d parameters, km and km/s per unit of the parameter.
    sensitivities : whether Phi and zeta were integrated; asking for them otherwise raises InputError.
    parameter_names : names of the columns of zeta.
    forces : the model behind it.

    Notes
    -----
    State, Phi and zeta at `t_s` are evaluated when one of them is first asked for: an orbit in an iteration is looked
    at elsewhere.
    """

    epoch: Epoch
    t_s: Array
    parameter_names: tuple[str, ...]
    forces: ForceModel
    sensitivities: bool
    _table: StepTable = field(repr=False)
    _chain: Array = field(repr=False)
    _evaluated: list[tuple[Array, ...]] = field(default_factory=list, repr=False)

    def __post_init__(self) -> None:
        self.t_s.setflags(write=False)

    @property
    def state(self) -> Array:
        """Heliocentric states, shape (n, 6), km, km/s."""
        return self._at_times()[0]

    @property
    def Phi(self) -> Array:
        """Transition matrices from the epoch, shape (n, 6, 6)."""
        self._require_sensitivities()
        return self._at_times()[1]

    @property
    def zeta(self) -> Array:
        """Sensitivities to the parameters, shape (n, 6, m)."""
        self._require_sensitivities()
        return self._at_times()[2]

    def _at_times(self) -> tuple[Array, ...]:
        """State, and with sensitivities Phi and zeta, at `t_s`; kept."""
        if not self._evaluated:
            state, partials = self._table.evaluate(self.t_s, variations=self.sensitivities)
            found: tuple[Array, ...] = (state,)
            if self.sensitivities:
                found = (state, np.ascontiguousarray(partials[:, :, :6]), partials[:, :, 6:] @ self._chain)
            for array in found:
                array.setflags(write=False)
            self._evaluated[:] = [found]  # at once: another thread may be here as well
        return self._evaluated[0]

    def _require_sensitivities(self) -> None:
        if not self.sensitivities:
            raise InputError(
                "this trajectory was propagated without sensitivities; use propagate(..., sensitivities=True)"
            )

    @property
    def span_s(self) -> tuple[float, float]:
        """First and last time at which `at` answers, seconds after the epoch."""
        return float(self._table.edges[0]), float(self._table.edges[-1])

    @property
    def step_edges_s(self) -> Array:
        """Edges of the integration steps, ascending, seconds after the epoch."""
        return self._table.edges.copy()

    @bordered()
    def at(self, t_s: npt.ArrayLike) -> "Trajectory":
        """The same trajectory at other times of the span, from the dense output.

        Raises
        ------
        CoverageError
            If a time lies outside `span_s`.
        """
        return make_trajectory(
            self.epoch, _inside(t_s, self._table), self.forces, self._table, self._chain, self.sensitivities
        )

    @bordered()
    def state_at(self, t_s: npt.ArrayLike) -> Array:
        """Heliocentric states alone, shape (n, 6), km, km/s, at any times of the span."""
        return self._table.evaluate(_inside(t_s, self._table), variations=False)[0]

    @property
    def chain(self) -> Array:
        """From the integrated columns to the parameters, shape (q, m): zeta = integrated columns @ chain."""
        return self._chain.copy()

    @bordered()
    def variations_at(self, t_s: npt.ArrayLike) -> tuple[Array, Array]:
        """States (n, 6) and integrated variations (n, 6, 6 + q): Phi, then the columns that `chain` maps to zeta.

        For callers that map many epochs at once in a loop of their own; others take `at`.

        Raises
        ------
        InputError, CoverageError
            Without sensitivities; if a time lies outside `span_s`.
        """
        self._require_sensitivities()
        return self._table.evaluate(_inside(t_s, self._table), variations=True)

    def to_spk(self, path: str | Path, target: int, name: str = "nebosvod") -> int:
        """Write the whole span as an SPK file of object number `target`; see spkwriter.py. Returns its segments."""
        from nebosvod.dynamics.spkwriter import write_spk

        return write_spk(self, Path(path), target, name)

    @bordered()
    def to_oem(
        self, path: str | Path, *, object_name: str, object_id: str, created: str, covariance: Array | None = None
    ) -> None:
        """Write the states at `t_s` as an OEM, the covariance (6, 6) at the epoch carried along; see oemwriter.py."""
        from nebosvod.dynamics.oemwriter import write_oem

        write_oem(
            self, Path(path), object_name=object_name, object_id=object_id, created=created, covariance=covariance
        )


def make_trajectory(
    epoch: Epoch, t_s: Array, forces: ForceModel, table: StepTable, chain: Array, sensitivities: bool
) -> Trajectory:
    """A table of steps at `t_s` (n,) inside it, wrapped up; `chain` (q, m) maps columns of the kernel to parameters."""
    return Trajectory(epoch, t_s, forces.parameters if sensitivities else (), forces, sensitivities, table, chain)


def _inside(t_s: npt.ArrayLike, table: StepTable) -> Array:
    """Times as a new (n,) array, checked to lie inside the table (to 1 us, the grain of a decade in seconds)."""
    times = np.array(t_s, dtype=np.float64, ndmin=1, order="C")
    if times.ndim != 1:
        raise InputError(f"times need shape (n,), got {times.shape}")
    first, last = float(table.edges[0]), float(table.edges[-1])
    if not len(times) or (first - 1e-6 <= times.min() and times.max() <= last + 1e-6):
        return times
    outside = ~((times >= first - 1e-6) & (times <= last + 1e-6))
    if outside.any():
        bad = float(times[outside][0])
        raise CoverageError(f"time {bad} s lies outside the integrated span {first} to {last} s; propagate further")
    return times
