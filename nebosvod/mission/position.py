"""Error of a telescope's own position: how large, how it is correlated in time, and its treatment."""

from typing import Annotated, Any, Literal

from pydantic import Field

from nebosvod.borders.treatment import Treatment
from nebosvod.mission.covariance import MATRIX_SCHEMA, Array, read_matrix
from nebosvod.mission.declared import Complaint, PositionCorrelation, TruePosition, misplaced, twin_complaints
from nebosvod.mission.fields import Block, Parsed, PositiveDuration, PositiveLength, PositiveSpeed, Several, When

ThreeLengths = Annotated[Several[PositiveLength], Field(min_length=3, max_length=3)]
ThreeSpeeds = Annotated[Several[PositiveSpeed], Field(min_length=3, max_length=3)]


def _matrix_or_orbit(value: Any) -> Array | Literal["orbit"]:
    """A matrix, or the word for the one that came with the telescope's orbit."""
    return "orbit" if value == "orbit" else read_matrix(value)


OrbitCovariance = Annotated[
    Array | Literal["orbit"],
    Parsed(_matrix_or_orbit, {"anyOf": [{"const": "orbit"}, MATRIX_SCHEMA]}, lambda matrix: matrix.tolist()),
]


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
        found = [*misplaced(self, self.correlation, owners), *self._twin_complaints()]
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
        found += [(("true", *key), text) for key, text in misplaced(self.true, kind, owners)]
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
