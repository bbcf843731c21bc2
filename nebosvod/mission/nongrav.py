"""Accelerations that gravity does not make: Marsden's A1, A2, A3, their law, and what may be left of A1."""

from typing import Annotated, Literal

from pydantic import Discriminator, Field, Tag

from nebosvod.borders.treatment import Treatment
from nebosvod.mission.declared import TrueAcceleration, twin_complaints
from nebosvod.mission.fields import Acceleration, Block, KeyPath, PositiveAcceleration, PositiveLength
from nebosvod.mission.values import UncertainAcceleration
from nebosvod.units import AU_KM

Exponent = Annotated[float, Field(ge=0.0, le=20.0)]


class Residual(Block):
    """What A1 may still be when radiation pressure is computed from the body."""

    value: Acceleration = 0.0
    sigma: PositiveAcceleration
    treatment: Treatment
    true: TrueAcceleration | None = Field(None, description="What it really is, where that is not as assumed")

    def complaints(self) -> list[tuple[KeyPath, str]]:
        """A twin stands beside something uncertain."""
        return twin_complaints(self.true, True, self.treatment)


class Law(Block):
    """g(r) = alpha (r/r0)^-m [1 + (r/r0)^n]^-k (Marsden, Sekanina, Yeomans 1973)."""

    alpha: Annotated[float, Field(gt=0.0, le=1e6)]
    r0: PositiveLength
    m: Exponent
    n: Exponent = 5.093
    k: Exponent

    @property
    def constants(self) -> dict[str, float]:
        """Keywords of the force model."""
        return {"alpha": self.alpha, "r0_au": self.r0 / AU_KM, "m": self.m, "n": self.n, "k": self.k}


LawChoice = Annotated[
    Annotated[Law, Tag("block")] | Annotated[Literal["inverse_square", "water_ice"], Tag("word")],
    Discriminator(lambda value: "block" if isinstance(value, dict | Law) else "word"),
]


class Nongrav(Block):
    """Marsden's A1 (radial), A2 (transverse), A3 (normal), the accelerations where g(r) = 1."""

    A1: UncertainAcceleration | None = None
    A2: UncertainAcceleration | None = None
    A3: UncertainAcceleration | None = None
    a1_residual: Residual | None = None
    law: LawChoice = Field("inverse_square", description="g(r): (1 au/r)^2, that of comets, or its constants")

    @property
    def declared(self) -> dict[str, Block]:
        """Those whose truth is declared, as they really are."""
        given = {key: getattr(self, key) for key in ("A1", "A2", "A3", "a1_residual")}
        return {
            key: one.model_copy(update={**one.true.said, "true": None})
            for key, one in given.items()
            if one is not None and one.true is not None
        }

    def complaints(self) -> list[tuple[KeyPath, str]]:
        """A1 and its residual exclude each other."""
        if self.A1 is not None and self.a1_residual is not None:
            return [(("a1_residual",), "A1 and a1_residual are the same parameter; keep one of the two")]
        return []
