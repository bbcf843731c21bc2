"""Where a fit starts: the orbit that is given, or one found from the directions and grown over the whole arc."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from nebosvod.dynamics import Ephemeris, ForceModel
from nebosvod.dynamics.impact import carry
from nebosvod.errors import CoverageError, EventError, GeometryError, InputError, counted
from nebosvod.estimation import Status
from nebosvod.estimation.solvers.rejection import Thresholds
from nebosvod.fits.ending import arc_words
from nebosvod.fits.growth import grow
from nebosvod.fits.selection import Selected
from nebosvod.mission import FitMission
from nebosvod.mission.reading.places import asking
from nebosvod.observation.initial.initial_orbit import FITS, StartingOrbit, attributable, searches
from nebosvod.scene.material import Material
from nebosvod.scene.scene import force_model, state_at
from nebosvod.timescale import SECONDS_PER_DAY, Epoch
from nebosvod.units import ARCSEC

Array = npt.NDArray[np.float64]
TRIED = 4  # starting orbits tried before the best of them is taken
ENOUGH = 3.0  # chi squared for each observation, of which 2 are expected, below which no other start is tried
LEFT_OUT = 8.0  # of an observation that is left out: about the threshold at which it is
NEARLY_ALL = 0.9  # of the observations that an orbit has selected after which no other span is searched


def first_orbit(
    material: Material,
    mission: FitMission,
    ephemeris: Ephemeris,
    thresholds: Thresholds | None,
    say: Callable[[str], None],
) -> tuple[Epoch, Array, npt.NDArray[np.bool_], str]:
    """Epoch of the fit, state there, first selection, and where they came from.

    Raises
    ------
    GeometryError, CoverageError
        If no orbit is found, or none can be followed over the arc; says what is known instead.
    """
    first, last = ephemeris.coverage(asteroids=mission.force_model.asteroids)
    epoch = min(max(material.middle, first), last)
    bare = replace(force_model(mission, ephemeris), parameters=())
    if mission.object.orbit is not None:
        return epoch, carried(mission, epoch, bare), np.ones(len(material), dtype=bool), "the orbit given"
    say("looking for a starting orbit")
    trials = _Trials(material, bare, thresholds, say, {})
    best = trials.found(searches(material.astrometry, material.observers.state_km_km_s, ephemeris))
    if best is None and trials.uncovered is not None and not _covered(material, epoch, first, last):
        raise trials.uncovered
    if best is None:
        text = "no starting orbit can be followed over the arc" if trials.grown else "no starting orbit found"
        raise GeometryError(f"{material.astrometry.objects[0]}: {text}; {_known(material)}")
    start, grown = best
    at = start.epoch + start.t_s
    origin = _origin(start, material)
    try:
        state = carry(grown.correction.state, at, epoch, bare).state[0]
    except EventError:
        # 0h may lie outside an arc of minutes, and the vague orbit of such an arc run into a body before
        return at, grown.correction.state, grown.selected, origin
    return epoch, np.array(state), grown.selected, origin


def carried(mission: FitMission, epoch: Epoch, forces: ForceModel) -> Array:
    """The given orbit at an epoch: heliocentric ICRF state (6,), km and km/s."""
    with asking(mission, "object", "orbit"):
        return state_at(mission.orbit, epoch, forces)


@dataclass(slots=True)
class _Trials:
    """Starting orbits, each grown once; by the bytes of their states, None where one cannot be followed."""

    material: Material
    forces: ForceModel
    thresholds: Thresholds | None
    say: Callable[[str], None]
    grown: dict[bytes, Selected | None]
    uncovered: CoverageError | None = None

    def found(self, searched: Iterator[tuple[StartingOrbit, ...]]) -> tuple[StartingOrbit, Selected] | None:
        """The start that fits best, and the orbit it has grown to.

        Parameters
        ----------
        searched : candidates, best first, after each span that is searched. One that fits its span and grows to an
            orbit that fits nearly all observations ends the search; else the best of the last are tried in turn.
        """
        offered: tuple[StartingOrbit, ...] = ()
        for offered in searched:
            if offered and offered[0].merit < FITS and _ends(self.grow(offered[0]), NEARLY_ALL):
                break
        best: tuple[StartingOrbit, Selected] | None = None
        for start in offered[:TRIED]:
            grown = self.grow(start)
            if grown is not None and (best is None or _merit(grown) < _merit(best[1])):
                best = start, grown
            if _ends(grown):
                break
        return best

    def grow(self, start: StartingOrbit) -> Selected | None:
        """The orbit that one has grown to, None where it cannot be followed."""
        key = start.state.tobytes()
        if key not in self.grown:
            self.say("widening the arc about the starting orbit")
            sky = self.material.sky(start.epoch + start.t_s)
            self.grown[key] = None
            try:
                self.grown[key] = grow(sky, start.state, self.forces, self.thresholds, half_s=start.span_s / 2.0)
            except CoverageError as error:
                self.uncovered = error
            except (EventError, InputError):
                pass  # runs into a body; the next one may not
        return self.grown[key]


def _ends(grown: Selected | None, share: float = 0.0) -> bool:
    """Whether no other start need be tried: it fits, and has more than a share of all observations selected."""
    if grown is None or grown.correction.status is not Status.CONVERGED:
        return False
    return _merit(grown) < ENOUGH and bool(grown.selected.mean() > share)


def _merit(found: Selected) -> float:
    """Chi squared for each observation, those left out counted too."""
    chosen = found.selected
    return (found.correction.cost + LEFT_OUT * float((~chosen).sum())) / len(chosen)


def _covered(material: Material, epoch: Epoch, first: Epoch, last: Epoch) -> bool:
    """Whether all observations lie between two epochs; an orbit of thousands of au may leave the arc by its light."""
    low, high = material.sky(epoch).span_s
    return first - epoch <= low and high <= last - epoch


def _origin(start: StartingOrbit, material: Material) -> str:
    """Where a starting orbit came from, for a sentence."""
    times = ", ".join(str(material.astrometry.utc[row])[:19] for row in start.triplet)
    if start.method == "Gauss":
        return f"Gauss's method on the directions of {times}"
    return "a search over distances and their rates"


def _known(material: Material) -> str:
    """What is known without an orbit: the arc, direction and motion at its middle, whether it shows curvature."""
    records = material.astrometry
    try:
        seen = attributable(records)
    except InputError as error:
        return str(error)
    is_are = "is" if len(records) == 1 else "are"
    what = f"known {is_are} {counted(len(records), 'observation')} over {arc_words(material)}"
    rate = np.linalg.norm(seen.rate_rad_s) * SECONDS_PER_DAY / ARCSEC
    curved = f"curved by {seen.significance:.1f} sigma" if seen.significance > 0.0 else "a straight line"
    return (
        f"{what}: at the middle RA {np.degrees(seen.psi[0]):.4f} deg, Dec {np.degrees(seen.psi[1]):+.4f} deg, "
        f"moving {rate:.4g} arcsec a day, {curved}; give object.orbit in a settings file if one is known"
    )
