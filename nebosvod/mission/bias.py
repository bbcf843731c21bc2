"""Bias of a telescope's directions: how large, how it is correlated in time and over the sky, and its treatment."""

from pydantic import Field

from nebosvod.borders.treatment import Treatment
from nebosvod.mission.declared import BiasCorrelation, Complaint, TrueBias, misplaced, twin_complaints
from nebosvod.mission.fields import Angle, Block, PositiveAngle, PositiveAngleRate, PositiveDuration, When
from nebosvod.units import ARCSEC

Pair = tuple[float, float]
BIAS_OWNERS: dict[str, tuple[str, bool]] = {
    "drift": ("drift", True),
    "epoch": ("drift", False),
    "gap": ("per_arc", True),
    "time": ("gauss_markov", True),
    "zone": ("per_zone", True),
}


def one_or_pair(one: float | None, ra: float | None, dec: float | None) -> list[Complaint]:
    """Complain unless there is exactly `sigma`, or both of sigma_ra and sigma_dec."""
    if one is not None and (ra is not None or dec is not None):
        return [(("sigma",), "stands beside sigma_ra or sigma_dec; keep either sigma or the pair")]
    if one is None and (ra is None or dec is None):
        return [(("sigma",), "is missing (or sigma_ra and sigma_dec)")]
    return []


def sigma_update(pair: Pair, sigma: float | None, ra: float | None, dec: float | None) -> dict[str, float | None]:
    """Fields sigma, sigma_ra, sigma_dec of a truth: those of its twin, else those of the pair assumed."""
    if sigma is not None:
        return {"sigma": sigma, "sigma_ra": None, "sigma_dec": None}
    return {"sigma": None, "sigma_ra": pair[0] if ra is None else ra, "sigma_dec": pair[1] if dec is None else dec}


class Bias(Block):
    """An error of RA* and Dec that does not average out: its size, how it changes, and its treatment."""

    sigma: PositiveAngle | None = None
    sigma_ra: PositiveAngle | None = None
    sigma_dec: PositiveAngle | None = None
    mean_ra: Angle = 0.0
    mean_dec: Angle = 0.0
    correlation: BiasCorrelation = "constant"
    drift: PositiveAngleRate | None = Field(None, description="Sigma of the drift, each axis")
    epoch: When | None = Field(None, description="Where bias and drift are independent; the reference epoch if absent")
    gap: PositiveDuration | None = Field(None, description="A longer pause begins a new arc, of per_arc")
    time: PositiveDuration | None = Field(None, description="Correlation time of gauss_markov")
    zone: PositiveAngle | None = Field(None, description="Side of a zone of the sky, of per_zone")
    treatment: Treatment
    true: TrueBias | None = Field(None, description="What it really is, where that is not as assumed")

    def complaints(self) -> list[Complaint]:
        """Keys that fit the correlation; either sigma or both of the pair."""
        found = misplaced(self, self.correlation, BIAS_OWNERS)
        for key in ("mean_ra", "mean_dec"):
            if getattr(self, key) != 0.0 and self.correlation != "constant":
                found.append(((key,), f"belongs to constant only (got correlation {self.correlation})"))
        if self.zone is not None and not 0.001 <= self.zone <= 3.15:
            found.append((("zone",), "is out of range (allowed 0.06 deg to 180 deg)"))
        sigmas = (self.sigma, self.sigma_ra, self.sigma_dec)
        found += twin_complaints(self.true, any(sigmas), self.treatment)
        found += self._twin_complaints()
        if self.correlation == "constant" and self.treatment in ("estimated", "fixed") and not any(sigmas):
            return found  # unknown beforehand, or exactly its mean
        return found + one_or_pair(*sigmas)

    def _twin_complaints(self) -> list[Complaint]:
        """Keys of the twin fit its correlation; what stays as it is in kind has no gap and no zone of its own."""
        if self.true is None:
            return []
        other = self.true.correlation not in (None, self.correlation)
        owners = {key: BIAS_OWNERS[key] for key in ("drift", "gap", "time", "zone")}
        if other:
            found = misplaced(self.true, str(self.true.correlation), owners)
        else:
            owners |= dict.fromkeys(("gap", "zone"), ("a correlation of its own", False))
            found = misplaced(self.true, self.correlation, {k: (owner, False) for k, (owner, _) in owners.items()})
        return [(("true", *key), text) for key, text in found]

    @property
    def sigma_rad(self) -> Pair | None:
        """Sigma in RA* and Dec, rad; None = no prior."""
        if not (self.sigma or self.sigma_ra):
            return None
        return (self.sigma_ra or self.sigma or 0.0, self.sigma_dec or self.sigma or 0.0)

    @property
    def sizes(self) -> tuple[str, ...]:
        """How large it is, in words."""
        pair = self.sigma_rad
        said = () if pair is None else (" x ".join(f"{s / ARCSEC:.3g}" for s in dict.fromkeys(pair)) + " arcsec",)
        return said + ((f"{self.drift / ARCSEC * 86400.0:.3g} arcsec/d",) if self.drift is not None else ())

    @property
    def mean_rad(self) -> Pair:
        """Expected bias in RA* and Dec, rad."""
        return (self.mean_ra, self.mean_dec)

    @property
    def truth(self) -> "Bias":
        """What it really is, of the kind assumed (`other_kind`); means of what is not constant are in `true_mean`."""
        if self.true is None:
            return self
        if self.other_kind is not None:
            drift = None if self.drift is None else 0.0
            return self.model_copy(
                update={"sigma": None, "sigma_ra": 0.0, "sigma_dec": 0.0, "drift": drift, "true": None}
            )
        said = {key: value for key, value in self.true.said.items() if key != "correlation"}
        pair = said.pop("sigma", None), said.pop("sigma_ra", None), said.pop("sigma_dec", None)
        said |= sigma_update(self.sigma_rad or (0.0, 0.0), *pair)
        return self.model_copy(update={**said, "true": None})

    @property
    def other_kind(self) -> "Bias | None":
        """What it really is beside its mean, where that is of another kind than is assumed: an error left out."""
        twin = self.true
        if twin is None or twin.correlation in (None, self.correlation):
            return None
        size = sigma_update(self.sigma_rad or (0.0, 0.0), twin.sigma, twin.sigma_ra, twin.sigma_dec)
        return Bias.model_construct(
            sigma=size["sigma"], sigma_ra=size["sigma_ra"], sigma_dec=size["sigma_dec"], correlation=twin.correlation,
            drift=twin.drift, gap=twin.gap, time=twin.time, zone=twin.zone, epoch=self.epoch, treatment="ignored",
        )  # fmt: skip

    @property
    def true_mean(self) -> Pair | None:
        """What it really is on average, rad; None where that is not declared."""
        twin = self.true
        if twin is None or (twin.mean_ra is None and twin.mean_dec is None):
            return None
        return (
            self.mean_ra if twin.mean_ra is None else twin.mean_ra,
            self.mean_dec if twin.mean_dec is None else twin.mean_dec,
        )

    @property
    def has_sigma(self) -> bool:
        """Whether something is said about its size."""
        return self.sigma_rad is not None
