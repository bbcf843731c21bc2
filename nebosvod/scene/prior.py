"""What is known before the first measurement, brought to the reference epoch as estimation's priors.

A prior orbit is given at its own epoch, possibly joint with A1..A3. Carried to the reference epoch by the
variational equations it becomes correlated with every dynamic parameter that acts on the way; the groups that
this ties together are merged into one source, for the cross blocks must never be dropped.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import ForceModel
from nebosvod.dynamics.elements import cometary_to_state, state_to_cometary
from nebosvod.dynamics.impact import carry
from nebosvod.errors import InputError
from nebosvod.estimation import Prior
from nebosvod.mission import Question
from nebosvod.mission.found import parameter_of
from nebosvod.mission.parameter import Parameter
from nebosvod.mission.question import CovariancePrior
from nebosvod.mission.reading.places import asking
from nebosvod.mission.request import Prior as PriorBlock
from nebosvod.mission.state import orbit_state, to_icrf

Array = npt.NDArray[np.float64]
STATE_NAMES = ("x_km", "y_km", "z_km", "vx_km_s", "vy_km_s", "vz_km_s")
# the names of a prior covariance in the order of `cometary_to_state` and of a state
COMETARY_NAMES = ("e", "q", "tp", "node", "peri", "i")
CARTESIAN_NAMES = ("x", "y", "z", "vx", "vy", "vz")
TOO_WIDE = 0.1  # sigma of position over the distance from the Sun, or of velocity over the speed; see PriorTable.parted


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PriorTable:
    """Priors with their means as values (not deviations): one entry for each independent source.

    Attributes
    ----------
    entries : (source name, parameter names, means (k,), covariance (k, k)).
    by_density : whether the mass is that of a density and an uncertain radius.
    true : where the truth is declared, by source: mean of truth minus prior mean (k,), and true covariance (k, k).
    """

    entries: tuple[tuple[str, tuple[str, ...], Array, Array], ...]
    by_density: bool = False
    true: Mapping[str, tuple[Array, Array]] = field(default_factory=dict)
    _factors: list[Array] = field(default_factory=list, init=False, repr=False)

    def at(self, values: Mapping[str, float]) -> tuple[Prior, ...]:
        """The priors as seen from a linearisation point given by its values."""
        return tuple(
            Prior(
                name=name,
                names=names,
                covariance=covariance,
                mean=mean - np.array([values[n] for n in names]),
                true_covariance=self.true[name][1] if name in self.true else None,
            )
            for name, names, mean, covariance in self.entries
        )

    @property
    def mean_errors(self) -> dict[str, float]:
        """Mean of truth minus prior mean, by parameter; those that are not zero."""
        found: dict[str, float] = {}
        for name, names, _, _ in self.entries:
            if name in self.true:
                found |= {one: float(off) for one, off in zip(names, self.true[name][0]) if off != 0.0}
        return found

    def draw(self, rng: np.random.Generator) -> dict[str, float]:
        """A truth for every parameter that has a prior."""
        truth: dict[str, float] = {}
        if not self._factors:  # the same for every draw
            self._factors.extend(_factor(self.true[e[0]][1] if e[0] in self.true else e[3]) for e in self.entries)
        for (name, names, mean, _), factor in zip(self.entries, self._factors):
            about = mean + self.true[name][0] if name in self.true else mean
            truth.update(zip(names, (about + factor @ rng.standard_normal(len(names))).tolist()))
        return truth

    def physical(self, truth: Mapping[str, float]) -> dict[str, float]:
        """A drawn truth with the mass that its radius and density make (`with_mass`)."""
        if not self.by_density:
            return dict(truth)
        means = {name: float(value) for _, names, mean, _ in self.entries for name, value in zip(names, mean)}
        means |= {name: means[name] + off for name, off in self.mean_errors.items()}
        return with_mass(means, truth)

    @property
    def says_nothing(self) -> bool:
        """Whether a prior orbit is as wide as the orbit itself."""
        return any(_says_nothing(*entry) for entry in self.entries)

    def parted(self, truth: Mapping[str, float]) -> tuple[dict[str, float], dict[str, float]]:
        """A drawn truth, where a prior is as wide as the orbit itself at its mean; and how far that was off.

        Such a prior means "unknown", not that the object may be anywhere: most of the orbits it would draw are of no
        object that these telescopes see. The mean of the prior is then off instead (`moved`), which is as likely.
        """
        near, off = dict(truth), dict[str, float]()
        for entry in self.entries:
            if _says_nothing(*entry):
                off |= {name: truth[name] - value for name, value in zip(entry[1], entry[2].tolist())}
                near |= dict(zip(entry[1], entry[2].tolist()))
        return near, off

    def moved(self, off: Mapping[str, float]) -> "PriorTable":
        """The priors with means less by these values; themselves where there are none."""
        if not off:
            return self
        return PriorTable(
            entries=tuple(
                (name, names, mean - np.array([off.get(one, 0.0) for one in names]), covariance)
                for name, names, mean, covariance in self.entries
            ),
            by_density=self.by_density,
            true=self.true,
        )

    def sigma(self, name: str) -> float | None:
        """The prior standard deviation of one parameter; None = no prior."""
        for _, names, _, covariance in self.entries:
            if name in names:
                index = names.index(name)
                return float(np.sqrt(covariance[index, index]))
        return None


def _says_nothing(_: str, names: tuple[str, ...], mean: Array, covariance: Array) -> bool:
    """Whether an entry is of the orbit, and as wide as the orbit itself."""
    if names[:6] != STATE_NAMES:
        return False
    sigma = np.sqrt(np.diag(covariance)[:6])
    limits = TOO_WIDE * np.linalg.norm(mean[:6].reshape(2, 3), axis=1)
    return bool(np.any(sigma.reshape(2, 3) > limits[:, None]))


def by_density(mission: Question) -> bool:
    """Whether mass and radius are parameters, and the mass is that of a density and an uncertain radius."""
    free = {parameter.name for parameter in mission.free_parameters}
    return bool(mission.object.radius_mass_covariance) and {"radius_m", "mass_kg"} <= free


def with_mass(about: Mapping[str, float], drawn: Mapping[str, float]) -> dict[str, float]:
    """Drawn values with the mass that their radius and density make, m = 4/3 pi rho r^3.

    The covariance of radius and mass is of the first order: at 1.8 sigma of a radius known to 21 % a mass drawn from it
    is near zero, and the radiation pressure on it without a bound.

    Parameters
    ----------
    about : the values from which the covariance counts.
    """
    wider, heavier = (drawn[name] / about[name] - 1.0 for name in ("radius_m", "mass_kg"))
    denser = heavier - 3.0 * wider
    return dict(drawn) | {"mass_kg": about["mass_kg"] * (1.0 + wider) ** 3 * (1.0 + denser)}


def prior_table(mission: Question, forces: ForceModel, state: Array) -> PriorTable:
    """Collect the priors of state and dynamic parameters at the reference epoch.

    Parameters
    ----------
    state : shape (6,), the reference state, which is the mean of a prior orbit.

    Raises
    ------
    InputError
        If a prior orbit at another epoch meets an estimated parameter without a prior of its own.
    """
    entries = _entries(mission, mission, forces, state)
    return PriorTable(entries=entries, by_density=by_density(mission), true=_declared(mission, entries, forces, state))


Entry = tuple[str, tuple[str, ...], Array, Array]


def _entries(
    mission: Question, about: Question, forces: ForceModel, state: Array, scale: float = 1.0
) -> tuple[Entry, ...]:
    """The priors of a mission, with the numbers of the object of another that differs in no more.

    Parameters
    ----------
    scale : of the sigmas of the prior orbit.
    """
    free = {parameter.name: parameter for parameter in about.parameters}
    parameters = [free[parameter.name] for parameter in mission.free_parameters]
    joint = mission.covariance_prior
    if joint is not None:
        joint = replace(joint, covariance=scale**2 * joint.covariance)
        with asking(mission, "prior"):
            entries = _carried(about, joint, forces, state, parameters)
        done = {name for _, names, _, _ in entries for name in names}
    else:
        entries, done = _sigmas(about, state, scale), set()
    rest = [parameter for parameter in parameters if parameter.name not in done and parameter.sigma is not None]
    return (*entries, *_parameter_entries(about, rest))


def _declared(
    mission: Question, entries: tuple[Entry, ...], forces: ForceModel, state: Array
) -> dict[str, tuple[Array, Array]]:
    """Mean errors (k,) and covariances (k, k) of the sources whose truth is declared."""
    prior = mission.prior if isinstance(mission.prior, PriorBlock) else None
    twin, object_ = None if prior is None else prior.true, mission.object.truth
    if twin is None and object_ is mission.object:
        return {}
    scale = 1.0 if twin is None or twin.scale is None else twin.scale
    truly = _entries(mission, mission.standing_for(object=object_), forces, state, scale)
    found = {}
    for (name, names, assumed, before), (_, _, mean, covariance) in zip(entries, truly):
        off = mean - assumed
        if twin is not None and twin.mean is not None and names[:6] == STATE_NAMES:
            off[:6] += np.concatenate([twin.mean.position, twin.mean.velocity])
        if off.any() or not np.array_equal(covariance, before):
            found[name] = off, covariance
    return found


def _sigmas(mission: Question, state: Array, scale: float) -> tuple[Entry, ...]:
    """The prior orbit given as independent sigmas at the reference epoch, if there is one."""
    said = mission.prior
    if not isinstance(said, PriorBlock) or said.sigma is None:
        return ()
    sigma = scale * np.repeat([said.sigma.position, said.sigma.velocity], 3)
    return (("prior orbit", STATE_NAMES, state, np.diag(sigma**2)),)


def _parameter_entries(mission: Question, parameters: list[Parameter]) -> tuple[Entry, ...]:
    """One source for each parameter; radius and a mass that follows from a density are one source."""
    coupled = mission.object.radius_mass_covariance
    pair = [p for p in parameters if p.group in ("radius", "mass")]
    entries: list[Entry] = []
    if coupled and len(pair) == 2:
        covariance = np.diag([(p.sigma or 0.0) ** 2 for p in pair])
        covariance[0, 1] = covariance[1, 0] = coupled
        names = tuple(p.name for p in pair)
        entries.append(("radius and density", names, np.array([p.value for p in pair]), covariance))
        parameters = [p for p in parameters if p not in pair]
    for group in _tied(parameters, mission.object.correlated):
        if len(group) > 1:
            sigma = np.array([p.sigma or 0.0 for p in group])
            said = mission.object.correlated
            matrix = np.array([[float(a is b) or said.get((a.group, b.group), 0.0) for b in group] for a in group])
            title = " and ".join(p.group for p in group)
            names = tuple(p.name for p in group)
            entries.append((title, names, np.array([p.value for p in group]), matrix * sigma[:, None] * sigma))
            parameters = [p for p in parameters if p not in group]
    for p in parameters:
        entries.append((p.group, (p.name,), np.array([p.value]), np.array([[(p.sigma or 0.0) ** 2]])))
    return tuple(entries)


def _tied(parameters: list[Parameter], correlated: Mapping[tuple[str, str], float]) -> list[list[Parameter]]:
    """Parameters in groups that correlations tie together, each in the order of the list."""
    groups: list[list[Parameter]] = []
    for p in parameters:
        mine = [group for group in groups if any((p.group, other.group) in correlated for other in group)]
        groups = [group for group in groups if group not in mine]
        groups.append([*(other for group in mine for other in group), p])
    return groups


def _carried(
    mission: Question, joint: CovariancePrior, forces: ForceModel, state: Array, parameters: list[Parameter]
) -> tuple[Entry, ...]:
    """The prior orbit carried from its epoch to the reference epoch, with all that becomes correlated on the way."""
    free = {parameter.name: parameter for parameter in parameters}
    labels = {parameter_of(name): name for name in joint.names if parameter_of(name) in free}
    orbit_names = COMETARY_NAMES if joint.representation == "cometary" else CARTESIAN_NAMES
    order = [joint.names.index(name) for name in (*orbit_names, *labels.values())]
    given = joint.covariance[np.ix_(order, order)]
    gap = mission.reference_epoch - joint.epoch
    start, jacobian = _state_at(mission, joint, forces)
    along = carry(start, joint.epoch, mission.reference_epoch, forces, sensitivities=True)
    transition, sensitivity = along.Phi[0], along.zeta[0]
    others = [p for p in free.values() if p.name not in labels] if gap != 0.0 else []
    diffuse = [p.group for p in others if p.sigma is None]
    if diffuse:
        raise InputError(
            f"the orbit's epoch {joint.epoch} is not the reference epoch {mission.reference_epoch}, and "
            f"{', '.join(diffuse)} has no sigma; give it one, or set reference_epoch to the epoch of the prior"
        )
    names = (*STATE_NAMES, *labels, *(p.name for p in others))
    size, column = len(names), {name: index for index, name in enumerate(along.parameter_names)}
    T = np.eye(size)
    T[:6, :6] = transition @ jacobian
    for index, name in enumerate(names[6:], start=6):
        T[:6, index] = sensitivity[:, column[name]]
    before = np.zeros((size, size))
    before[: len(given), : len(given)] = given
    own = PriorTable(entries=_parameter_entries(mission, others))
    for entry_names, block in ((e[1], e[3]) for e in own.entries):
        where = [names.index(name) for name in entry_names]
        before[np.ix_(where, where)] = block
    mean = np.concatenate([state, [free[name].value for name in names[6:]]])
    title = "prior orbit" if size == 6 else "prior orbit and parameters"
    return ((title, names, mean, T @ before @ T.T),)


def _state_at(mission: Question, joint: CovariancePrior, forces: ForceModel) -> tuple[Array, Array]:
    """The nominal state at the epoch of the prior and the partials (6, 6) of it by what the covariance is about."""
    gm = forces.ephemeris.gm_km3_s2["sun"]
    state = orbit_state(mission.orbit, gm)
    if joint.epoch != mission.orbit.epoch:
        state = carry(state, mission.orbit.epoch, joint.epoch, forces).state[0]
    ecliptic = joint.frame == "ecliptic_j2000"
    jacobian = np.eye(6)
    if joint.representation == "cometary":
        back = _to_ecliptic(state) if ecliptic else state
        jacobian = cometary_to_state(state_to_cometary(back, gm)[0], gm)[1]
    return state, to_icrf(jacobian) if ecliptic else jacobian


def _to_ecliptic(state: Array) -> Array:
    """A state from ICRF axes to the ecliptic of J2000: the rotation transposed, column by column."""
    rotation = to_icrf(np.eye(6))
    back: Array = rotation.T @ state
    return back


def _factor(covariance: Array) -> Array:
    """A square root of a covariance whose scales differ by many orders of magnitude."""
    sigma = np.sqrt(np.diag(covariance))
    sigma = np.where(sigma > 0.0, sigma, 1.0)
    value, vector = np.linalg.eigh(covariance / sigma[:, None] / sigma)
    factor: Array = sigma[:, None] * vector * np.sqrt(np.maximum(value, 0.0))
    return factor
