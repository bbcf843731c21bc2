"""propagate(...): the public face of the compiled integrator."""

import dataclasses
import math

import numpy as np
import numpy.typing as npt

from nebosvod.borders.quantities import bordered
from nebosvod.dynamics import integrator
from nebosvod.dynamics.collision import IMPACT_TIDE, require_no_impact, require_start_above
from nebosvod.dynamics.constants import SPEED_OF_LIGHT_KM_S
from nebosvod.dynamics.dense import join
from nebosvod.dynamics.ephemeris import BEYOND_S
from nebosvod.dynamics.model import ForceModel, Physics, arc_of
from nebosvod.dynamics.trajectory import Trajectory, make_trajectory
from nebosvod.dynamics.workspace import LENGTH, NO_NODES, NO_SAMPLES, NO_STEPS, TIDE, Steps
from nebosvod.errors import EventError, InputError, StepLimitError
from nebosvod.timescale import Epoch

Array = npt.NDArray[np.float64]
TOLERANCE, TIGHTEST, LOOSEST = 1e-10, 1e-16, 1e-3
NO_GUIDES = ((NO_STEPS, NO_NODES),) * 2
SLIGHTLY = 8.0  # a margin of so small a part of a step is the step's own
MOST_GUIDED = 5000  # steps that others may follow, for which 7 to 10 kB of ephemeris are kept each: two centuries
AMPLE = 1.05  # of the light time from the Sun: the observer and the barycentre are elsewhere
LEAST_FALL_S = IMPACT_TIDE**-0.5  # free-fall time, longer than at the surface of any body
MOST_DOUBLED = 10  # of a margin: 44,000 au
OWN_TIDE = 1e-10  # s^-2: GM/r^3 at ten radii of an asteroid of 0.4 g/cm^3


@bordered()
def propagate(
    state_km_km_s: npt.ArrayLike,
    epoch: Epoch,
    t_s: npt.ArrayLike,
    forces: ForceModel,
    sensitivities: bool = True,
    *,
    tolerance: float = TOLERANCE,
    margin_s: float | None = None,
    grid: Trajectory | None = None,
    solid: bool = True,
    most_steps: int = integrator.MOST_STEPS,
) -> Trajectory:
    """Integrate an orbit with its transition matrix and parameter sensitivities.

    Parameters
    ----------
    state_km_km_s : shape (6,), heliocentric ICRF position and velocity at `epoch`, km, km/s.
    epoch : the reference epoch, t = 0.
    t_s : shape (n,), TDB seconds after `epoch`, any order, either sign.
    forces : the force model; `forces.parameters` are the columns of zeta. An orbit that starts within ten radii of one
        of the asteroids is that asteroid: it is left out, and `trajectory.forces.excluded` says so.
    sensitivities : whether Phi and zeta are integrated.
    tolerance : at which the last Legendre coefficient of the acceleration over a step, relative, is held; from 1e-16
        to 1e-3. A step is made anew where it is three times as large.
    margin_s : how far before the first time the trajectory reaches, so that light-time solutions find their emission
        time inside it; by default six hours, and for an orbit that may be beyond 40 au twice, four times ... as much;
        cut six hours before the start of the ephemeris.
    grid : a trajectory of a near orbit, such as the last iteration of a fit: its steps, the ephemeris at their nodes
        and its accelerations as a first guess are used again where epoch, span and bodies are the same and every step
        passes the error check; otherwise the orbit gets steps of its own. It changes the time taken, and the result by
        rounding.
    solid : whether bodies have surfaces. False: they are points, and an orbit goes on below a surface.
    most_steps : how many steps it may take; some 17 go to a revolution, and each keeps up to 3 kB.

    Raises
    ------
    InputError, CoverageError
        If shapes are wrong or numbers not finite; if a time is outside the ephemeris.
    ImpactError
        If the orbit runs into a body, with body, time and distance.
    StepLimitError
        If it takes too many steps; says how far it came.
    EventError
        If it comes to a singularity.

    References
    ----------
    Hairer, Lubich, Wanner 2006, Geometric Numerical Integration: Gauss collocation.
    """
    start, times, low, high = _checked(state_km_km_s, t_s)
    if not 1 <= most_steps <= integrator.MOST_STEPS:
        raise InputError(f"most_steps: needs a number from 1 to {integrator.MOST_STEPS} (got {most_steps})")
    if not TIGHTEST <= tolerance <= LOOSEST:
        raise InputError(f"tolerance: needs a number from {TIGHTEST} to {LOOSEST} (got {tolerance})")
    ahead = low >= 0.0  # before the epoch nothing but the margin
    gm_sun = forces.ephemeris.gm_km3_s2["sun"]
    margin = _light_time(start, min(0.0, low), gm_sun) if margin_s is None else margin_s
    arc = arc_of(forces, epoch, min(0.0, low), max(0.0, high), margin)
    low, high, window, sun, physics = arc
    least_fall_s = LEAST_FALL_S if solid else 0.0
    columns, chain = forces.columns()
    if not sensitivities:
        columns = columns[:0]
    guides = _guides(grid, epoch, (low, high), forces, physics, most_steps)
    legs: list[Steps | None] = [None, None]
    left, deepest = most_steps, 0.0
    for leg, end_s in ((1, high), (0, low)) if ahead else ((0, low), (1, high)):
        if end_s != 0.0 and not (leg == 0 and ahead and _reaches_back(legs[1], low)):
            fixed = (arc, start[None], physics.strength[None], end_s, columns, sensitivities, float(tolerance))
            while True:
                status, steps, tide = integrator.integrate(*fixed, *guides[leg], NO_SAMPLES, left, least_fall_s)
                if status == integrator.LOW:
                    require_start_above(start, epoch, forces)
                    if forces.perturber_at((start + sun)[:3], epoch) is not None:
                        break
                    least_fall_s = 0.0
                elif status == integrator.OFF_GRID:
                    guides = NO_GUIDES
                else:
                    break
            legs[leg], left, deepest = steps, left - len(steps.rows), max(deepest, tide)
            itself = _perturber_itself(forces, steps, start, sun, epoch)
            if itself is not None:
                without = dataclasses.replace(forces, excluded=(*forces.excluded, itself))
                return propagate(
                    start, epoch, times, without, sensitivities, tolerance=tolerance, margin_s=margin_s, grid=grid,
                    solid=solid, most_steps=most_steps,
                )  # fmt: skip
            if status != integrator.OK:
                if len(steps.rows) and solid:
                    begun = 0.0 if legs[0] is None else low  # nothing is asked of the margin
                    stub = join(legs[0], legs[1], window, 6 + len(columns) if sensitivities else 0, begun)
                    require_no_impact(make_trajectory(epoch, np.zeros(1), forces, stub, chain, False), stub.steps.tide)
                raise _unfinished(status, forces, epoch, steps, end_s, (start + sun)[:3], tolerance, most_steps)
    nodes = grid._table.nodes if grid is not None and guides is not NO_GUIDES else None
    table = join(legs[0], legs[1], window, 6 + len(columns) if sensitivities else 0, low, nodes)
    trajectory = make_trajectory(epoch, times, forces, table, chain, sensitivities)
    if solid and deepest > IMPACT_TIDE:
        require_no_impact(trajectory, table.steps.tide)
    return trajectory


def _light_time(start: Array, low_s: float, gm_sun: float) -> float:
    """Six hours times a power of two: the light time from where an orbit is at `low_s`, at the farthest.

    In steps, so that near orbits have one span. The farthest is twice the semi-major axis, or what the speed allows.
    """
    x, y, z, vx, vy, vz = start.tolist()
    distance, speed = math.hypot(x, y, z), math.hypot(vx, vy, vz)
    farthest = distance - speed * low_s  # farther out it is slower
    if distance > 0.0 and speed * speed < 2.0 * gm_sun / distance:
        farthest = min(farthest, 2.0 / (2.0 / distance - speed * speed / gm_sun))
    needed = AMPLE * farthest / SPEED_OF_LIGHT_KM_S
    return (
        BEYOND_S if needed <= BEYOND_S else BEYOND_S * 2.0 ** min(math.ceil(math.log2(needed / BEYOND_S)), MOST_DOUBLED)
    )


def _reaches_back(forward: Steps | None, low_s: float) -> bool:
    """Whether the first forward step reaches back over the margin: its polynomial is good to 0.1 mm just outside."""
    return forward is not None and len(forward.rows) > 0 and forward.rows.item(0, LENGTH) >= SLIGHTLY * -low_s


def _guides(
    grid: Trajectory | None, epoch: Epoch, span: tuple[float, float], forces: ForceModel, physics: Physics, most: int
) -> tuple[tuple[Steps, Array], ...]:
    """Steps and nodes of both legs of `grid`, or none where they do not fit the span or the bodies, or are too many."""
    if grid is None or grid.epoch != epoch or grid.span_s != span:
        return NO_GUIDES
    if len(grid._table.steps.rows) > min(most, MOST_GUIDED):
        return NO_GUIDES
    theirs = grid.forces
    same_bodies = theirs.ephemeris is forces.ephemeris and np.array_equal(theirs.physics(epoch).gm, physics.gm)
    if not same_bodies or (theirs.relativity, theirs.earth_pole) != (forces.relativity, forces.earth_pole):
        return NO_GUIDES
    return grid._table.guides(physics)


def _perturber_itself(forces: ForceModel, steps: Steps, start: Array, sun: Array, epoch: Epoch) -> str | None:
    """The asteroid whose own orbit this is. Looked up only after a first step in a strong tide, for it costs 0.1 ms."""
    if len(steps.rows) and steps.rows.item(0, TIDE) < OWN_TIDE:
        return None
    return forces.perturber_at((start + sun)[:3], epoch)


def _checked(state_km_km_s: npt.ArrayLike, t_s: npt.ArrayLike) -> tuple[Array, Array, float, float]:
    """State (6,), times (n,) as a new array, first and last of them; refused if they cannot be used."""
    start = np.asarray(state_km_km_s, dtype=np.float64)
    times = np.array(t_s, dtype=np.float64, ndmin=1, order="C")
    if start.shape != (6,) or not all(map(math.isfinite, start.tolist())):
        raise InputError(f"state: needs six finite numbers (km, km/s), got {start}")
    if times.ndim == 1 and len(times):
        low, high = (float(times.min()), float(times.max())) if len(times) > 1 else (times.item(),) * 2
        if math.isfinite(high - low):
            return start, times, low, high
    raise InputError(f"times: need shape (n,) with n > 0 and finite seconds, got shape {times.shape}")


def _unfinished(
    status: int, forces: ForceModel, epoch: Epoch, steps: Steps, end_s: float, position_km: Array, tolerance: float,
    most: int,
) -> EventError:  # fmt: skip
    """The error for an integration that could not go on: at a singularity, or after too many steps."""
    t, reached = 0.0, 0.0
    if len(steps.rows):
        t, position_km = float(steps.start[-1]), steps.state[-1, :3]
        reached = t + float(steps.length[-1])
    gaps = {b: np.linalg.norm(position_km - forces.ephemeris.position_km(b, epoch, t)[0]) for b in forces.bodies}
    body = min(gaps, key=lambda name: gaps[name])
    where = f"{gaps[body]:.0f} km from the centre of {body}"
    way = f"at {(epoch + reached).iso()} on its way to {(epoch + end_s).iso()}"
    if status == integrator.TOO_MANY_STEPS:
        return StepLimitError(
            f"the integration gives up {way}, after the {most} steps it may take (the last is "
            f"{abs(reached - t):.3g} s long, {where}); ask for a shorter arc, or a tolerance looser than {tolerance:g}",
            t_s=reached,
        )
    return EventError(f"the integration stops {way}: the asteroid is {where}")
