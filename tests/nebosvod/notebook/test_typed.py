"""Typed summaries say what the JSON says: each key is met by a field, in the unit and scale that the key ends with."""

import importlib
import inspect
import re
import runpy
import warnings
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from astropy import units as u
from astropy.time import Time

import nebosvod

ROOT = Path(__file__).resolve().parents[3]
SPELT = {"km_s": "km / s", "m_s": "m / s", "arcsec_h": "arcsec / h", "kg_m3": "kg / m3"}
STUDY = """
schema_version: 1
study: two
mission: minimal
vary: {sigma: {set: telescopes.*.noise.sigma, values: [0.05 arcsec, 0.1 arcsec]}}
answer: [{name: position, of: predictions.ten days later.semi_axes_km.0}]
find: {minimise: position, where: {position: "< 1e6 km"}}
"""


def met(row: Mapping[str, Any], typed: Any, unit: str = "") -> None:
    """Every key of a block of JSON is met by a field, and every field that has something by a key."""
    names = {one.name: one.name.rstrip("_") for one in fields(typed)}
    used = set()
    for key, value in row.items():
        name = max((n for n, stem in names.items() if key == stem or key.startswith(f"{stem}_")), key=len)
        used.add(name)
        ending = key.removeprefix(names[name]).removeprefix("_")
        same(value, getattr(typed, name), ending or unit, key)
    assert {name for name in names if getattr(typed, name) is not None} <= used


def same(value: Any, typed: Any, unit: str, key: str) -> None:
    """A value of JSON and what it became."""
    if value is None:
        assert typed is None, key
    elif isinstance(typed, Time):
        scale = unit.removeprefix("jd_") or key
        told = getattr(typed, scale)
        day = Time(*np.atleast_1d(value), format="jd", scale=scale) if unit.startswith("jd") else _moments(value, scale)
        digit = 1e-3 if "." in str(np.ravel(value)[0]) else 0.5  # of the text
        assert np.all(np.abs((told - day).to_value("s")) <= digit), key
    elif isinstance(typed, u.Quantity):
        unit = unit or key.rpartition("_")[2] * ("_" in key)
        assert typed.to_value(SPELT.get(unit, unit)) == pytest.approx(np.array(value, float), rel=1e-9), key
    elif is_dataclass(typed):
        met(value, typed, unit)
    elif isinstance(typed, Mapping):
        assert typed.keys() == value.keys(), key
        for name, one in value.items():
            same(one, typed[name], unit, name)
    elif isinstance(typed, tuple):
        for mine, theirs in zip(value, typed, strict=True):
            same(mine, theirs, unit, key)
    elif isinstance(typed, np.ndarray):
        assert typed == pytest.approx(np.array(value, float), nan_ok=True), key
    else:
        assert (type(typed), typed) == (type(value), value) or typed == pytest.approx(value), key


def _moments(value: Any, scale: str) -> Time:
    return Time(np.char.replace(np.array(value), f" {scale.upper()}", "").tolist(), format="isot", scale=scale)


@pytest.fixture(scope="module")
def impactor() -> Any:
    """An orbit that hits: two telescopes at L1, a day before."""
    return nebosvod.run("soda-like")


Made = Callable[[Any, Path], Any]
ANSWERS: dict[str, Made] = {
    "ephemeris": lambda orbit, _: nebosvod.ephemeris(orbit, "2030-02-14", "2030-02-14T12:00", step="6 h", site="F51"),
    "approaches": lambda orbit, _: nebosvod.approaches(orbit, "2030-02-14", "2030-02-20"),
    "risk": lambda orbit, _: nebosvod.risk(orbit, "2030-02-20", draws=60),
    "alert": lambda _, __: nebosvod.alert("first-hours", hours=[3], sites="F51"),
    "plan": lambda _, __: nebosvod.plan("minimal", visits=1),
    "decision": lambda orbit, _: nebosvod.plan(
        orbit,
        decide=True,
        telescope="F51",
        sigma="0.2 arcsec",
        start="2030-02-14T12:00",
        end="2030-02-14T18:00",
        step="2 h",
        until="2030-02-20",
        draws=500,
        truths=100,
    ),
    "study": lambda _, here: nebosvod.study(_study(here), output=here / "two", workers=1),
    "validation": lambda _, here: nebosvod.validate("minimal", 20, output=here / "trust", workers=1),
    "comparison": lambda orbit, _: nebosvod.compare(orbit, orbit),
}


def _study(here: Path) -> Path:
    (here / "two.yaml").write_text(STUDY, "utf-8")
    return here / "two.yaml"


@pytest.mark.filterwarnings("ignore:.*dubious year:erfa.ErfaWarning")  # leap seconds to come are not known
@pytest.mark.parametrize("kind", ANSWERS)
def test_what_is_typed_is_what_the_json_says(kind: str, impactor: Any, tmp_path: Path) -> None:
    answer = ANSWERS[kind](impactor, tmp_path)
    typed = answer.typed
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # what a notebook shows brings no warning with it
        assert len(repr(typed)) < 1500
        assert "<caption>" in typed._repr_html_()
    met(answer.summary, typed)


MODULES = sorted(path.stem for path in (ROOT / "nebosvod" / "notebook" / "summaries").glob("*.py"))


@pytest.mark.parametrize("name", [one for one in MODULES if one not in ("__init__", "reading", "shape", "typed")])
def test_every_field_of_a_class_is_described(name: str) -> None:
    module = importlib.import_module(f"nebosvod.notebook.summaries.{name}")
    own = [one for one in vars(module).values() if isinstance(one, type) and one.__module__ == module.__name__]
    assert any(one.__name__.endswith("Summary") for one in own)
    for kind in own:
        words = (inspect.getdoc(kind) or "").partition("----------\n")[2]
        said = ",".join(re.findall(r"^([a-zA-Z_][\w,\s]*?) :", words, re.MULTILINE))
        assert sorted(re.findall(r"\w+", said)) == sorted(one.name for one in fields(kind))  # type: ignore[arg-type]


def test_the_classes_are_those_of_the_schemas() -> None:
    made = dict(runpy.run_path(str(ROOT / "tools" / "summaries.py"))["Writer"]().modules())
    place = ROOT / "nebosvod" / "notebook" / "summaries"
    assert len(made) == 10
    assert {name: (place / f"{name}.py").read_text("utf-8") for name in made} == made, "run `make schema`"
