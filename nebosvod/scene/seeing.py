"""What a telescope sees of a schedule, in words: how much, how faint, and how far the rest is from its limits."""

import numpy as np

from nebosvod.mission import Mission
from nebosvod.observation import Telescope, Visibility
from nebosvod.units import DEG

_OF_ANGLES = {  # limit -> what the angle is
    "twilight": "the Sun is too high",
    "sun": "from the Sun",
    "altitude": "the object is too low",
    "earth": "from the Earth's limb",
    "moon": "from the Moon's limb",
}


def nearest_words(telescope: Telescope, seen: Visibility, mission: Mission) -> str:
    """How far the nearest lost exposure is from every limit that removes it, and when; empty where none is lost."""
    k = seen.nearest
    if k is None:
        return ""
    lacks = [_lack(telescope, seen, limit, k) for limit, mask in seen.removed.items() if mask[k]]
    when = (mission.reference_epoch + float(seen.t_s[k])).iso(mission.reference_epoch.scale, 0)
    return f"; nearest at {when}: {', '.join(lacks)}"


def _lack(telescope: Telescope, seen: Visibility, limit: str, k: int) -> str:
    """What one limit asks, what there is, and the difference."""
    if limit == "duty":
        return "outside the spans of its duty"
    short = float(seen.short[limit][k])
    if limit == "magnitude":
        V, allowed = float(seen.apparent_magnitude[k]), telescope.limiting_magnitude or 0.0
        trailed = V - allowed < short - 0.005
        trail = f" ({V + short - (V - allowed):.2f} as it trails)" if trailed else ""
        return f"V {V:.2f}{trail}, {short:.2f} mag fainter than {allowed:.4g}"
    missing = f"{_degrees(short)} deg"
    if limit == "twilight":
        return f"the Sun at altitude {seen.sun_altitude_rad[k] / DEG:.1f} deg, {missing} too high"
    if limit == "altitude":
        return f"at altitude {seen.altitude_rad[k] / DEG:.1f} deg, {missing} too low"
    angle = {"sun": seen.sun_angle_rad, "earth": seen.earth_limb_rad, "moon": seen.moon_limb_rad}[limit][k]
    if limit == "sun" and telescope.largest_sun_rad is not None and angle > telescope.largest_sun_rad:
        return f"{angle / DEG:.1f} deg from the Sun, {missing} too far"
    if angle < 0.0:
        return f"behind or before the {limit.capitalize()}'s disc, {missing} within what is allowed"
    return f"{angle / DEG:.1f} deg {_OF_ANGLES[limit]}, {missing} too near"


def _degrees(angle_rad: float) -> str:
    """Degrees with a digit that says something."""
    value = angle_rad / DEG
    return f"{value:.1f}" if value >= 1.0 else f"{value:.2g}"


def seen_words(telescope: Telescope, seen: Visibility, scheduled: int, mission: Mission) -> str:
    """One line on a telescope: what it sees of its schedule, which limits remove the rest, and how faint it is."""
    n, count = seen.t_s.size, int(np.count_nonzero(seen.visible))
    if not n:
        return "nothing is scheduled"
    told = f"{count} of {n} epochs" if n == scheduled else f"about {100.0 * count / n:.0f} % of {scheduled} epochs"
    lost = ", ".join(f"{limit} {lot}" for limit, lot in seen.counts.items() if lot)
    told += f" (not by {lost}{'' if n == scheduled else f' of {n} looked at'})" if lost else ""
    V = seen.apparent_magnitude[seen.visible] if count else seen.apparent_magnitude
    if not np.isnan(V).any():
        told += f", V {_span(V)}"
        if telescope.limiting_magnitude is not None:
            told += f" (limit {telescope.limiting_magnitude:.4g})"
    angle = seen.sun_angle_rad[seen.visible] / DEG if count else seen.sun_angle_rad / DEG
    told += f", {_span(angle)} deg from the Sun"
    return told if count else told + nearest_words(telescope, seen, mission)


def _span(values: object) -> str:
    """Smallest and largest."""
    low, high = float(np.min(np.asarray(values))), float(np.max(np.asarray(values)))
    return f"{low:.1f}" if f"{low:.1f}" == f"{high:.1f}" else f"{low:.1f} to {high:.1f}"
