"""Make docs/pictures/overview.png, the picture of README.md: geometry and target plane of `soda-like`."""

import io
from pathlib import Path

from PIL import Image

import nebosvod

PLACE = Path(__file__).resolve().parent.parent / "docs" / "pictures" / "overview.png"
GAP, DPI, COLOURS = 20, 100.0, 96


def main() -> None:
    """Both figures side by side."""
    result = nebosvod.run(nebosvod.load_mission("soda-like").with_({"monte_carlo": {"runs": 200}}))
    figures = (result.plot.geometry(), result.plot.target_plane())
    one, other = (Image.open(io.BytesIO(figure.png(DPI))).convert("RGB") for figure in figures)
    high = max(one.height, other.height)
    both = Image.new("RGB", (one.width + GAP + other.width, high), "white")
    both.paste(one, (0, (high - one.height) // 2))
    both.paste(other, (one.width + GAP, (high - other.height) // 2))
    both.quantize(COLOURS).save(PLACE, optimize=True)


if __name__ == "__main__":
    main()
