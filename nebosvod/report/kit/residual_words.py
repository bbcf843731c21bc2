"""What residuals say of the stated noise, in the words of runs and fits alike."""

from markupsafe import Markup

from nebosvod.report.kit.wording import NBSP, TIMES, number, quantity
from nebosvod.results.agreement import Agreement

NOTHING = 1e-6  # of the stated noise


def brief_words(found: Agreement) -> str:
    """The same in a clause: `residuals are 5.0 × smaller than their noise: it is overstated`."""
    if found.where == "inside":
        return "residuals are as large as expected"
    if found.factor < NOTHING:
        return "residuals are next to nothing, so the stated noise is not theirs"
    size = number(found.factor if found.where == "above" else 1.0 / found.factor, 2) + NBSP + TIMES
    if found.where == "above":
        return f"residuals are {size} larger than the stated noise, which is too small or not all there is"
    return f"residuals are {size} smaller than the stated noise, which is overstated"


def interval_words(found: Agreement, dof: int) -> Markup:
    """chi2/dof, where it lies against its interval, and what that means for the sigmas."""
    text = Markup("χ² per degree of freedom is {}, {} its 99{}% interval of {} to {} ({} degrees of freedom).").format(
        quantity(found.ratio), found.where, NBSP, number(found.low), number(found.high), dof
    )
    if found.where == "inside":
        return text
    if found.factor < NOTHING:
        return text + " Residuals as small as that belong to no measurements with the stated noise."
    if found.where == "below":
        return text + (
            f" The residuals are smaller than the noise model says: the noise is overstated, and with it every sigma, "
            f"by {number(1.0 / found.factor, 2)} times if errors are independent. That does not make sigmas safe: "
            f"what a telescope has in common in all its measurements does not show in residuals."
        )
    return text + (
        f" The residuals are larger than the noise model says: if nothing else is wrong, the sigmas are "
        f"{number(found.factor, 2)} times too small; else an error is missing from the model."
    )
