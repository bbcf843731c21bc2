"""What matplotlib has drawn, as pieces of SVG by the name each artist was given.

A page puts the pieces together in groups of its own, so that its script finds axes and marks.
"""

import io
import re
import sys
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from typing import Any

from markupsafe import escape
from matplotlib import rc_context, rcdefaults
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

SETTINGS: dict[Any, Any] = {
    "svg.hashsalt": "nebosvod",  # one figure, one name of each marker, in every run
    "path.simplify": False,
    "path.snap": False,
    "lines.scale_dashes": False,
}
if "matplotlib.pyplot" not in sys.modules:  # nobody else draws in this process
    rcdefaults()  # a matplotlibrc of the working directory or the home says nothing about our pages
SVG, XLINK = "{http://www.w3.org/2000/svg}", "{http://www.w3.org/1999/xlink}"
NUMBER = re.compile(r"-?\d+\.\d+")
# what matplotlib writes and every reader assumes anyway
ASSUMED = {("fill-rule", "evenodd"), ("stroke-linecap", "butt"), ("stroke-linejoin", "miter"), ("opacity", "1")}


def pieces(figure: Figure, prefix: str) -> dict[str, list[str]]:
    """Draw a figure: for each artist that has a gid, its elements as text, coordinates to 0.01 px.

    Parameters
    ----------
    prefix : put before the ids of markers, so that several figures fit on one page.
    """
    text = io.StringIO()
    with rc_context(SETTINGS):
        FigureCanvasSVG(figure)
        figure.savefig(text, format="svg", metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    root = ET.fromstring(text.getvalue())  # our own text: nothing in it comes from outside
    found: dict[str, list[str]] = {}
    for group in root.iter(f"{SVG}g"):
        name = group.get("id", "")
        if name.startswith("nb-"):
            found[name] = [*_elements(group, prefix)]
    return found


def _elements(group: ET.Element, prefix: str) -> Iterator[str]:
    """The drawn elements of a group, without the groups around them."""
    for child in group:
        tag = child.tag.removeprefix(SVG)
        if tag == "g" and child.find(f"{SVG}use") is not None:
            yield from _markers(child, prefix)
        elif tag == "g":
            yield from _elements(child, prefix)
        elif tag == "defs":
            shapes = [_written("path", {"id": prefix + e.get("id", ""), "d": _rounded(e.get("d", ""))}) for e in child]
            yield f"<defs>{''.join(shapes)}</defs>"
        elif tag == "path":
            yield _written("path", {"d": _rounded(child.get("d", ""))} | _look(child))


def _markers(group: ET.Element, prefix: str) -> Iterator[str]:
    """A group of markers of one look."""
    uses = group.findall(f"{SVG}use")
    places = [
        _written("use", {
            "href": "#" + prefix + use.get(f"{XLINK}href", "#")[1:],
            "x": _rounded(use.get("x", "0")), "y": _rounded(use.get("y", "0")),
        }) for use in uses
    ]  # fmt: skip
    yield _written("g", _look(uses[0])).replace("/>", f">{''.join(places)}</g>")


def _look(element: ET.Element) -> dict[str, str]:
    """The style of an element as attributes, without what need not be said."""
    style = {key: value for key, value in _declarations(element.get("style", "")) if (key, value) not in ASSUMED}
    if style.get("stroke", "none") == "none":
        style = {key: value for key, value in style.items() if not key.startswith("stroke")}
    return style


def _declarations(style: str) -> Iterator[tuple[str, str]]:
    for one in style.split(";"):
        key, colon, value = one.partition(":")
        if colon:
            yield key.strip(), value.strip()


def _rounded(text: str) -> str:
    """Numbers to 0.01 px, one space between two of them, none elsewhere."""
    short = NUMBER.sub(lambda found: f"{float(found[0]):.2f}".rstrip("0").rstrip("."), text)
    return re.sub(r"\s*\b([A-Za-z])\b\s*|\s*([MLCQHVz])\s*", lambda m: m[1] or m[2], " ".join(short.split())).strip()


def _written(tag: str, attributes: Mapping[str, str]) -> str:
    return f"<{tag}" + "".join(f' {key}="{escape(value)}"' for key, value in attributes.items() if value) + "/>"
