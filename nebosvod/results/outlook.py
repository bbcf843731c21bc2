"""What a summary says of its predictions at first sight: impacts with their probability, and what has no answer.

Rows of `predictions` -> rows of `impacts` and sentences, the same for runs and fits, on the terminal and in the report.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from nebosvod.impacts.chance import chance_words
from nebosvod.results.ahead_words import CALLED
from nebosvod.timescale import SECONDS_PER_DAY, Epoch

Row = Mapping[str, Any]
ANSWERED = "answered"  # status of a prediction that exists


def answered(rows: Iterable[Row]) -> list[Any]:
    """The predictions that exist; those of a run before there were others have no status."""
    return [row for row in rows if row.get("status", ANSWERED) == ANSWERED]


def without_answer(rows: Iterable[Row]) -> list[Any]:
    """The predictions that do not exist for their orbit."""
    return [row for row in rows if row.get("status", ANSWERED) != ANSWERED]


def unit_of(row: Row) -> str:
    """The unit a prediction is given in: "km", "arcsec", "m_s"."""
    return next((key.removeprefix("semi_axes_") for key in row if key.startswith("semi_axes_")), "km")


def impact_sentences(summary: Row) -> Iterator[str]:
    """When, how likely, and where on the ground; one sentence for each encounter that may be an impact."""
    for one in summary.get("impacts") or ():
        drawn = one["impact_probability_monte_carlo"]
        said = f"probability {chance_words(one['impact_probability_linear'])} (linear)"
        if drawn and drawn["runs"]:
            low, high = drawn["interval_95"]
            share = chance_words(drawn["probability"]) if drawn["hits"] else f"{drawn['hits']} hits"
            said += f", {share} by {drawn['runs']} drawn orbits (95 % interval {low:.3g} to {high:.3g})"
            if not low <= one["impact_probability_linear"] <= high:
                said += ": the linear one is not to be believed"
        called, sigma = CALLED.get(one["body"], one["body"].capitalize()), one["sigma_time_s"]
        when = moment_words(one["closest_approach_tdb"], one["time_scale"])
        if sigma is not None and sigma < SECONDS_PER_DAY:
            when += f" +- {duration_words(sigma)}"
        if one["nominal_impact"]:
            place = ""
            if one["impact_longitude_deg"] is not None:
                place = f", on the ground at {place_words(one['impact_longitude_deg'], one['impact_latitude_deg'])}"
            yield f"Impact on {called}: {said}; the nominal orbit hits on {when}{place}"
        else:
            yield (
                f"Impact on {called}: {said}; the nominal orbit misses its centre by "
                f"{one['closest_distance_km']:.0f} km on {when}"
            )


def unanswered_sentences(rows: Sequence[Row]) -> Iterator[str]:
    """Each prediction of the first estimator that does not exist for its orbit, and why."""
    first = rows[0]["estimator"] if rows else ""
    for row in without_answer(rows):
        if row["estimator"] == first:
            chance = row.get("impact_probability_linear")
            more = "" if chance is None else f"; probability of impact {chance_words(chance)} (linear)"
            yield f"{row['name']} ({row['plane']}): no answer: {row['reason']}{more}"


def event_words(row: Row) -> str:
    """When and where an encounter or an entry happens, with sigmas; empty for what was asked about a given time."""
    if "body" not in row:
        return ""
    text = moment_words(row["epoch_tdb"], row.get("time_scale", "tdb"))
    sigma = row.get("sigma_time_s")
    if sigma is not None and sigma < SECONDS_PER_DAY:
        text += f" +- {duration_words(sigma)}"
    if "latitude_deg" in row:
        text += f", {place_words(row['longitude_deg'], row['latitude_deg'])} geodetic"
        text += f" (1 sigma {row['sigma_longitude_deg']:.2g} and {row['sigma_latitude_deg']:.2g} deg)"
    if (row.get("nonlinearity") or {}).get("misleads"):
        text += "; these sigmas are linear, which misleads here"
    return text


def bent_words(measure: float | None, chord: float | None) -> str:
    """What makes a linear ellipse mislead: its second-order term, or orbits that have no such prediction."""
    text = f"the second-order term is {measure:.2g} of its sigmas"
    return text if chord is None else f"{text}, and an orbit at {2.0 * chord:.2g} sigma has no such prediction"


def moment_words(tdb: str, scale: str) -> str:
    """A time of the summary to the second, in the scale a reader is told it in."""
    return Epoch.parse(tdb).iso("utc" if scale == "utc" else "tt" if scale == "tt" else "tdb", 0)


def place_words(longitude_deg: float, latitude_deg: float) -> str:
    """`23.830 E, 21.290 S`."""
    return (
        f"{abs(longitude_deg):.3f} {'E' if longitude_deg >= 0.0 else 'W'}, "
        f"{abs(latitude_deg):.3f} {'N' if latitude_deg >= 0.0 else 'S'}"
    )


def duration_words(seconds: float) -> str:
    """A time with a unit that suits it."""
    for size, unit in ((3600.0, "h"), (60.0, "min")):
        if seconds >= 2.0 * size:
            return f"{seconds / size:.2g} {unit}"
    return f"{seconds:.2g} s"
