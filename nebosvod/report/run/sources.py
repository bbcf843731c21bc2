"""How each source of uncertainty looks: one colour and pattern for a kind everywhere, paler by telescope.

The colours are those of Okabe and Ito (2008); the patterns tell the kinds apart in grey print as well.
"""

from collections.abc import Sequence

from nebosvod.report.kit.hatch import fill

KINDS: tuple[tuple[str, str], ...] = (  # the first word found in a source's name decides; order matters
    ("measurement noise", "noise"), ("bias", "bias"), ("orbit error", "orbit"), ("telescope position", "place"),
    ("position of", "place"), ("timing", "timing"), ("photocentre", "photocentre"), ("prior", "prior"),
    ("orbit of the object", "prior"), ("radius", "body"), ("mass", "body"), ("density", "body"), ("albedo", "body"),
    ("thermal", "body"), ("A1", "push"), ("A2", "push"), ("A3", "push"),
)  # fmt: skip
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
    return {"fill": fill(kind)} | ({"fill-opacity": pale} if pale < 1.0 else {})
