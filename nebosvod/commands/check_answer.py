"""What a mission resolves to, in words: the output of `nebosvod check`; the orbit is flown to tell what is seen."""

from collections.abc import Sequence

from nebosvod.errors import InputError, NebosvodError
from nebosvod.mission import Mission, Source, Telescope, estimate_cost
from nebosvod.units import ARCSEC, DEG

MOST_LOOKS = 2000  # of a telescope's epochs that `check` looks at


def answer(mission: Mission) -> tuple[str, tuple[str, ...]]:
    """What `nebosvod check` says of a mission; the files it names are opened: a damaged one is told here."""
    if mission.ephemeris_path is not None:
        from nebosvod.scene.scene import load_ephemeris, require_epochs

        require_epochs(mission, load_ephemeris(mission))
    if any(getattr(telescope.orbit, "file", None) for telescope in mission.telescopes):
        from nebosvod.scene.instruments import telescopes

        telescopes(mission)
    return describe(mission, visible(mission)), ()


def visible(mission: Mission) -> list[str]:
    """What each telescope sees of its schedule, in words; what keeps a run from telling it, where something does.

    Raises
    ------
    InputError
        If the ephemeris, the Earth's orientation or a telescope's trajectory do not reach what is scheduled.
    """
    from nebosvod.scene.scene import looked
    from nebosvod.scene.seeing import seen_words

    try:
        found = looked(mission, MOST_LOOKS)
    except InputError:
        raise
    except NebosvodError as error:
        return [f"cannot be told, and a run would end with this: {error}"]
    lines = [
        f"{telescope.name}: {seen_words(telescope, seen, mission.times_s(telescope.name).size, mission)}"
        for telescope, seen in found
    ]
    nothing = not any(seen.visible.any() for _, seen in found)
    return [*lines, "nothing at all, so a run would end without an answer"] if nothing else lines


def describe(mission: Mission, seen: Sequence[str] = ()) -> str:
    """The mission as understood: object, telescopes, schedule, estimators, predictions, cost."""
    lines = [
        f"{mission.name}: {mission.title or mission.name}",
        f"reference epoch  {mission.reference_epoch}",
        f"object           {mission.object.name}; orbit: {mission.object.orbit.kind} at {mission.object.orbit.epoch}",
    ]
    for p in mission.parameters:
        lines.append(f"  {p.text}, {p.treatment}")
    lines += [f"  ({statement})" for statement in mission.object.statements]
    lines.append(f"forces           {_forces(mission)}")
    for telescope in mission.telescopes:
        ra, dec = (sigma / ARCSEC for sigma in telescope.noise.sigma_rad)
        noise = f"{ra:.3g} arcsec" if ra == dec else f"{ra:.3g} x {dec:.3g} arcsec"
        own = (s for s in mission.sources if s.path[0] == "telescopes" and s.telescopes == (telescope.name,))
        errors = "".join(f", {source.group} {_source(source)}" for source in own)
        night = _night(telescope)
        lines.append(f"telescope        {telescope.name}: {telescope.orbit.kind}{night}, noise {noise}{errors}")
    for source in mission.sources:
        if source.path[0] != "telescopes":
            lines.append(f"shared           {source.name}: {_source(source)}; {', '.join(source.telescopes)}")
    for arc in mission.schedule:
        who = "all telescopes" if arc.telescopes == "all" else ", ".join(arc.telescopes)
        lines.append(f"schedule         {who}: {arc.start} to {arc.end}, {arc.count} epochs")
    lines += [f"visible          {line}" for line in seen]
    lines.append(f"prior orbit      {_prior(mission)}")
    for estimator in mission.estimators:
        changed = "".join(f", {group} {how}" for group, how in estimator.treatment.items())
        of = "" if estimator.telescopes == "all" else f", {' and '.join(estimator.telescopes)} alone"
        lines.append(f"estimator        {estimator.name}: {estimator.method}{of}{changed}")
    for prediction in mission.predictions:
        lines.append(f"prediction       {prediction.name}: {prediction.plane} at {prediction.when}")
    lines += [f"notice           {notice}" for notice in mission.notices]
    lines += [f"cost             {estimate_cost(mission)}", "the mission is valid; nothing was run"]
    return "\n".join(lines)


def _night(telescope: Telescope) -> str:
    """When a site on the ground observes, in words."""
    sun, altitude = telescope.night
    if sun is None or altitude is None:
        return ""
    return f" (Sun below {sun / DEG:.4g} deg, object above {altitude / DEG:.4g} deg)"


def _forces(mission: Mission) -> str:
    """Every force that acts, in words, and those that were switched off."""
    plan, target = mission.force_model, mission.object
    said = ["Sun, planets, Moon, Pluto", *plan.statements]
    if target.radiation_parameters:
        said.append("radiation pressure" + ("" if plan.earth_shadow else " without the Earth's shadow"))
    if target.nongrav_parameters:
        law = target.nongrav_law
        g = "g = (1 au/r)^2" if law["k"] == 0.0 and law["m"] == 2.0 else "g of " + _law(law)
        said.append(f"{', '.join(p.key for p in target.nongrav_parameters)} with {g}")
    return "; ".join(said)


def _law(law: dict[str, float]) -> str:
    """Constants of Marsden's law in words."""
    shown = {"r0" if name == "r0_au" else name: f"{value:g}{' au' * (name == 'r0_au')}" for name, value in law.items()}
    return ", ".join(f"{name} {value}" for name, value in shown.items())


def _source(source: Source) -> str:
    """One source of uncertainty in words: how large, how correlated, its treatment."""
    kind = str(getattr(source.error, "correlation", "constant")).replace("_", "-")
    first, *more = source.error.sizes or ("no prior",)
    how = "" if kind == "constant" and source.group != "position" else f" {kind}"
    return f"{first}{how}{''.join(f', {size}' for size in more)} ({source.error.treatment})"


def _prior(mission: Mission) -> str:
    """The prior orbit in words."""
    if isinstance(mission.prior, str):
        return "none" if mission.prior == "none" else "the covariance that came with the orbit"
    if mission.prior.file is not None:
        return f"the covariance of {mission.prior.file}"
    if mission.prior.sigma is not None:
        return f"{mission.prior.sigma.position:.4g} km and {mission.prior.sigma.velocity * 1000:.4g} m/s on each axis"
    return "a covariance of " + " ".join(mission.prior.names or ())
