"""What an estimator does about an uncertainty: one word for the file of a mission, the stages and the results."""

from typing import Literal

Treatment = Literal["fixed", "ignored", "considered", "estimated"]
TREATMENTS: tuple[Treatment, ...] = ("fixed", "ignored", "considered", "estimated")
