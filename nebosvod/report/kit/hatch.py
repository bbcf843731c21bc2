"""Patterns that tell kinds apart in grey print as well: as tiles of a page, and as matplotlib draws them."""

from collections.abc import Mapping

from markupsafe import Markup

from nebosvod.report.kit.plate import BLUE, GREEN, GREY, ORANGE, PURPLE, SKY, VERMILION

BROWN, DARK = "#7A5230", "#44505C"
COLOUR: Mapping[str, str] = {
    "noise": BLUE, "bias": VERMILION, "place": ORANGE, "orbit": SKY, "timing": PURPLE, "photocentre": BROWN,
    "body": GREEN, "push": "#00573F", "prior": GREY, "shared": DARK, "other": "#999999",
}  # fmt: skip
HATCH: Mapping[str, tuple[str, str]] = {  # paths in a tile of 6 x 6, drawn in white over the colour; matplotlib's hatch
    "bias": ("M-1 1l2-2M0 6l6-6M5 7l2-2", "////"), "place": ("M1.5 1.5h0M4.5 4.5h0", ".."),
    "orbit": ("M0 0l6 6M6 0l-6 6", "xxx"), "timing": ("M3 0v6", "|||"), "photocentre": ("M0 1.5h6M0 4.5h6", "----"),
    "body": ("M0 3h6", "--"), "push": ("M-1 5l2 2M0 0l6 6M5-1l2 2", "\\\\\\\\"), "shared": ("M3 0v6M0 3h6", "++"),
    "other": ("M0 3h6M3 0v6", "++"),
}  # fmt: skip


def fill(kind: str) -> str:
    """The fill of a kind in a page."""
    return f"url(#hatch-{kind})" if kind in HATCH else COLOUR[kind]


def plain(fill: str) -> tuple[str, str]:
    """Colour and matplotlib's hatch of a fill; none of a plain colour."""
    kind = fill.removeprefix("url(#hatch-").removesuffix(")")
    return (COLOUR[kind], HATCH[kind][1]) if fill.startswith("url(") else (fill, "")


def patterns() -> Markup:
    """The patterns as one invisible picture; a page that draws sources holds it once."""
    tiles = []
    for kind, (path, _) in HATCH.items():
        cap = ' stroke-linecap="round"' if "h0" in path else ""
        wide = 2.0 if "h0" in path else 1.1
        tiles.append(
            f'<pattern id="hatch-{kind}" width="6" height="6" patternUnits="userSpaceOnUse">'
            f'<rect width="6" height="6" fill="{COLOUR[kind]}"/>'
            f'<path d="{path}" stroke="#fff" stroke-opacity="0.75" stroke-width="{wide}" fill="none"{cap}/></pattern>'
        )
    return Markup(
        '<svg xmlns="http://www.w3.org/2000/svg" class="unseen" width="0" height="0" aria-hidden="true"><defs>'
        + "".join(tiles)
        + "</defs></svg>"
    )
