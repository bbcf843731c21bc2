"""Which observations a fit uses by their date, and where its user has said so."""

from collections.abc import Mapping
from typing import Any

from nebosvod.errors import InputError
from nebosvod.mission import FitMission
from nebosvod.mission.fields import observation_time
from nebosvod.mission.fit import empty_interval
from nebosvod.mission.yaml.yamlfile import parse_yaml, read_text, shown
from nebosvod.observation.formats.records import Astrometry

KEYS = {"from": "since", "to": "until"}


def dated(records: Astrometry, mission: FitMission) -> Astrometry:
    """The records from `fit.from` (included) to `fit.to` (excluded), the others counted.

    Raises
    ------
    InputError
        If none is left; names the lines, or the options, to change.
    """
    try:
        return records.between(mission.fit.since, mission.fit.until)
    except InputError as error:
        raise InputError(f"{_place(mission)}: {error}; change or remove the dates") from None


def chosen_dates(mission: FitMission, since: str | None, until: str | None) -> Mapping[str, Any]:
    """What --from and --to say in place of the dates of a settings file, as fields of its plan.

    Raises
    ------
    InputError
        If one is no date, or nothing can lie between them; names the option.
    """
    found = {}
    for option, text in (("from", since), ("to", until)):
        if text is not None:
            try:
                found[KEYS[option]] = observation_time(text)
            except InputError as error:
                raise InputError(f"--{option}: {error}") from None
    dates = {field: getattr(mission.fit, field) for field in KEYS.values()} | found
    wrong = empty_interval(**dates)
    if wrong:
        raise InputError(f"{'--to' if until is not None else '--from'}: {wrong}")
    return found


def _place(mission: FitMission) -> str:
    """`dw.yaml:7:9: fit.from, fit.to` of a settings file, or the options that were given instead."""
    name = shown(str(mission.path)) if mission.path is not None else ""
    file = parse_yaml(read_text(mission.path), name) if mission.path is not None else None
    said, mark = [], ""
    for key, field in KEYS.items():
        value = getattr(mission.fit, field)
        if value is None:
            continue
        text = None if file is None else file.texts.get(("fit", key))
        if file is None or text is None or observation_time(text.strip("\"'")) != value:
            said.append(f"--{key}")
            continue
        said.append(f"fit.{key}")
        at = file.values[("fit", key)]
        mark = mark or f"{name}:{at.line}:{at.column}: "
    return mark + ", ".join(said)
