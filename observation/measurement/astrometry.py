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
from nebosvod.observation.measurement.exposures import Exposures, reception_times, require_distinct, row_order, rows_of
from nebosvod.observation.measurement.sight import lines_of_sight
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
    H : (n, 2, 6 + m) by the heliocentric state at `epoch` (`H_x0`) and by the parameters `parameter_names` (`H_c`).
    H_z : (n, 2, 3) by the telescope's position, ICRF, rad/km.
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
    H: Array
    H_z: Array
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

    @property
    def H_x0(self) -> Array:
        """Partials (n, 2, 6) by the heliocentric state at `epoch`."""
        return self.H[:, :, :6]

    @property
    def H_c(self) -> Array:
        """Partials (n, 2, m) by the dynamic parameters."""
        return self.H[:, :, 6:]

    def rows(self, telescopes: Sequence[str]) -> npt.NDArray[np.int64]:
        """Row numbers, in order, of the measurements made by the named telescopes.

        Raises
        ------
        InputError
            If a name is not a telescope of this observation.
        """
        return rows_of(telescopes, self.telescopes, self.telescope_index)


CHUNK = 4096  # epochs computed at a time: their temporaries stay in the processor's cache
# the fields of Observation with the measurement on the first axis, and the rest of their shapes (m parameters)
ROW_FIELDS: dict[str, tuple[int | str, ...]] = {
    "t_s": (),
    "psi": (2,),
    "H_x": (2, 6),
    "H": (2, "6 + m"),
    "H_z": (2, 3),
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
OF_SIMULATION = ("Phi_emission", "zeta_emission")


@bordered()
def observe(trajectory: Trajectory, telescope: Telescope, t_s: Array, ephemeris: Ephemeris) -> Observation:
    """Compute what `telescope` measures at `t_s`, with all partials.

    Parameters
    ----------
    trajectory : heliocentric, with Phi and zeta; must reach back the light time before the first exposure.
    t_s : shape (n,), reception times, TDB seconds after `trajectory.epoch`, in any order.

    Raises
    ------
    InputError
        If a time is not finite, or (from the trajectory) it has no partials.
    CoverageError
        If trajectory or ephemeris do not cover a time.

    Notes
    -----
    The equations are those of `compute`.
    """
    t_s = reception_times(t_s)
    exposures = Exposures.at(
        trajectory.epoch,
        t_s,
        telescope.spacecraft.state_km_km_s(ephemeris, trajectory.epoch, t_s),
        ephemeris,
        telescopes=(telescope,),
        sigma_rad=telescope.sigma_rad,
        timing_sigma_s=telescope.timing_sigma_s,
    )
    return compute(trajectory, exposures)


def compute(
    trajectory: Trajectory, exposures: Exposures, near: Array | None = None, *, simulates: bool = True
) -> Observation:
    """Compute what is measured in some exposures, with all partials, row by row.

    Parameters
    ----------
    exposures : counted from `trajectory.epoch`, of any telescopes, in any order.
    near : light times (n,) of a near orbit, such as those of the last iteration: one look at the trajectory then does.
    simulates : whether measurements will be drawn about this orbit. Without, the partials that only simulation needs
        are left empty: a fifth of the memory.

    Raises
    ------
    InputError, CoverageError
        As `observe`.

    Notes
    -----
    With D (n, 2, 3) = tangent axes / distance and L = I - V u^T / (c + u.V):
    H_z = -D L, H_x0 = D L Phi(t - tau, 0), H_c = D L zeta(t - tau, 0), H_x = D L Phi(t - tau, t), and the apparent
    rate is D L (V - v_telescope). Phi(t - tau, t) = [I + tau^2 G / 2, -tau I - tau^3 G / 6] with the Sun's gravity
    gradient G: the gradient term is 1e-8 of the whole at 1 au, the next one 1e-11.
    """
    n, m = len(exposures), len(trajectory.parameter_names)
    emission = Emission(trajectory)
    if n <= CHUNK:
        filled = _computed(emission, exposures, near)
    else:
        filled = {name: np.empty((n, *(_size(size, m) for size in shape))) for name, shape in ROW_FIELDS.items()}
        for start in range(0, n, CHUNK):
            part = slice(start, start + CHUNK)
            piece = _computed(emission, exposures.select(part), None if near is None else near[part])
            for name, values in piece.items():
                if simulates or name not in OF_SIMULATION:
                    filled[name][part] = values
    if not simulates:
        filled |= {name: np.empty((0, *(_size(size, m) for size in ROW_FIELDS[name]))) for name in OF_SIMULATION}
    return Observation(
        epoch=trajectory.epoch,
        telescopes=exposures.telescopes,
        telescope_index=exposures.telescope_index,
        parameter_names=tuple(trajectory.parameter_names),
        **filled,
    )


def _size(size: int | str, m: int) -> int:
    """One side of a row's shape, in which "m" stands for the number of parameters."""
    if isinstance(size, int):
        return size
    return m if size == "m" else 6 + m


def _computed(emission: Emission, exposures: Exposures, near: Array | None) -> dict[str, Array]:
    """The rows of as many exposures as fit the processor's cache."""
    line = lines_of_sight(emission.trajectory, exposures, near=near, emitted=emission.state_at)
    n, m = len(exposures), len(emission.trajectory.parameter_names)
    H_x, H, H_z = np.empty((n, 2, 6)), np.empty((n, 2, 6 + m)), np.empty((n, 2, 3))
    Phi, zeta = np.empty((n, 3, 6)), np.empty((n, 3, m))
    emission.partials(Phi, zeta)
    DL = line.sky_partials()
    rows.measurement_partials(
        exposures.gm_sun_km3_s2, DL, line.heliocentric_state, line.light_time_s, Phi, zeta, H_x, H_z, H
    )
    rate = line.rate(DL)
    return {
        "t_s": line.t_s,
        "psi": line.psi,
        "H_x": H_x,
        "H": H,
        "H_z": H_z,
        "rate": rate,
        "noise": exposures.noise(rate),
        "u": line.u,
        "distance_km": line.distance_km,
        "light_time_s": line.light_time_s,
        "telescope_state": line.telescope_state,
        "target_state": line.target_state,
        "Phi_emission": Phi,
        "zeta_emission": zeta,
    }


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
    require_distinct(telescopes)
    for observation in observations[1:]:
        if observation.epoch != first.epoch or observation.parameter_names != first.parameter_names:
            raise InputError("merge: the observations belong to different trajectories (epoch or parameters differ)")
    if len(observations) == 1 and np.all(np.diff(first.t_s) >= 0.0):
        return first
    starts = np.cumsum([0] + [len(observation.telescopes) for observation in observations])
    index = np.concatenate([o.telescope_index + start for o, start in zip(observations, starts)])
    order = row_order(np.concatenate([observation.t_s for observation in observations]), index)
    return Observation(
        epoch=first.epoch,
        telescopes=telescopes,
        telescope_index=index[order],
        parameter_names=first.parameter_names,
        **{name: np.concatenate([getattr(o, name) for o in observations])[order] for name in ROW_FIELDS},
    )
