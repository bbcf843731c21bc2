"""A plane about the mean of directions, equidistant from it, so that the whole sphere has a place."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
FARTHEST_RAD = np.pi - 1e-6  # just before the antipode, which all sides share


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Tangent:
    """The direction in the middle, and east and north of it, unit vectors (3,)."""

    centre: Array
    east: Array
    north: Array

    @classmethod
    def about(cls, u: Array, weight: Array | None = None) -> "Tangent":
        """About the mean of unit vectors (m, 3)."""
        mean = u.mean(axis=0) if weight is None else weight @ u
        centre = mean / np.linalg.norm(mean)
        east = np.cross([0.0, 0.0, 1.0], centre)
        east = east / np.linalg.norm(east) if np.linalg.norm(east) > 1e-9 else np.array([1.0, 0.0, 0.0])
        return cls(centre=centre, east=east, north=np.cross(centre, east))

    def onto(self, u: Array) -> Array:
        """Angles (m, 2) to the east and north of the middle, rad."""
        across = np.stack([u @ self.east, u @ self.north], axis=1)
        sine = np.linalg.norm(across, axis=1)
        return np.asarray(across * (np.arctan2(sine, u @ self.centre) / np.maximum(sine, 1e-15))[:, None])

    def back(self, plane: Array) -> Array:
        """Unit vectors (m, 3) of points of the plane.

        Farther out than the antipode there is nothing: a region that reaches beyond it ends there, and does not come
        back on the other side.
        """
        far = np.linalg.norm(plane, axis=1)[:, None]
        toward = (plane[:, :1] * self.east + plane[:, 1:] * self.north) / np.maximum(far, 1e-15)
        angle = np.minimum(far, FARTHEST_RAD)
        return np.asarray(np.cos(angle) * self.centre + np.sin(angle) * toward)


def angles(u: Array) -> Array:
    """Longitude in [0, 2 pi) and latitude (m, 2) of unit vectors (m, 3)."""
    return np.stack([np.arctan2(u[:, 1], u[:, 0]) % (2.0 * np.pi), np.arcsin(np.clip(u[:, 2], -1.0, 1.0))], axis=1)


def directions(psi: Array) -> Array:
    """Unit vectors (m, 3) of longitudes and latitudes (m, 2)."""
    c = np.cos(psi[:, 1])
    return np.stack([c * np.cos(psi[:, 0]), c * np.sin(psi[:, 0]), np.sin(psi[:, 1])], axis=1)
