"""Astrometric RA and Dec of a moving target from a moving telescope, and their partials.

Every H_* is the partial of (cos Dec dRA, dDec), the declination being the computed one, frozen.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.borders.quantities import bordered
from nebosvod.errors import InputError
from nebosvod.observation.contracts import Array, Ephemeris, Trajectory
from nebosvod.observation.measurement import rows
from nebosvod.observation.measurement.emission import Emission
from nebosvod.observation.measurement.sight import reception_times, sight
from nebosvod.observation.measurement.telescope import Telescope
from nebosvod.timescale import Epoch


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Observation:
    """Computed measurements of one or several telescopes, rows by time and then by telescope.

    Attributes
    ----------
    epoch : the epoch from which times and partials count.
    telescopes, telescope_index : the telescopes, and for each row (n,) which one of them made it.
    t_s : (n,) reception times, TDB seconds after `epoch`.
    psi : (n, 2) RA in [0, 2 pi) and Dec, rad, astrometric ICRF.
    dec_rad : (n,) the declination frozen in the partials.
    H_x : (n, 2, 6) by the heliocentric state at reception, rad/km and rad/(km/s).
    H_x0 : (n, 2, 6) by the heliocentric state at `epoch`.
    H_z : (n, 2, 3) by the telescope's position, ICRF, rad/km.
    H_c : (n, 2, m) by the dynamic parameters `parameter_names`.
    rate : (n, 2) apparent motion in RA cos Dec and Dec, rad/s: the partial by a clock error.
    noise : (n, 2, 2) covariance R of the measurement noise, rad^2.
    u, distance_km, light_time_s : (n, 3) ICRF line of sight, (n,), (n,).
    telescope_state, target_state : (n, 6) barycentric ICRF at reception and at emission.
    Phi_emission, zeta_emission : (n, 3, 6), (n, 3, m) partials of the target's position at emission by the state at
        `epoch` and the dynamic parameters; what simulation needs to move the target.
    """

    epoch: Epoch
    telescopes: tuple[Telescope, ...]
    telescope_index: npt.NDArray[np.int64]
    parameter_names: tuple[str, ...]
    t_s: Array
    psi: Array
    H_x: Array
    H_x0: Array
    H_z: Array
    H_c: Array
    rate: Array
    noise: Array
    u: Array
    distance_km: Array
    light_time_s: Array
    telescope_state: Array
    target_state: Array
    Phi_emission: Array
    zeta_emission: Array

    @property
    def dec_rad(self) -> Array:
        """Computed declination (n,), rad: frozen in the partials and in the residual."""
        return self.psi[:, 1]

    def rows(self, telescopes: Sequence[str]) -> npt.NDArray[np.int64]:
        """Row numbers, in order, of the measurements made by the named telescopes.

        Raises
        ------
        InputError
            If a name is not a telescope of this observation.
        """
        known = [telescope.name for telescope in self.telescopes]
        for name in telescopes:
            if name not in known:
                raise InputError(f'telescope "{name}" made no measurement here (there are: {", ".join(known)})')
        wanted = [known.index(name) for name in telescopes]
        return np.flatnonzero(np.isin(self.telescope_index, wanted))


CHUNK = 4096  # epochs computed at a time: their temporaries stay in the processor's cache
# the fields of Observation with the measurement on the first axis, and the rest of their shapes (m parameters)
ROW_FIELDS: dict[str, tuple[int | str, ...]] = {
    "t_s": (),
    "psi": (2,),
    "H_x": (2, 6),
    "H_x0": (2, 6),
    "H_z": (2, 3),
    "H_c": (2, "m"),
    "rate": (2,),
    "noise": (2, 2),
    "u": (3,),
    "distance_km": (),
    "light_time_s": (),
    "telescope_state": (6,),
    "target_state": (6,),
    "Phi_emission": (3, 6),
    "zeta_emission": (3, "m"),
}


@bordered()
def observe(trajectory: Trajectory, telescope: Telescope, t_s: Array, ephemeris: Ephemeris) -> Observation:
    """Compute what `telescope` measures at `t_s`, with all partials.

    Parameters
    ----------
    trajectory : heliocentric, with Phi and zeta; must reach back the light time before the first exposure.
    t_s : shape (n,), reception times, TDB seconds after `trajectory.epoch`.

    Raises
    ------
    InputError
        If a time is not finite, or (from the trajectory) it has no partials.
    CoverageError
        If trajectory or ephemeris do not cover a time.

    Notes
    -----
    With D (n, 2, 3) = tangent axes / distance and L = I - V u^T / (c + u.V):
    H_z = -D L, H_x0 = D L Phi(t - tau, 0), H_c = D L zeta(t - tau, 0), H_x = D L Phi(t - tau, t), and the apparent
    rate is D L (V - v_telescope). Phi(t - tau, t) = [I + tau^2 G / 2, -tau I - tau^3 G / 6] with the Sun's gravity
    gradient G: the gradient term is 1e-8 of the whole at 1 au, the next one 1e-11.
    """
    t_s = reception_times(t_s)
    names = tuple(trajectory.parameter_names)
    filled = {name: np.empty(_shape(t_s.size, shape, len(names))) for name, shape in ROW_FIELDS.items()}
    emission = Emission(trajectory)
    for start in range(0, t_s.size, CHUNK):
        part = slice(start, start + CHUNK)
        _fill({name: values[part] for name, values in filled.items()}, emission, telescope, t_s[part], ephemeris)
    return Observation(
        epoch=trajectory.epoch,
        telescopes=(telescope,),
        telescope_index=np.zeros(t_s.size, dtype=np.int64),
        parameter_names=names,
        **filled,
    )


def _shape(n: int, row: tuple[int | str, ...], m: int) -> tuple[int, ...]:
    """Shape of n rows, each of the shape `row`, in which "m" stands for the number of parameters."""
    return (n, *(m if isinstance(size, str) else size for size in row))


def _fill(out: dict[str, Array], emission: Emission, telescope: Telescope, t_s: Array, ephemeris: Ephemeris) -> None:
    """`observe` for as many epochs as fit the processor's cache, into the arrays of `out`."""
    line = sight(emission.trajectory, telescope.spacecraft, t_s, ephemeris, emission.state_at)
    for name in ("t_s", "psi", "u", "distance_km", "light_time_s", "telescope_state", "target_state"):
        out[name][...] = getattr(line, name)
    emission.partials(out["Phi_emission"], out["zeta_emission"])
    DL = line.sky_partials()
    rate = line.rate(DL)
    out["rate"][...] = rate
    out["noise"][...] = telescope.noise(rate)
    rows.measurement_partials(
        ephemeris.gm_km3_s2["sun"], DL, line.heliocentric_state, line.light_time_s,
        out["Phi_emission"], out["zeta_emission"], out["H_x"], out["H_x0"], out["H_z"], out["H_c"],
    )  # fmt: skip


def merge(observations: Sequence[Observation]) -> Observation:
    """Join observations of several telescopes of one trajectory, rows by time and then by telescope.

    Raises
    ------
    InputError
        If there is nothing to join, epochs or parameters differ, or two telescopes share a name.
    """
    if not observations:
        raise InputError("merge: no observations to join")
    first = observations[0]
    telescopes = tuple(telescope for observation in observations for telescope in observation.telescopes)
    names = [telescope.name for telescope in telescopes]
    if len(set(names)) < len(names):
        raise InputError(f"merge: two telescopes have one name ({', '.join(sorted(names))})")
    for observation in observations[1:]:
        if observation.epoch != first.epoch or observation.parameter_names != first.parameter_names:
            raise InputError("merge: the observations belong to different trajectories (epoch or parameters differ)")
    if len(observations) == 1 and np.all(np.diff(first.t_s) >= 0.0):
        return first
    starts = np.cumsum([0] + [len(observation.telescopes) for observation in observations])
    index = np.concatenate([o.telescope_index + start for o, start in zip(observations, starts)])
    order = np.lexsort((index, np.concatenate([observation.t_s for observation in observations])))
    place = np.empty_like(order)
    place[order] = np.arange(order.size)
    places = np.split(place, np.cumsum([observation.t_s.size for observation in observations])[:-1])
    return Observation(
        epoch=first.epoch,
        telescopes=telescopes,
        telescope_index=index[order],
        parameter_names=first.parameter_names,
        **{name: _interleave([getattr(o, name) for o in observations], places) for name in ROW_FIELDS},
    )


def _interleave(parts: Sequence[Array], places: Sequence[npt.NDArray[np.int64]]) -> Array:
    """Rows of all parts in one new array, each at its place: no other copy is made."""
    joined = np.empty((sum(len(part) for part in parts), *parts[0].shape[1:]))
    for part, place in zip(parts, places):
        joined[place] = part
    return joined
