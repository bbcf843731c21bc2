"""Typed findings, the rows made of them and the published schemas agree: no number is dropped, none is undocumented.

A finding is filled with numbers and words that occur nowhere else. Each must stand in its row, each key of the row in
the schema, and each key of the schema in a row: so a new field cannot be forgotten on its way.
"""

import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass, replace
from itertools import count
from pathlib import Path
from types import NoneType, SimpleNamespace, UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

import numpy as np
import pytest

import nebosvod.results
import nebosvod.studies
from nebosvod.engine.facts import BodyFacts, EncounterFacts, EntryFacts, ImpactFacts, SkyFacts, StateFacts, ValueFacts
from nebosvod.engine.montecarlo import StateNees
from nebosvod.engine.quantity import Quantity
from nebosvod.findings import blame
from nebosvod.findings.blame import QuantityShare, QuantitySigmas, StateShare, StateSigmas
from nebosvod.findings.comparison import Accuracies
from nebosvod.findings.curves import WORLDS, CountCurve, Curve
from nebosvod.findings.drawn import DrawnSpread
from nebosvod.findings.foretold import Missing
from nebosvod.findings.impacts import Impact
from nebosvod.findings.nonlinearity import Nonlinearity
from nebosvod.findings.prediction import Answered, Unanswered
from nebosvod.findings.ratio import NoiseRatio
from nebosvod.findings.required import Position, RequiredPosition
from nebosvod.fits.ahead import Ahead
from nebosvod.fits.answer import Ended, Rejected, StationResiduals
from nebosvod.fits.missing_force import MissingForce
from nebosvod.fits.orbit import Comparison
from nebosvod.fits.shared_errors import SharedError
from nebosvod.mission.request import EncounterPrediction, SkyPrediction, StatePrediction, ValuePrediction
from nebosvod.results import fit_summary, prediction_rows, rows
from nebosvod.studies import outcomes, verdict_rows
from nebosvod.timescale import Epoch

Row = dict[str, Any]
RESULTS = Path(nebosvod.results.__file__).parent
RUN = json.loads((RESULTS / "summary.schema.json").read_text("utf-8"))
FIT = json.loads((RESULTS / "fit_summary.schema.json").read_text("utf-8"))
CAMPAIGN = json.loads((Path(nebosvod.studies.__file__).with_name("validation.schema.json")).read_text("utf-8"))
REQUESTS = {
    SkyFacts: SkyPrediction(**{"name": "s", "plane": "sky", "from": "A", "at": "2029-01-01 TDB"}),
    StateFacts: StatePrediction(name="p", plane="position", at="2029-01-01 TDB"),
    ValueFacts: ValuePrediction(name="v", plane="energy", at="2029-01-01 TDB"),
    EncounterFacts: EncounterPrediction(name="b", plane="b_plane", body="earth", near="2029-01-01 TDB"),
    EntryFacts: EncounterPrediction(name="e", plane="entry", body="earth", near="2029-01-01 TDB", altitude="9 km"),
    ImpactFacts: StatePrediction(name="p", plane="position", at="2029-01-01 TDB"),
    BodyFacts: EncounterPrediction(name="b", plane="b_plane", body="earth", near="2029-01-01 TDB"),
}


# --- filling ----------------------------------------------------------------------------------------------------------


class Filler:
    """Makes values of any annotated type, each number and each word once; arrays have `size` numbers."""

    def __init__(self, size: int = 3, sigmas: type = StateSigmas) -> None:
        self.numbers, self.size, self.sigmas = count(1001), size, sigmas

    def of(self, kind: Any, /, **own: Any) -> Any:
        """A dataclass with every field filled, but for those named."""
        hints = get_type_hints(kind)
        return kind(**{f.name: own[f.name] if f.name in own else self.value(hints[f.name]) for f in fields(kind)})

    def value(self, hint: Any) -> Any:
        """A value of a type."""
        origin, inside = get_origin(hint), get_args(hint)
        if hint is blame.Sigmas:
            return self.of(self.sigmas)
        if origin in (Union, UnionType):
            return self.value(next(one for one in inside if one is not NoneType))
        if origin is Literal:
            return inside[0]
        if hint is Epoch:
            return Epoch(2460000.5 + next(self.numbers), 0.5)
        if is_dataclass(origin or hint):
            return self.of(origin or hint)
        if origin is np.ndarray:
            return np.array([float(next(self.numbers)) for _ in range(self.size)])
        if origin in (tuple, Sequence):
            return tuple(self.value(one) for one in inside if one is not Ellipsis)
        if origin is Mapping:
            return {self.value(inside[0]): self.value(inside[1])}
        number = next(self.numbers)
        return {float: float(number), int: number, bool: True, str: f"word{number}"}[hint]


def leaves(value: Any) -> Iterator[Any]:
    """Every number and word in a finding or a row."""
    if is_dataclass(value) and not isinstance(value, type | Epoch):
        for one in fields(value):
            yield from leaves(getattr(value, one.name))
    elif isinstance(value, Mapping):
        for key, one in value.items():
            yield from leaves(key)
            yield from leaves(one)
    elif isinstance(value, list | tuple):
        for one in value:
            yield from leaves(one)
    elif isinstance(value, np.ndarray):
        yield from value.ravel().tolist()
    elif isinstance(value, Epoch):
        yield value.iso()[:10]
    elif value is not None and not isinstance(value, bool):
        yield value


def lost(finding: Any, row: Row, but: Sequence[Any] = ()) -> set[Any]:
    """What of a finding is not in its row; it may stand inside words there."""
    there = set(leaves(row))
    words = " ".join(one for one in there if isinstance(one, str))
    known = {one for one in leaves(finding) if isinstance(one, str | float | int)} - there - set(but)
    return {one for one in known if (one if isinstance(one, str) else f"{one:g}") not in words}


# --- schemas ----------------------------------------------------------------------------------------------------------


def pointed(schema: Row, root: Row) -> Row:
    """A schema with its reference followed."""
    while "$ref" in schema:
        found: Any = root
        for part in schema["$ref"].removeprefix("#/").split("/"):
            found = found[part]
        schema = found
    return schema


def parts(schema: Row, root: Row) -> list[Row]:
    """The schemas that may describe a value: itself, and its alternatives."""
    here = pointed(schema, root)
    return [here, *(one for word in ("oneOf", "anyOf") for each in here.get(word, ()) for one in parts(each, root))]


def compare(value: Any, schema: Row, root: Row, seen: dict[str, set[str]], place: str = "") -> Iterator[str]:
    """Keys that no schema names; `seen` gathers by place what the schemas name and what was there."""
    every = parts(schema, root)
    if isinstance(value, list):
        for one in value:
            for items in [each["items"] for each in every if "items" in each][:1]:
                yield from compare(one, items, root, seen, f"{place}[]")
    if not isinstance(value, dict):
        return
    known = {key: one for each in every for key, one in each.get("properties", {}).items()}
    patterns = {key: one for each in every for key, one in each.get("patternProperties", {}).items()}
    free = [each["additionalProperties"] for each in every if isinstance(each.get("additionalProperties"), dict)]
    seen.setdefault(f"{place} names", set()).update(known, patterns)
    there = seen.setdefault(f"{place} has", set())
    for key, one in value.items():
        pattern = next((each for each in patterns if re.search(each, key)), None)
        below = known.get(key, patterns[pattern] if pattern else free[0] if free else None)
        there.add(key if key in known else pattern or key)
        if below is None:
            yield f"{place}.{key}"
        else:
            yield from compare(one, below, root, seen, f"{place}.{key}")


def undocumented(found: Sequence[Row], schema: Row, root: Row) -> set[str]:
    """Keys of rows that the schema does not name."""
    return {key for row in found for key in compare(row, schema, root, {})}


def unwritten(found: Sequence[Row], schema: Row, root: Row) -> set[str]:
    """Keys that the schema names and no row has."""
    seen: dict[str, set[str]] = {}
    for row in found:
        list(compare(row, schema, root, seen))
    places = {place.removesuffix(" names") for place in seen if place.endswith(" names")}
    return {f"{place}.{key}" for place in places for key in seen[f"{place} names"] - seen[f"{place} has"]}


# --- the findings -----------------------------------------------------------------------------------------------------


def quantity_of(fill: Filler, facts: Any) -> Quantity:
    """A quantity of which nothing but what a row holds is filled."""
    return Quantity(
        request=REQUESTS[type(facts)], epoch=fill.value(Epoch), unit="km", value=fill.value(np.ndarray[Any, Any]),
        partials=np.zeros((0, 0)), names=(), facts=facts,
    )  # fmt: skip


def answered_of(kind: type) -> tuple[Answered, tuple[Any, ...]]:
    """A prediction with facts of a kind, and the numbers of an encounter that its row does not repeat."""
    fill = Filler(sigmas=QuantitySigmas)
    facts = fill.of(kind)
    encounter = facts.encounter if isinstance(facts, EntryFacts) else facts
    but: tuple[Any, ...] = ()
    if isinstance(encounter, EncounterFacts) and encounter.ground is not None:
        but = (encounter.ground.latitude_geocentric_deg,)  # an impact is told by its geodetic place
        if encounter is not facts:
            but += (encounter.speed_km_s,)  # that of the entry stands in its place
    lower = np.tril(np.arange(1.0, 10.0).reshape(3, 3) + 500.0)
    own = {"quantity": quantity_of(fill, facts), "factor": lower, "factor_formal": lower + np.tril(np.ones((3, 3)))}
    return fill.of(Answered, **own), but


def unanswered_of(kind: type) -> Unanswered:
    fill = Filler()
    facts = fill.of(kind)
    return fill.of(Unanswered, missing=fill.of(Missing, request=REQUESTS[kind], facts=facts, disc=None, names=()))


FACTS = (SkyFacts, StateFacts, EncounterFacts, EntryFacts)


@pytest.mark.parametrize("kind", [*FACTS, ValueFacts])
def test_every_number_of_a_prediction_is_written(kind: type) -> None:
    found, but = answered_of(kind)
    assert not lost(found, prediction_rows.prediction(found), but)


def test_the_rows_of_predictions_are_those_of_the_schema() -> None:
    made = [prediction_rows.prediction(answered_of(kind)[0]) for kind in (*FACTS, ValueFacts)]
    assert not undocumented(made, RUN["$defs"]["prediction"], RUN)
    # covariances are null or matrices, the rest is there as filled
    open_ = replace(answered_of(SkyFacts)[0], nonlinearity=Nonlinearity(orbits=2, reason="none"), drawn=None)
    made.append(prediction_rows.prediction(open_))
    assert not unwritten(made, RUN["$defs"]["prediction"], RUN)
    missing = [prediction_rows.prediction(unanswered_of(kind)) for kind in (*FACTS, ImpactFacts, BodyFacts)]
    assert not undocumented(missing, RUN["$defs"]["unanswered"], RUN)
    assert not unwritten(missing, RUN["$defs"]["unanswered"], RUN)


@pytest.mark.parametrize("kind", [*FACTS, ImpactFacts, BodyFacts])
def test_every_number_of_a_prediction_without_an_answer_is_written(kind: type) -> None:
    found = unanswered_of(kind)
    encounter = found.missing.facts.encounter if isinstance(found.missing.facts, EntryFacts) else found.missing.facts
    but = ()
    if isinstance(encounter, EncounterFacts) and encounter.ground is not None:
        but = (encounter.ground.latitude_geocentric_deg, encounter.speed_km_s)  # type: ignore[assignment]
    assert not lost(found, prediction_rows.prediction(found), but)


def test_too_few_drawn_orbits_have_the_keys_of_enough() -> None:
    few = prediction_rows.drawn_spread(DrawnSpread(runs=3, undefined=2, cloud=None), "km")
    assert not undocumented([few], RUN["$defs"]["prediction"]["properties"]["monte_carlo"], RUN)


def required_of(fill: Filler, assumed: bool) -> RequiredPosition:
    sources = () if assumed else (fill.value(str),)
    position = Position(
        telescope=fill.value(str), problem=None, sources=sources, sigma_km=fill.value(float), assumed=assumed  # type: ignore[arg-type]
    )  # fmt: skip
    return fill.of(RequiredPosition, position=position, unit="km")


def curve_of(fill: Filler) -> Curve:
    totals = {name: fill.value(np.ndarray[Any, Any]) for name in WORLDS}
    return fill.of(Curve, unit="km", measurements=fill.of(CountCurve, totals=totals))


def share_of(sigmas: type) -> Any:
    fill = Filler(sigmas=sigmas)
    return fill.of(StateShare if sigmas is StateSigmas else QuantityShare)


def shared_of(fill: Filler) -> SharedError:
    return fill.of(
        SharedError, kind="bias", rows=np.array([0, 1]), significance={"bias": 9.5, "wander": 8.25}, span_s=(0.0, 1.0),
        merit=0.0, worth=0.0,
    )  # fmt: skip


def shared_row(found: SharedError) -> Row:
    records = SimpleNamespace(utc=np.array(["2029-01-01", "2029-01-02"]), t_s=np.array([0.0, 1.0]))
    led: Any = SimpleNamespace(material=SimpleNamespace(astrometry=records))
    general: Any = SimpleNamespace(scene=SimpleNamespace(epoch=Epoch(2460000.5, 0.0)))
    return fit_summary.shared_error(found, led, general)


SIMPLE: dict[str, tuple[Callable[[], Any], Callable[[Any], Row], Row, tuple[str, ...]]] = {
    "budget": (lambda: share_of(StateSigmas), rows.state_share, RUN["$defs"]["source"], ()),
    "required": (lambda: required_of(Filler(), False), rows.required_position, RUN["$defs"]["required_position"], ()),
    "curve": (lambda: curve_of(Filler()), rows.curve, RUN["$defs"]["curve"], ()),
    "accuracies": (
        lambda: Filler().of(Accuracies, unit="km"), rows.accuracies, RUN["$defs"]["five_accuracies"], (),
    ),
    "ratio": (
        lambda: Filler().of(NoiseRatio), lambda one: rows.noise_to_nuisance(one, [required_of(Filler(), True)]),
        RUN["$defs"]["noise_to_nuisance"], (),
    ),
    "consistency": (lambda: Filler().of(StateNees), rows.state_nees, RUN["$defs"]["trials"], (".estimator",)),
    "impact": (
        lambda: Filler().of(Impact, encounter=Filler().of(EncounterFacts, speed_km_s=1001.0, capture_radius_km=None)),
        prediction_rows.impact, RUN["$defs"]["impact"], (),
    ),
    "ahead": (
        lambda: Filler().of(Ahead, approaches=(), in_reach=()), fit_summary.ahead_block,
        FIT["properties"]["ahead"]["oneOf"][1], (),
    ),
    "shared error": (lambda: shared_of(Filler(2)), shared_row, FIT["$defs"]["shared_error"], ()),
    "ended": (lambda: Filler().of(Ended), fit_summary.ended, FIT["properties"]["further"]["items"]["oneOf"][1], ()),
    "station": (lambda: Filler(2).of(StationResiduals), fit_summary.station, FIT["$defs"]["station"], ()),
    "rejected": (lambda: Filler(2).of(Rejected), fit_summary.rejected_observation, FIT["$defs"]["rejected"], ()),
    "reference": (lambda: Filler(6).of(Comparison), fit_summary.reference_orbit, FIT["$defs"]["reference"], ()),
    "force": (
        lambda: Filler().of(MissingForce, name="a1_au_d2", merit=1001.0, column=np.zeros(0), pull=np.zeros(0)),
        fit_summary.missing_force, FIT["$defs"]["missing_force"], (),
    ),
}  # fmt: skip
OF_A_FIT = ("ahead", "shared error", "ended", "station", "rejected", "reference", "force")
TOLD_OTHERWISE = {"force": ("a1_au_d2", 1001.0), "impact": (1001.0,), "shared error": (0.0, 0, 1, 1.0)}


@pytest.mark.parametrize("name", SIMPLE)
def test_a_finding_its_row_and_its_schema_agree(name: str) -> None:
    make, write, schema, elsewhere = SIMPLE[name]
    found = make()
    row = write(found)
    but = TOLD_OTHERWISE.get(name, ())
    if name == "impact":
        but += (found.encounter.ground.latitude_geocentric_deg,)
    if name == "shared error":
        but += tuple(leaves(found.size_rad))  # told in arcsec
    assert not lost(found, row, but)
    assert not undocumented([row], schema, FIT if name in OF_A_FIT else RUN)
    assert unwritten([row], schema, FIT if name in OF_A_FIT else RUN) <= set(elsewhere)


KINDS = {
    "nees": outcomes.Outcome, "cramer_von_mises": outcomes.Outcome, "coverage": outcomes.CoverageOutcome,
    "whitened": outcomes.ComponentOutcome, "directions": outcomes.DirectionOutcome,
    "predictions": outcomes.PredictionOutcome, "nis": outcomes.TelescopeOutcome,
}  # fmt: skip


@pytest.mark.parametrize("name", KINDS)
def test_the_outcome_of_a_test_of_a_campaign_is_written_as_documented(name: str) -> None:
    fill = Filler()
    own: Row = {"law": outcomes.CramerVonMises()}
    if name == "directions":
        own["direction"] = fill.of(outcomes.Direction, weights=np.zeros(0))
    found = fill.of(KINDS[name], **own)
    schema = CAMPAIGN["properties"]["estimators"]["items"]["properties"]["judged"]["properties"]["true"]
    here = schema["properties"][name]
    row = verdict_rows.outcome(found)
    assert not lost(found, row)
    assert not undocumented([row], here.get("items", here), CAMPAIGN)
    assert not unwritten([row], here.get("items", here), CAMPAIGN)


def test_a_field_that_no_row_has_is_found() -> None:
    """The test can fail: a number taken out of a row, and a key that the schema does not know."""
    found = share_of(StateSigmas)
    row = rows.state_share(found)
    del row["share_velocity"]
    assert lost(found, row) == {found.share_velocity}
    assert unwritten([row], RUN["$defs"]["source"], RUN) == {".share_velocity"}
    assert undocumented([row | {"new": 1}], RUN["$defs"]["source"], RUN) == {".new"}
