"""How far the target plane is from linear along the line of variations: a flag, and never a probability.

About the estimate its point is b(sigma) = b0 + b1 sigma + b2 sigma^2 / 2 + ..., and the linear answer knows b1 alone.
What the second order adds where the hits are is told aside of the line, where it moves it past the body or into it, and
along it, where it moves the hits to other sigmas. A probability of the second order may be worse than one of the first,
so none is made of it.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
STEP = 0.5  # sigmas either way
ASIDE = 0.1  # of the capture radius
ALONG = 0.1  # sigmas, times sigmas: a change of ln P


@dataclass(frozen=True, slots=True, kw_only=True)
class Bend:
    """The second order where the hits are, or at one sigma where they are nearer.

    Attributes
    ----------
    aside_km, along_sigmas : by how much it moves the point of the target plane across the line and along it.
    matters : whether the linear answer may be off by a tenth and more for it.
    said : the same in words.
    """

    aside_km: float
    along_sigmas: float
    matters: bool
    said: str


def bend_of(sigmas: Array, points_km: Array, capture_radius_km: float, hits: float) -> Bend | None:
    """The bend of a line; None where it has no encounter about the estimate.

    Parameters
    ----------
    sigmas : shape (k,). points_km : shape (k, 2), the target plane's; nan for orbits without the encounter.
    hits : how many sigmas along the line they are.
    """
    places = [int(np.argmin(np.abs(sigmas - at))) for at in (-STEP, 0.0, STEP)]
    before, here, after = points_km[places]
    if not np.isfinite([before, here, after]).all():
        return None
    b1, b2 = (after - before) / (2.0 * STEP), (after - 2.0 * here + before) / STEP**2
    size = float(np.linalg.norm(b1))
    if size == 0.0:
        return None
    nu = max(abs(hits), 1.0)
    second = 0.5 * b2 * nu**2
    along = float(second @ b1) / size**2
    aside = float(abs(second[0] * b1[1] - second[1] * b1[0])) / size
    matters = aside > ASIDE * capture_radius_km or abs(along) * nu > ALONG
    far = f"{float(f'{aside:.3g}'):,.0f}" if aside >= 1000.0 else f"{aside:.3g}"
    said = (
        f"the target plane is bent: at {nu:.2g} {'sigma' if nu == 1.0 else 'sigmas'} the second order moves the point "
        f"{far} km aside of the line and {along:+.2g} sigmas along it, so the linear answer may be off; a flag, no "
        "probability is made of it"
    )
    return Bend(aside_km=aside, along_sigmas=along, matters=matters, said=said)
