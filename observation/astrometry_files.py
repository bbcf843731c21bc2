"""Files of real astrometry in whatever format: the format is told from the contents."""

from pathlib import Path

from nebosvod.observation import mpc80
from nebosvod.observation.records import Astrometry
from nebosvod.observation.source_file import read_source


def read_astrometry(path: str | Path) -> Astrometry:
    """Read MPC 80-column records; gzipped or not.

    Raises
    ------
    DataError
        If the file cannot be opened.
    InputError
        With file and line, for whatever in it cannot be used.
    """
    return mpc80.parse(read_source(path))
