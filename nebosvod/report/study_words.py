"""A study in sentences: what was varied, what came out, because of what, whether to believe it, what would do."""

from collections.abc import Mapping
from typing import Any

from markupsafe import Markup

from nebosvod.report.kit import short
from nebosvod.report.kit.wording import count, join, quantity
from nebosvod.report.study_population import population_words

Item = Mapping[str, Any]
Cell = str | Markup
SENTENCES = 3  # rows without an answer that are named
MOST_NAMED = 40  # values, from which on their number tells nothing


def verdict(found: Item) -> Cell:
    """The answer in one sentence."""
    find = found["find"]
    if find is None and found.get("population"):
        return population_words(found["population"])
    if find is None:
        return _required_words(found) or _plain_words(found)
    if not find["found"]:
        return Markup("No point keeps every condition: {}.").format(find["reason"])
    units = {one["name"]: page_unit(one["unit"]) for one in (*found["vary"], *found["answers"])}
    values = [
        Markup("{} {}").format(name, quantity(value, units.get(name, ""), 4) if is_number(value) else value)
        for name, value in find["values"].items()
    ]
    least = "least" if find["direction"] == "minimise" else "largest"
    which = "that keeps every condition" if find["where"] else "of all points"
    return Markup("The {} {} {}: {}.").format(least, find["objective"], which, join(values))


def _plain_words(found: Item) -> Cell:
    """What a study that looks for nothing says first: what moves an answer most, or between what it lies."""
    moved = next((one for one in found["sensitivity"] if one["indices"]), None)
    if moved is not None:
        most = max(moved["indices"], key=lambda row: row["total"])
        return Markup("{} moves {} most: {} of its variance, with all interactions.").format(
            most["name"], moved["answer"], quantity(most["total"], "", 2)
        )
    answer = next((one for one in found["answers"] if not one["shares"] and one["n"]), None)
    if answer is None:
        return Markup("{}.").format(count(found["n_points"], "point"))
    low, high = (quantity(answer[key], page_unit(answer["unit"]), 4) for key in ("least", "largest"))
    return Markup("{}: {} to {} at {}.").format(answer["name"], low, high, count(answer["n"], "point"))


def _required_words(found: Item) -> Cell | None:
    """What would do by itself, in a sentence."""
    wanted = found["require"]
    if wanted is None:
        return None
    each = [
        Markup("{} {}").format(one["name"], quantity(one["needed"], page_unit(one["unit"]), 4))
        for one in wanted["each"]
        if one["needed"] is not None
    ]
    if not each:
        return Markup("{} {}: none of these things decides it by itself.").format(wanted["answer"], wanted["wanted"])
    return Markup("{} {}, by one of these alone: {}.").format(wanted["answer"], wanted["wanted"], join(each, "or"))


def together(found: Item) -> Cell | None:
    """All together at least cost, in a sentence."""
    wanted = found["require"]
    if wanted is None or not wanted["together"]:
        return None
    units = {one["name"]: page_unit(one["unit"]) for one in wanted["each"]}
    values = wanted["together"]["values"].items()
    return Markup("Together at least cost: {}; cost {}, where all equally many times better cost {}.").format(
        join(Markup("{} {}").format(name, quantity(value, units[name], 4)) for name, value in values),
        quantity(wanted["together"]["cost"], "", 4), quantity(wanted["together"]["cost_equally"], "", 4),
    )  # fmt: skip


def page_unit(unit: str) -> str:
    """A unit as the page's ladder of units knows it."""
    return unit.replace("m/s", "m_s")


def is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _varied(one: Item) -> Cell:
    if one["numeric"]:
        ends = Markup("{:.4g} to {:.4g}").format(one["least"], one["largest"])
        return Markup("<b>{}</b> ({}): {} {}, {}").format(
            one["name"], join(one["set"]), ends, one["unit"], count(one["n_values"], "value")
        )
    if not one["set"]:
        return Markup("<b>{}</b>: {}").format(one["name"], f"{one['n_values']:,}")
    return Markup("<b>{}</b> ({}): {}").format(one["name"], join(one["set"]), join(str(v) for v in one["values"] or []))


def _leading(one: Item) -> Cell:
    """Which source leads at how many points."""
    ranked = sorted(one["leading"].items(), key=lambda item: -item[1])
    return Markup("largest share: {}").format(join(f"{name} at {points}" for name, points in ranked))


def answers(found: Item) -> list[tuple[str, list[Cell]]]:
    """Question and answer, the answer first and what stands behind it after."""
    said: list[tuple[str, list[Cell]]] = [("Varied", _all_varied(found))] if found["vary"] else []
    if looked := _looked_for(found):
        said.append(("Looked for", [looked]))
    if ranges := _ranges(found):
        said.append(("How accurate", ranges))
    if reasons := _reasons(found):
        said.append(("Because of what", reasons))
    said.append(("Can it be believed", _belief(found)))
    helps = [one for one in (_required_words(found) if found["find"] is None else None, together(found)) if one]
    if helps:
        said.append(("What would help", helps))
    return said


def _all_varied(found: Item) -> list[Cell]:
    """What was varied, by name and range; with the keys of the mission behind it."""
    brief = [Markup("<b>{}</b> {}").format(one["name"], _range(one)) for one in found["vary"]]
    return [short.as_many(brief[0], brief[1:]), *(Markup("{}.").format(_varied(one)) for one in found["vary"])]


def _range(one: Item) -> Cell:
    """The range of what is varied, or how many there are of it."""
    if one["numeric"]:
        unit = f" {one['unit']}" if one["unit"] else ""
        ends = f"{one['least']:.4g} to {one['largest']:.4g}{unit}"
        return ends if one["n_values"] > MOST_NAMED else f"{ends} ({count(one['n_values'], 'value')})"
    return count(one["n_values"], "value")


def _looked_for(found: Item) -> Cell | None:
    """What was minimised or maximised, under which conditions."""
    find = found["find"]
    if not find:
        return None
    where = ", ".join(f"{one['name']} {one['condition']}" for one in find["where"])
    cost = Markup("; cost = <code>{}</code>").format(find["cost"]) if find["cost"] else ""
    return Markup("{} {}{}{}.").format(find["direction"], find["objective"], f", where {where}" if where else "", cost)


def _ranges(found: Item) -> list[Cell]:
    """Each answer from its least to its largest value, with the median."""
    said = []
    for one in found["answers"]:
        if one["shares"] or not one["n"]:
            continue
        unit = page_unit(one["unit"])
        least, median, largest = (quantity(one[key], unit, 3) for key in ("least", "median", "largest"))
        if one["least"] == one["largest"]:
            said.append(Markup("<b>{}</b> {}").format(one["title"], median))
        else:
            said.append(Markup("<b>{}</b> {} to {}, median {}").format(one["title"], least, largest, median))
    if not said:
        return []
    first = short.as_many(said[0], said[1:])
    return [first] if len(said) == 1 else [first, Markup("{}.").format(Markup("; ").join(said))]


def _reasons(found: Item) -> list[Cell]:
    """What moves the answers, and which sources lead at how many points."""
    said: list[Cell] = []
    for one in found["sensitivity"]:
        ranked = sorted(one["indices"], key=lambda row: -row["total"])
        parts = join(Markup("{} {}").format(row["name"], quantity(max(row["total"], 0.0), "", 2)) for row in ranked)
        if ranked:
            said.append(Markup("Part of the variance of {}, with interactions: {}.").format(one["answer"], parts))
    for one in found["answers"]:
        if one["shares"] and one["leading"]:
            said.append(Markup("{}{}: {}.").format(one["name"][:1].upper(), one["name"][1:], _leading(one)))
    return said


def _belief(found: Item) -> list[Cell]:
    """How the points were computed, and which have no answer."""
    lost = found["n_failed"] + found["n_without_answer"]
    whole = f"all {count(found['n_rows'], 'row')} answered" if found["n_rows"] > 1 else "the row answered"
    head = f"{lost} of {count(found['n_rows'], 'row')} without an answer" if lost else whole
    caution = "With caution" if lost else "Yes, as far as the mission's error model holds"
    told: list[Cell] = [Markup("<b>{}</b>: {}; {}.").format(caution, head, found["method"])]
    for one in found["failures"][:SENTENCES] if lost else ():
        told.append(f"Row {one['row']}: {one['message']}.")
    return told
