"""What if: sliders for every source, over the linear problem that the run folder keeps (`findings/what_if`)."""

import base64
import json
from dataclasses import dataclass
from typing import Any

import numpy as np

from nebosvod.mission.vocabulary import PLANES
from nebosvod.report.kit import wording
from nebosvod.report.kit.facts import leading
from nebosvod.report.kit.typography import Verbatim
from nebosvod.results.folder import Item, RunFolder
from nebosvod.results.outlook import unit_of

SCALED = {"km": "km", "arcsec": "arcsec", "m_s": "m/s", "km_s": "km/s", "s": "s"}  # shown as they are, without prefix
MOST_BYTES = 1_550_000  # of data in a page; with the rest it stays below 3 MB


@dataclass(frozen=True, slots=True, kw_only=True)
class Sliders:
    """The block of the page: its data as JSON, and what is said about it.

    `reason` : why it answers with the gain as it is alone; None where both answers are there.
    """

    data: Verbatim
    estimator: str
    reason: str | None
    bent: tuple[str, ...]


def sliders(run: RunFolder, main: Item | None) -> Sliders | None:
    """The block for the estimator the report speaks of; None where the folder keeps no problem of it."""
    kept = run.summary.get("what_if")
    if main is None or not kept or kept["estimator"] != main["name"]:
        return None
    arrays = {name: np.asarray(one) for name, one in run.arrays.items() if name.startswith("what_if_")}
    of_name = {p["name"]: p for p in leading(run, main)}
    shown = [name for name in of_name if name in kept["predictions"]]
    number = {name: kept["predictions"].index(name) for name in shown}
    if not shown or f"what_if_shares_{number[shown[0]]}" not in arrays:
        return None
    if 4 * sum(one.size * 8 for one in _without_twins(arrays).values()) > 3 * MOST_BYTES:
        arrays = {name: one for name, one in arrays.items() if name.startswith("what_if_shares_")}
        kept = {**kept, "reason": "the measurements behind it take more room than a page has"}
    model: dict[str, Any] = {
        "reason": kept["reason"],
        "parameters": kept["parameters"],
        "blocks": kept["blocks"],
        "sources": kept["sources"],
        "predictions": [_prediction(of_name[name]) for name in shown],
        "arrays": _packed(arrays, [number[name] for name in shown]),
    }
    text = json.dumps(model, ensure_ascii=True, separators=(",", ":"), sort_keys=True).replace("<", "\\u003c")
    bent = tuple(name for name in shown if (of_name[name].get("nonlinearity") or {}).get("misleads"))
    return Sliders(data=Verbatim(text), estimator=main["name"], reason=kept["reason"], bent=bent)


def _prediction(found: Item) -> dict[str, Any]:
    """Name, words and unit of a prediction, and the axes it is drawn on."""
    unit = unit_of(found)
    return {
        "name": found["name"],
        "plane": str(wording.plane_name(found["plane"], found.get("body"))),
        "unit": "" if unit == "1" else wording.scale_of(1.0, unit)[1] if unit not in SCALED else SCALED[unit],
        "axes": list(PLANES[found["plane"]].symbols),
    }


def _packed(arrays: dict[str, Any], order: list[int]) -> dict[str, dict[str, Any]]:
    """Arrays as base64 of little-endian doubles with their shapes; those of predictions in the order shown."""
    renamed = {}
    for name, one in arrays.items():
        stem, _, last = name.rpartition("_")
        if stem in ("what_if_shares", "what_if_partials"):
            if int(last) in order:
                renamed[f"{stem}_{order.index(int(last))}"] = one
        else:
            renamed[name] = one
    return {
        name: {"shape": list(one.shape), "data": base64.b64encode(one.astype("<f8").tobytes()).decode()}
        for name, one in _without_twins(renamed).items()
    }


def _without_twins(arrays: dict[str, Any]) -> dict[str, Any]:
    """The arrays but for truths that are as assumed: the script takes the assumption for them."""
    twins = {name: name.removesuffix("_true") for name in arrays if name.endswith("_true")}
    same = {name for name, other in twins.items() if np.array_equal(arrays[name], arrays[other])}
    return {name: one for name, one in arrays.items() if name not in same}
