"""Words of the mission file that other rooms speak too: one row for each, in one place."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

Method = Literal[
    "batch_qr", "batch_blocks", "batch_identity", "recursive", "two_stage", "schmidt", "as_printed",
    "levenberg_marquardt", "ekf", "iterated_ekf", "hsieh_chen", "smoother",
]  # fmt: skip
METHODS: Mapping[str, str] = {
    "batch_qr": "batch least squares, QR",
    "batch_blocks": "batch least squares, blocks",
    "batch_identity": "batch least squares, matrix identity",
    "recursive": "recursive, augmented",
    "schmidt": "Schmidt-Kalman",
    "two_stage": "two-stage (bias-separated)",
    "as_printed": "recursive, as printed",
    "levenberg_marquardt": "batch least squares, steps of Levenberg and Marquardt",
    "ekf": "extended Kalman filter",
    "iterated_ekf": "extended Kalman filter, each measurement iterated",
    "hsieh_chen": "two-stage, drifting biases (Hsieh and Chen)",
    "smoother": "recursive, smoothed (Rauch, Tung, Striebel)",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Plane:
    """What a prediction can be about.

    Attributes
    ----------
    words : on a page.
    components : of its error, in plain letters; symbols : the same on a page.
    leads : whether a reader asks for it before the others.
    """

    words: str
    components: tuple[str, ...]
    symbols: tuple[str, ...]
    leads: bool = False


RTN = ("radial", "transverse", "normal")
PLANES: Mapping[str, Plane] = {  # those that lead in the order of their rank
    "entry": Plane(
        words="entry point", components=("downrange", "crossrange"), symbols=("downrange", "crossrange"), leads=True
    ),
    "b_plane": Plane(words="b-plane", components=("xi", "zeta"), symbols=("ξ", "ζ"), leads=True),
    "mtp": Plane(words="target plane at closest approach", components=("xi", "zeta"), symbols=("ξ", "ζ"), leads=True),
    "perigee_distance": Plane(
        words="closest-approach distance", components=("distance",), symbols=("distance",), leads=True
    ),
    "sky": Plane(words="plane of the sky", components=("RA*", "Dec"), symbols=("RA cos Dec", "Dec")),
    "distance": Plane(words="distance from a telescope", components=("distance",), symbols=("distance",)),
    "rtn": Plane(words="position (radial, transverse, normal)", components=RTN, symbols=RTN),
    "rtn_velocity": Plane(words="velocity (radial, transverse, normal)", components=RTN, symbols=RTN),
    "element": Plane(words="osculating element", components=("value",), symbols=("value",)),
    "energy": Plane(words="specific energy", components=("value",), symbols=("value",)),
    "formula": Plane(words="formula", components=("value",), symbols=("value",)),
    "position": Plane(words="heliocentric position (ICRF)", components=("x", "y", "z"), symbols=("x", "y", "z")),
}
