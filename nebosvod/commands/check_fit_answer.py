"""What a file for `nebosvod fit` means, in words, without a fit."""

from collections.abc import Iterator

from nebosvod.errors import counted, listed
from nebosvod.mission import FitMission
from nebosvod.observation.formats.records import Astrometry

TREATED = {
    "lighter": "a station that has one weighs as one record of its size",
    "told": "told, weights left as they are",
    "off": "not looked for",
}


def answer(mission: FitMission) -> tuple[str, tuple[str, ...]]:
    """What `nebosvod check` says of a fit, and notices; the files it names are opened: a damaged one is told here."""
    from nebosvod.scene.material import looked_at
    from nebosvod.scene.scene import load_ephemeris, require_epochs

    require_epochs(mission, ephemeris := load_ephemeris(mission))
    records = looked_at(mission, ephemeris)
    return describe_fit(mission, records), records.notices


def describe_fit(mission: FitMission, records: Astrometry) -> str:
    """The resolved file and the records it would use as lines for `nebosvod check`."""
    return "\n".join([*_lines(mission, records), "the file is valid; nothing was fitted"])


def _used(records: Astrometry) -> str:
    """How many records there are, whose, when and from where."""
    first, last = (str(min(records.utc))[:10], str(max(records.utc))[:10])
    names = records.objects
    whose = names[0] if len(names) == 1 else f"{len(names)} objects ({listed(names)}): give fit.designation, or --split"
    stations = counted(len(records.stations), "station")
    return f"{counted(len(records), 'record')} from {first} to {last}, {stations}: {whose}"


def _lines(mission: FitMission, records: Astrometry) -> Iterator[str]:
    plan, given = mission.fit, mission.object.orbit
    yield f"{mission.name}: {mission.title or 'orbit fit'}"
    names = f"; {' = '.join(plan.designation)}" if plan.designation else ""
    yield f"observations     {', '.join(plan.observations)}{names}"
    yield f"records          {_used(records)}"
    if plan.since is not None or plan.until is not None:
        since = f"from {plan.since.iso('utc', 0)} on" if plan.since is not None else ""
        until = f"before {plan.until.iso('utc', 0)}" if plan.until is not None else ""
        yield f"dates            {' and '.join(filter(None, (since, until)))}"
    yield f"start            {f'{given.representation} at {given.epoch}' if given else 'found from the observations'}"
    yield f"weights          {plan.weights or 'stated, else by station, catalogue and date'}"
    yield f"star catalogues  {plan.debias or 'not corrected'}"
    timed = "clock" not in plan.model_fields_set and any(entry.timing is not None for entry in plan.uncertainty)
    unless = "; none where timing is uncertain below" if timed else ""
    yield f"clocks           {plan.clock:g} s on the ground, the same all night{unless}"
    said = plan.rejection
    yield f"rejection        {f'above chi2 {said.reject:g}, back below {said.recover:g}' if said.enabled else 'off'}"
    yield f"shared errors    {TREATED[plan.of_shared_errors]}"
    limit = "four" if plan.night_limit is None else plan.night_limit
    unless = "; all where uncertainty names the bias" if plan.night_limit is None else ""
    yield f"nights           {'all records' if limit == 'off' else f'{limit} records'} weigh as independent{unless}"
    for parameter in mission.parameters:
        sigma = "" if parameter.sigma is None else f" +- {parameter.sigma:g}"
        yield f"parameter        {parameter.group} {parameter.value:g}{sigma}: {parameter.treatment}"
    for entry in plan.uncertainty:
        whom = "every station" if entry.stations == "all" else ", ".join(entry.stations)
        own = f"one for all, {entry.shared}" if entry.shared else "each its own"
        yield f"uncertain        {entry.group} of {whom} ({own}): {entry.error.treatment}"
    for request in mission.predictions:
        yield f"prediction       {request.name}: {request.plane} at {request.when}"
