"""Astrometric RA and Dec of a moving target from a moving telescope, and their partials.

Every H_* is the partial of (cos Dec dRA, dDec), the declination being the computed one, frozen.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nebosvod.errors import InputError
from nebosvod.observation.contracts import Array, Ephemeris, Trajectory
from nebosvod.observation.sight import sight
from nebosvod.observation.telescope import Telescope
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


CHUNK = (
    16_384  # epochs computed at a time: at a million the temporaries of one pass fall out of the cache, twice as slow
)
# the fields of Observation with the measurement on the first axis
ROW_FIELDS = (
    *("t_s", "psi", "H_x", "H_x0", "H_z", "H_c", "rate", "noise", "u", "distance_km", "light_time_s"),
    *("telescope_state", "target_state", "Phi_emission", "zeta_emission"),
)


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
    t_s = np.asarray(t_s, dtype=np.float64)
    if t_s.ndim != 1 or t_s.size <= CHUNK:
        return _observe(trajectory, telescope, t_s, ephemeris)
    rows: dict[str, Array] = {}
    for start in range(0, t_s.size, CHUNK):
        piece = _observe(trajectory, telescope, t_s[start : start + CHUNK], ephemeris)
        for name in ROW_FIELDS:
            values = getattr(piece, name)
            rows.setdefault(name, np.empty((t_s.size, *values.shape[1:])))[start : start + CHUNK] = values
    return Observation(
        epoch=piece.epoch,
        telescopes=piece.telescopes,
        telescope_index=np.zeros(t_s.size, dtype=np.int64),
        parameter_names=piece.parameter_names,
        **rows,
    )


def _observe(trajectory: Trajectory, telescope: Telescope, t_s: Array, ephemeris: Ephemeris) -> Observation:
    """`observe` for as many epochs as fit the processor's cache."""
    line = sight(trajectory, telescope.spacecraft, t_s, ephemeris)
    emitted = trajectory.at(line.t_s - line.light_time_s)
    Phi, zeta = emitted.Phi[:, :3], emitted.zeta[:, :3]
    DL = line.sky_partials()
    rate = line.rate(DL)
    back = _position_transition(line.heliocentric_state[:, :3], line.light_time_s, ephemeris.gm_km3_s2["sun"])
    return Observation(
        epoch=trajectory.epoch,
        telescopes=(telescope,),
        telescope_index=np.zeros(line.t_s.size, dtype=np.int64),
        parameter_names=tuple(trajectory.parameter_names),
        t_s=line.t_s,
        psi=line.psi,
        H_x=DL @ back,
        H_x0=DL @ Phi,
        H_z=-DL,
        H_c=DL @ zeta,
        rate=rate,
        noise=telescope.noise(rate),
        u=line.u,
        distance_km=line.distance_km,
        light_time_s=line.light_time_s,
        telescope_state=line.telescope_state,
        target_state=line.target_state,
        Phi_emission=Phi,
        zeta_emission=zeta,
    )


def _position_transition(r_sun_km: Array, tau: Array, gm_sun: float) -> Array:
    """Partials (n, 3, 6) of the position at t - tau by the state at t, third order in tau."""
    distance = np.linalg.norm(r_sun_km, axis=1)[:, None, None]
    G = gm_sun / distance**3 * (3.0 * r_sun_km[:, :, None] * r_sun_km[:, None, :] / distance**2 - np.eye(3))
    tau = tau[:, None, None]
    return np.concatenate([np.eye(3) + tau**2 / 2.0 * G, -tau * np.eye(3) - tau**3 / 6.0 * G], axis=2)


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
    starts = np.cumsum([0] + [len(observation.telescopes) for observation in observations])
    index = np.concatenate([o.telescope_index + start for o, start in zip(observations, starts)])
    t_s = np.concatenate([observation.t_s for observation in observations])
    order = np.lexsort((index, t_s))
    rows = {name: np.concatenate([getattr(o, name) for o in observations])[order] for name in ROW_FIELDS}
    return Observation(
        epoch=first.epoch,
        telescopes=telescopes,
        telescope_index=index[order],
        parameter_names=first.parameter_names,
        **rows,
    )
