"""Make examples/relief.asc: the sea bottom that examples/map_navigation.py sails over. Not a real place.

A normal random field: white noise smoothed over 1.2 km, with a rougher part over 0.7 km at a third of its height, 80 m
in all. ESRI ASCII grid, the plainest format of maps: a header of six lines (km here), then rows from north to south, m.
Usage: python tools/make_relief.py
"""

from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter

PIXEL, COLUMNS, ROWS = 0.5, 121, 81


def main() -> None:
    """Write the file."""
    rng = np.random.default_rng(2013)
    height = np.zeros((ROWS, COLUMNS))
    for length, size in ((1.2, 3.0), (0.7, 1.0)):
        rough = gaussian_filter(rng.normal(size=(ROWS, COLUMNS)), length / PIXEL, mode="reflect")
        height += size * rough / rough.std()
    height *= 80.0 / height.std()
    header = f"ncols {COLUMNS}\nnrows {ROWS}\nxllcenter -15.0\nyllcenter -20.0\ncellsize {PIXEL}\nNODATA_value -9999\n"
    lines = "\n".join(" ".join(f"{value:.0f}" for value in row) for row in height)
    path = Path(__file__).resolve().parent.parent / "examples" / "relief.asc"
    path.write_text(header + lines + "\n", "utf-8")


if __name__ == "__main__":
    main()
