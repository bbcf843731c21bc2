"""What was meant where a block of keys is needed and a word or a number stands: the right form, to be copied."""

import re
from collections.abc import Mapping
from typing import get_args

from nebosvod.mission.fields import KeyPath
from nebosvod.mission.vocabulary import PLANES, Method
from nebosvod.mission.yaml.yamlfile import Tree, shown
from nebosvod.units import ANGLE, DURATION, LENGTH, NUMBER, SPEED, Dimension, meant_quantity

# key -> the kind of its number, the block that says it, and the part of the block that the number takes the place of
_ONE_NUMBER: Mapping[str, tuple[Dimension | None, str, str]] = {
    "noise": (ANGLE, "{sigma: 0.1 arcsec}", "0.1 arcsec"),
    "bias": (ANGLE, "{sigma: 0.05 arcsec, treatment: considered}", "0.05 arcsec"),
    "position": (LENGTH, "{sigma: 3 km, correlation: white, treatment: considered}", "3 km"),
    "timing": (DURATION, "{sigma: 1 s, treatment: considered}", "1 s"),
    "plate_scale": (None, "{sigma: 1e-5, field: 10 arcmin, treatment: considered}", "1e-5"),
    "photocentre": (None, "{sigma: 0.1, radius: 10 m, treatment: considered}", "0.1"),
    "process_noise": (SPEED, "{velocity: 0.1 mm/s, over: 30 d, treatment: considered}", "0.1 mm/s"),
    "exclusion": (ANGLE, "{sun: 45 deg}", "45 deg"),
    "trailing": (DURATION, "{exposure: 30 s, fwhm: 1 arcsec}", "30 s"),
    "image": (None, "{magnitude: 20, snr: 10}", "20"),
    "magnitude": (None, "{H: 20}", "20"),
    "monte_carlo": (None, "{runs: 500}", "500"),
    "report": (None, "{sigma_level: 3}", "3"),
    "noise_to_nuisance": (None, "{eta_min: 20 dB}", "20"),
    "prior": (LENGTH, "{sigma: {position: 100 km, velocity: 0.1 m/s}}", "100 km"),
}
_ONE_WORD: Mapping[str, tuple[str, str]] = {
    "object": ("{name: Apophis, orbit: {kind: cometary, ...}}", "Apophis"),
    "estimators": ("{name: batch, method: batch_qr}", "batch_qr"),
    "telescopes": ("{name: A, orbit: {kind: geostationary, longitude: 0 deg}, noise: {sigma: 0.1 arcsec}}", "A"),
    "predictions": ("{name: encounter, plane: b_plane, near: 2029-04-13T21:46:00 TDB}", "b_plane"),
    "schedule": ("{start: 2029-03-01 TDB, end: 2029-04-01 TDB, cadence: 1 d}", ""),
    "force_model": ("{relativity: eih, asteroids: true}", ""),
    "treatment": ("{bias: estimated}", "estimated"),
}
_POINT = "{{kind: libration, point: {}, amplitude: 700000 km}}"
_GEOSTATIONARY = "{kind: geostationary, longitude: 0 deg}"
_LOW = "{kind: sun_synchronous, altitude: 700 km, local_time: 6 h}"
_ORBIT_WORDS: tuple[tuple[str, str], ...] = (  # what is said, as a pattern -> the form
    (r"(se|sun.?earth.?)?l.?1.*|.*halo.*|lissajous|lagrange.*|libration.*", _POINT.format("L1")),
    (r"(se|sun.?earth.?)?l.?2.*", _POINT.format("L2")),
    (r"(earth.?)?(trailing|behind).*|l.?5", "{kind: heliocentric, lead: -60 deg}"),
    (r"(earth.?)?(leading|ahead).*|l.?4|earth.?orbit", "{kind: heliocentric, lead: 60 deg}"),
    (r"(geo|gso|geo.?stationary|geo.?synchronous).*(orbit)?", _GEOSTATIONARY),
    (r"leo|low.?earth.*|sso|sun.?synchronous.*|dawn.?dusk|polar", _LOW),
    (r"heo|gto|elliptic.*|molniya|kepler(ian)?|meo", "{kind: geocentric, a: 26600 km, e: 0.7, i: 63.4 deg}"),
    (r"dro|distant.?retrograde.*", "{kind: distant_retrograde, size: 5e6 km}"),
    (r"helio.*|sun|solar.*|venus.*", "{kind: heliocentric_kepler, a: 0.7 au}"),
    (r"ground.*|site|observatory|station|earth", "{kind: ground, code: F51}"),
    (r"file|ephemeris|trajectory", "{kind: oem, file: NAME.oem}"),
)
_CENTRE = r"(the )?(geo.?cent(re|er|ric)|cent(re|er)( of)?( the)? earth|earth.?cent(re|er)|500|244|248)"
_ENDS = {".bsp": "spk", ".oem": "oem", ".csv": "table", ".txt": "table"}
_SPREAD = re.compile(rf"({NUMBER})\s*([^\d\s+±]*)\s*(?:\+-|\+/-|±)\s*({NUMBER})\s*(\S*)")
_OTHER_WORDS: Mapping[str, str] = {  # of choices, what others call them
    other: word
    for word, others in (
        ("b_plane", "bplane targetplane target opik"),
        ("sky", "radec ra angles plane_of_sky"),
        ("position", "cartesian state xyz"),
        ("rtn", "ric rsw"),
        ("perigee_distance", "perigee periapsis closest_approach"),
        ("distance", "range"),
        ("entry", "impact ground"),
        ("estimated", "solved free solve refined"),
        ("considered", "consider"),
        ("ignored", "ignore neglected"),
        ("fixed", "none known exact"),
        ("recursive", "kalman ekf kf filter srif"),
        ("batch_qr", "leastsquares lsq wls batch qr"),
        ("levenberg_marquardt", "lm"),
        ("white", "random"),
        ("gauss_markov", "markov exponential gaussmarkov"),
        ("constant", "bias systematic"),
        ("L1", "l1 sel1"),
        ("L2", "l2 sel2"),
        ("ecliptic_j2000", "ecliptic eclipj2000"),
        ("icrf", "j2000 eme2000 equatorial gcrf"),
        ("keplerian", "elements"),
        ("state", "vectors"),
        ("cometary", "keplerian"),
        ("sbdb", "horizons jpl"),
        ("barycentre", "barycenter ssb"),
    )
    for other in others.split()
}


def block_hint(path: KeyPath, value: Tree) -> str:
    """How to say as a block what stands at a path as a word or a number; empty where nothing can be told."""
    if isinstance(value, dict | list) or value is None or not path:
        return ""
    key = next((part for part in reversed(path) if isinstance(part, str)), "")
    said = shown(str(value), 60).strip()
    form = _orbit_form(said) if key == "orbit" and path[0] == "telescopes" else _form(key, said)
    if not form:
        return ""
    if path[-1] == key:
        return f"; write {key}: {form}"
    return f"; write - {form}" if not form.startswith("there ") else f"; {form}"


def _form(key: str, said: str) -> str:
    """The block for a key."""
    if key == "orbit":
        return f"{{kind: file, file: {said}}}" if "." in said else "{kind: cometary, e: ..., q: ..., tp: ..., ...}"
    if key in _ONE_WORD:
        form, word = _ONE_WORD[key]
        if key == "estimators":
            return form.replace("batch_qr", other_word(said, list(get_args(Method))) or said)
        if key == "predictions" and said not in PLANES:
            said = other_word(said, list(PLANES)) or word
        return form.replace(word, said, 1) if word and re.fullmatch(r"[\w ()-]+", said) else form
    if key not in _ONE_NUMBER:
        return ""
    dimension, form, part = _ONE_NUMBER[key]
    if dimension is None:
        return form.replace(part, said, 1) if re.fullmatch(NUMBER, said) else form
    if re.fullmatch(NUMBER, said):
        return form.replace(part, f"{said} {part.split()[-1]}", 1)
    meant = meant_quantity(said, dimension)
    return form.replace(part, meant, 1) if meant else form


def _orbit_form(said: str) -> str:
    """The block for where a telescope is."""
    word = said.lower().replace("_", " ").strip()
    for end, kind in _ENDS.items():
        if word.endswith(end):
            origin = ", origin: earth" if kind == "table" else ""
            return f"{{kind: {kind}, file: {said}{origin}}}"
    if re.fullmatch(_CENTRE, word):
        return f"{_GEOSTATIONARY} (no telescope is at the Earth's centre)"
    for pattern, form in _ORBIT_WORDS:
        if re.fullmatch(pattern, word.replace("-", " ").replace(" ", "_") if " " in word else word):
            return form
    code = re.fullmatch(r"[A-Z0-9]\d\d", said)
    return f"{{kind: ground, code: {said}}}" if code else _GEOSTATIONARY


def prior_hint(path: KeyPath, said: str) -> str:
    """The block for a prior orbit said as a number, or as a file; empty elsewhere."""
    if path != ("prior",):
        return ""
    file = f"{{file: {said}}}" if re.search(r"\.\w+$", said) else ""
    return f"; write prior: {file or _form('prior', said)}"


def kind_hint(path: KeyPath, said: str) -> str:
    """The block for a telescope's orbit of a kind by another name; empty for other blocks."""
    return f"; write orbit: {_orbit_form(said)}" if "telescopes" in path[:1] and "orbit" in path else ""


def other_word(said: str, allowed: list[str]) -> str:
    """The choice that others call so; empty where none is known."""
    plain = re.sub(r"[\s_.-]+", "", said.lower())
    same = next((word for word in allowed if re.sub(r"[\s_.-]+", "", word.lower()) == plain), "")
    meant = same or _OTHER_WORDS.get(plain, _OTHER_WORDS.get(said.lower(), ""))
    return meant if meant in allowed else ""


def spread_hint(path: KeyPath, value: Tree) -> str:
    """`170 +- 20 m` as the block of an uncertain value; empty for another text."""
    match = _SPREAD.fullmatch(value.strip()) if isinstance(value, str) and len(value) < 80 else None
    if match is None or not path:
        return ""
    number, first, sigma, second = match.groups()
    unit = f" {first or second}" if first or second else ""
    return f"; write {path[-1]}: {{value: {number}{unit}, sigma: {sigma}{unit}, treatment: considered}}"
