"""How each source of uncertainty looks: one colour and pattern for a kind everywhere, paler by telescope.

The colours are those of Okabe and Ito (2008); the patterns tell the kinds apart in grey print as well.
"""

from collections.abc import Mapping, Sequence

from markupsafe import Markup

from nebosvod.report.kit.plate import BLUE, GREEN, GREY, ORANGE, PURPLE, SKY, VERMILION

BROWN, DARK = "#7A5230", "#44505C"
KINDS: tuple[tuple[str, str], ...] = (  # the first word found in a source's name decides; order matters
    ("measurement noise", "noise"), ("bias", "bias"), ("orbit error", "orbit"), ("telescope position", "place"),
    ("position of", "place"), ("timing", "timing"), ("photocentre", "photocentre"), ("prior", "prior"),
    ("orbit of the object", "prior"), ("radius", "body"), ("mass", "body"), ("density", "body"), ("albedo", "body"),
    ("thermal", "body"), ("A1", "push"), ("A2", "push"), ("A3", "push"),
)  # fmt: skip
COLOUR: Mapping[str, str] = {
    "noise": BLUE, "bias": VERMILION, "place": ORANGE, "orbit": SKY, "timing": PURPLE, "photocentre": BROWN,
    "body": GREEN, "push": "#00573F", "prior": GREY, "shared": DARK, "other": "#999999",
}  # fmt: skip
HATCH: Mapping[str, str] = {  # paths in a tile of 6 x 6, drawn in white over the colour
    "bias": "M-1 1l2-2M0 6l6-6M5 7l2-2", "place": "M1.5 1.5h0M4.5 4.5h0", "orbit": "M0 0l6 6M6 0l-6 6",
    "timing": "M3 0v6", "photocentre": "M0 1.5h6M0 4.5h6", "body": "M0 3h6", "push": "M-1 5l2 2M0 0l6 6M5-1l2 2",
    "shared": "M3 0v6M0 3h6", "other": "M0 3h6M3 0v6",
}  # fmt: skip
PALER = (1.0, 0.62, 0.8, 0.45)  # opacity of the first, second, ... telescope


def kind_of(source: str, behind: Sequence[str] = ()) -> str:
    """The kind of a source: by its name, else "shared" where several telescopes have it in common."""
    for word, kind in KINDS:
        if source.startswith(word):
            return kind
    return "shared" if len(behind) > 1 else "other"


def look(source: str, telescopes: Sequence[str], behind: Sequence[str] = ()) -> dict[str, object]:
    """Fill of a source's bars; `behind` are the telescopes it belongs to, among all `telescopes`."""
    kind = kind_of(source, behind)
    own = [i for i, name in enumerate(telescopes) if source.endswith(" " + name)] if len(behind) != 1 else [
        i for i, name in enumerate(telescopes) if name == behind[0]
    ]  # fmt: skip
    pale = PALER[own[0] % len(PALER)] if own and kind != "shared" else 1.0
    fill = f"url(#hatch-{kind})" if kind in HATCH else COLOUR[kind]
    return {"fill": fill} | ({"fill-opacity": pale} if pale < 1.0 else {})


def patterns() -> Markup:
    """The patterns as one invisible picture; a page that draws sources holds it once."""
    tiles = []
    for kind, path in HATCH.items():
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
