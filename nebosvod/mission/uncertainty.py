"""What is uncertain about telescopes: biases, positions, clocks, the photocentre; each with its treatment."""

from collections.abc import Mapping
from typing import Annotated, Any, Literal, get_args

from pydantic import Field

from nebosvod.borders.treatment import Treatment
from nebosvod.mission.covariance import MATRIX_SCHEMA, Array, read_matrix
from nebosvod.mission.declared import (
    BiasCorrelation,
    PositionCorrelation,
    TrueAmplitude,
    TrueBias,
    TruePlateScale,
    TruePosition,
    TrueProcessNoise,
    TrueTiming,
    twin_complaints,
)
from nebosvod.mission.fields import (
    Angle,
    Block,
    KeyPath,
    Offset,
    Parsed,
    PositiveAngle,
    PositiveAngleRate,
    PositiveDuration,
    PositiveLength,
    PositiveNumber,
    PositiveSpeed,
    Several,
    Size,
    When,
)
from nebosvod.mission.values import Uncertain
from nebosvod.units import ARCSEC, DEG

# What is uncertain about telescopes; an estimator's treatment, the budget and the mean ratio go by these words
Group = Literal["bias", "position", "timing", "plate_scale", "photocentre", "process_noise"]
GROUPS: tuple[Group, ...] = get_args(Group)
# A line that makes it uncertain, and where the line belongs
EXAMPLES: Mapping[str, tuple[str, str]] = {
    "bias": ("bias: {sigma: 0.05 arcsec, treatment: considered}", "a telescope"),
    "position": ("position: {sigma: 3 km, correlation: white, treatment: considered}", "a telescope"),
    "timing": ("timing: {sigma: 1 s, treatment: considered}", "a telescope"),
    "plate_scale": ("plate_scale: {sigma: 1e-5, field: 10 arcmin, treatment: considered}", "a telescope"),
    "photocentre": ("photocentre: {sigma: 0.1, radius: 10 m, treatment: considered}", "object"),
    "process_noise": ("process_noise: {velocity: 0.1 mm/s, over: 30 d, treatment: considered}", "object"),
}
WIDEST_FIELD = 10.0 * DEG + 1e-12  # of a telescope; beyond, a field is no plane
Pair = tuple[float, float]
Complaint = tuple[KeyPath, str]
ThreeLengths = Annotated[Several[PositiveLength], Field(min_length=3, max_length=3)]
ThreeSpeeds = Annotated[Several[PositiveSpeed], Field(min_length=3, max_length=3)]


def _matrix_or_orbit(value: Any) -> Array | Literal["orbit"]:
    """A matrix, or the word for the one that came with the telescope's orbit."""
    return "orbit" if value == "orbit" else read_matrix(value)


OrbitCovariance = Annotated[
    Array | Literal["orbit"],
    Parsed(_matrix_or_orbit, {"anyOf": [{"const": "orbit"}, MATRIX_SCHEMA]}, lambda matrix: matrix.tolist()),
]


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


def _misplaced(block: Block, correlation: str, owners: dict[str, tuple[str, bool]]) -> list[Complaint]:
    """Keys that belong to one correlation only: complain where they are missing there, or stand elsewhere.

    owners : key -> (the correlation it belongs to, whether that one needs it).
    """
    found: list[Complaint] = []
    for key, (owner, needed) in owners.items():
        said = getattr(block, key) is not None
        if said and correlation != owner:
            found.append(((key,), f"belongs to {owner} only (got correlation {correlation})"))
        if needed and not said and correlation == owner:
            found.append(((key,), f"is missing; {owner} needs it"))
    return found


BIAS_OWNERS: dict[str, tuple[str, bool]] = {
    "drift": ("drift", True),
    "epoch": ("drift", False),
    "gap": ("per_arc", True),
    "time": ("gauss_markov", True),
    "zone": ("per_zone", True),
}


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
        found = _misplaced(self, self.correlation, BIAS_OWNERS)
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
            found = _misplaced(self.true, str(self.true.correlation), owners)
        else:
            owners |= dict.fromkeys(("gap", "zone"), ("a correlation of its own", False))
            found = _misplaced(self.true, self.correlation, {k: (owner, False) for k, (owner, _) in owners.items()})
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


class Position(Block):
    """Error of the telescope's own position: size on each axis, how it is correlated in time, and its treatment."""

    sigma: PositiveLength | None = Field(None, description="On every axis")
    sigmas: ThreeLengths | None = Field(None, description="One for each axis of the frame")
    correlation: PositionCorrelation
    time: PositiveDuration | None = Field(None, description="Correlation time of gauss_markov")
    velocity_sigma: PositiveSpeed | None = Field(None, description="On every axis, of orbit_error")
    velocity_sigmas: ThreeSpeeds | None = Field(None, description="One for each axis, of orbit_error")
    covariance: OrbitCovariance | None = Field(
        None,
        description="6 x 6 of the state, km and km/s, instead of sigmas; orbit: the one in the telescope's OEM file",
    )
    epoch: When | None = Field(None, description="Of the orbit_error; the reference epoch when absent")
    renewal: PositiveDuration | None = Field(None, description="The orbit is determined anew this often")
    frame: Literal["icrf", "rtn"] = "icrf"
    treatment: Treatment
    true: TruePosition | None = Field(None, description="What it really is, where that is not as assumed")

    def complaints(self) -> list[Complaint]:
        """Keys that fit the correlation, and one form of each sigma."""
        orbit = ("velocity_sigma", "velocity_sigmas", "covariance", "epoch", "renewal")
        owners = {"time": ("gauss_markov", True), **dict.fromkeys(orbit, ("orbit_error", False))}
        found = [*_misplaced(self, self.correlation, owners), *self._twin_complaints()]
        if self.covariance is not None:
            forms = ("sigma", "sigmas", "velocity_sigma", "velocity_sigmas")
            found += [((key,), "stands beside covariance; keep one") for key in forms if getattr(self, key) is not None]
            if self.from_orbit:
                if "frame" in self.model_fields_set:
                    found.append((("frame",), "is said by the file of the orbit; remove it"))
            elif len(self.covariance) != 6:
                found.append((("covariance",), f"needs 6 rows (got {len(self.covariance)}): x y z vx vy vz"))
            return found
        if (self.sigma is None) == (self.sigmas is None):
            found.append(((), "needs either sigma (every axis) or sigmas (a list of three)"))
        if self.correlation == "orbit_error" and (self.velocity_sigma is None) == (self.velocity_sigmas is None):
            found.append(((), "needs either velocity_sigma (every axis) or velocity_sigmas (a list of three)"))
        return found

    def _twin_complaints(self) -> list[Complaint]:
        """Keys of the twin fit the assumption."""
        found = twin_complaints(self.true, True, self.treatment)
        if self.true is None:
            return found
        other = self.true.correlation not in (None, self.correlation)
        kind = str(self.true.correlation) if other else self.correlation
        owners = {"velocity_sigma": ("orbit_error", other), "time": ("gauss_markov", other)}
        found += [(("true", *key), text) for key, text in _misplaced(self.true, kind, owners)]
        sized = [key for key in ("sigma", "sigmas", "velocity_sigma") if getattr(self.true, key) is not None]
        if other and self.covariance is not None:
            if not {"sigma", "sigmas"} & set(sized):
                found.append((("true",), "needs a sigma of its own: the assumption is a covariance"))
            return found
        if sized and self.covariance is not None:
            found.append((("true", sized[0]), "stands against a covariance; give the assumption as sigmas too"))
        return found

    @property
    def truth(self) -> "Position":
        """What it really is, of the kind assumed (`other_kind`); its mean is in `true_mean`."""
        if self.true is None:
            return self
        said = {key: value for key, value in self.true.said.items() if key not in ("mean", "correlation")}
        if self.other_kind is not None:
            rates = (0.0, 0.0, 0.0) if self.correlation == "orbit_error" else None
            said = {"sigmas": (0.0, 0.0, 0.0), "sigma": None, "velocity_sigma": None, "velocity_sigmas": rates}
            return self.model_copy(update={**said, "covariance": None, "true": None})
        if "sigma" in said:
            said["sigmas"] = None
        elif "sigmas" in said:
            said["sigma"] = None
        if "velocity_sigma" in said:
            said["velocity_sigmas"] = None
        return self.model_copy(update={**said, "true": None})

    @property
    def other_kind(self) -> "Position | None":
        """What it really is beside its mean, where that is of another kind than is assumed: an error left out."""
        twin = self.true
        if twin is None or twin.correlation in (None, self.correlation):
            return None
        own = twin.sigma is not None or twin.sigmas is not None
        return Position.model_construct(
            sigma=twin.sigma if own else self.sigma,
            sigmas=twin.sigmas if own else self.sigmas,
            correlation=twin.correlation,
            time=twin.time,
            velocity_sigma=twin.velocity_sigma,
            frame=self.frame,
            treatment="ignored",
        )

    @property
    def true_mean(self) -> tuple[float, ...] | None:
        """What it really is on average on the axes of its frame, km; None where that is not declared."""
        return None if self.true is None else self.true.mean

    @property
    def from_orbit(self) -> bool:
        """Whether its covariance is the one that came with the telescope's orbit."""
        return isinstance(self.covariance, str)

    @property
    def sigma_km(self) -> tuple[float, float, float]:
        """Sigma on the three axes of the frame, km; zero where it stands in the file of the orbit."""
        if self.covariance is not None and not isinstance(self.covariance, str):
            return (self.covariance[0, 0] ** 0.5, self.covariance[1, 1] ** 0.5, self.covariance[2, 2] ** 0.5)
        if self.sigmas is not None:
            return (self.sigmas[0], self.sigmas[1], self.sigmas[2])
        return (self.sigma or 0.0,) * 3

    @property
    def sigma_km_s(self) -> tuple[float, float, float]:
        """Sigma of the velocity on the three axes of the frame, km/s."""
        if self.velocity_sigmas is not None:
            return (self.velocity_sigmas[0], self.velocity_sigmas[1], self.velocity_sigmas[2])
        return (self.velocity_sigma or 0.0,) * 3

    @property
    def sizes(self) -> tuple[str, ...]:
        """How large it is, in words."""
        if self.from_orbit:
            return ("covariance of its orbit file",)
        said = [" x ".join(f"{s:.3g}" for s in dict.fromkeys(self.sigma_km)) + " km"]
        if self.correlation == "orbit_error" and self.covariance is None:
            said.append(" x ".join(f"{1e6 * s:.3g}" for s in dict.fromkeys(self.sigma_km_s)) + " mm/s")
        if self.renewal is not None:
            said.append(f"renewed every {self.renewal / 86400.0:.3g} d")
        return tuple(said)

    @property
    def has_sigma(self) -> bool:
        """A position error always has one."""
        return True


class Timing(Block):
    """A clock that is wrong by the same time in all exposures; positive: exposed later than recorded."""

    sigma: PositiveDuration | None = None
    mean: Offset = 0.0
    treatment: Treatment
    true: TrueTiming | None = Field(None, description="What it really is, where that is not as assumed")

    def complaints(self) -> list[Complaint]:
        """What is wrong in truth must say how much."""
        if self.sigma is None and self.treatment in ("considered", "ignored"):
            return [(("sigma",), f"is missing; {self.treatment} needs it")]
        return twin_complaints(self.true, self.sigma is not None, self.treatment)

    @property
    def truth(self) -> "Timing":
        """What it really is."""
        return self if self.true is None else self.model_copy(update={**self.true.said, "true": None})

    @property
    def true_mean(self) -> tuple[float, ...] | None:
        """What it really is on average, s; None where that is not declared."""
        return None if self.true is None or self.true.mean is None else (self.true.mean,)

    @property
    def sizes(self) -> tuple[str, ...]:
        """How large it is, in words."""
        return () if self.sigma is None else (f"{self.sigma:.3g} s",)

    @property
    def has_sigma(self) -> bool:
        """Whether something is said about its size."""
        return self.sigma is not None


class PlateScale(Block):
    """A relative error of the plate scale, the same in all exposures, which put the object all over the field."""

    sigma: Annotated[float, Field(ge=1e-12, le=0.1, description="Of the relative error; its mean is 0")]
    field: PositiveAngle = Field(description="Side of the square field, at most 10 deg; its axes are RA* and Dec")
    treatment: Treatment
    true: TruePlateScale | None = Field(None, description="What it really is, where that is not as assumed")

    def complaints(self) -> list[Complaint]:
        """A field is a plane."""
        wide = [(("field",), "is out of range (allowed up to 10 deg)")] if self.field > WIDEST_FIELD else []
        return [*wide, *twin_complaints(self.true, True, self.treatment)]

    @property
    def truth(self) -> "PlateScale":
        """What it really is; its mean is in `true_mean`."""
        sigma = self.sigma if self.true is None or self.true.sigma is None else self.true.sigma
        return self.model_copy(update={"sigma": sigma, "true": None})

    @property
    def true_mean(self) -> tuple[float, ...] | None:
        """What it really is on average; None where that is not declared."""
        return None if self.true is None or self.true.mean is None else (self.true.mean,)

    @property
    def sizes(self) -> tuple[str, ...]:
        """How large it is, in words."""
        return (f"{self.sigma:.3g} over {self.field / ARCSEC:.4g} arcsec",)

    @property
    def has_sigma(self) -> bool:
        """It always has one."""
        return True


class Photocentre(Uncertain):
    """The light of a partly lit body lies off its centre: the amplitude, 1 being that of a Lambert sphere."""

    value: Annotated[float, Field(ge=-10.0, le=10.0)] = 0.0
    sigma: PositiveNumber | None = None
    radius: Size | None = Field(None, description="Of the body; the object's own when absent")
    true: TrueAmplitude | None = None

    @property
    def sizes(self) -> tuple[str, ...]:
        """How large it is, in words."""
        return () if self.sigma is None else (f"amplitude {self.value:.3g} +- {self.sigma:.3g}",)

    @property
    def true_mean(self) -> tuple[float, ...] | None:
        """What it really is on average; None where that is not declared."""
        return None if self.true is None or self.true.value is None else (self.true.value,)

    @property
    def has_sigma(self) -> bool:
        """Whether something is said about its size."""
        return self.sigma is not None


MOST_INTERVALS = 100  # of process noise; 200 took a run to minutes
AT_MOST_100 = Field(json_schema_extra={"maximum": MOST_INTERVALS})  # told below with its reason


class ProcessNoise(Block):
    """White accelerations of the object that no force model has; they let its velocity walk."""

    velocity: PositiveSpeed = Field(description="Sigma of the change of velocity on each axis in the time `over`")
    over: PositiveDuration
    intervals: Annotated[
        int, AT_MOST_100, Field(ge=3, description="Of constant acceleration, over the measurements")
    ] = 24
    treatment: Treatment
    true: TrueProcessNoise | None = Field(None, description="What it really is, where that is not as assumed")

    def complaints(self) -> list[Complaint]:
        """A twin stands beside something uncertain, and a run ends within a minute or so."""
        found = twin_complaints(self.true, True, self.treatment)
        if self.intervals > MOST_INTERVALS:
            why = "each adds three parameters, and the time of a run grows as their cube: 24 are enough for most arcs"
            found.append(
                (("intervals",), f"is out of range (got {self.intervals}; allowed {MOST_INTERVALS} or less); {why}")
            )
        return found

    @property
    def density_km2_s3(self) -> float:
        """Density of its spectrum on each axis."""
        return self.velocity**2 / self.over

    @property
    def truth(self) -> "ProcessNoise":
        """What it really is."""
        velocity = self.velocity if self.true is None or self.true.velocity is None else self.true.velocity
        return self.model_copy(update={"velocity": velocity, "true": None})

    @property
    def true_mean(self) -> None:
        """Its mean is zero."""
        return None

    @property
    def sizes(self) -> tuple[str, ...]:
        """How large it is, in words."""
        return (f"{1e6 * self.velocity:.3g} mm/s over {self.over / 86400.0:.3g} d",)

    @property
    def has_sigma(self) -> bool:
        """It always has one."""
        return True


Error = Bias | Position | Timing | PlateScale | Photocentre | ProcessNoise
