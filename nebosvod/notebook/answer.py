"""Answers: what a command found, as an object that shows itself in a notebook, draws, is saved and makes its page."""

import base64
import tempfile
import warnings
from abc import ABC, abstractmethod
from collections.abc import Mapping
from functools import cached_property
from html import escape
from pathlib import Path
from typing import Any, ClassVar, Self, cast

import numpy.typing as npt
from markupsafe import Markup

from nebosvod.borders.wholefile import write_new_text, write_whole
from nebosvod.errors import InputError, OutputError, counted
from nebosvod.notebook.plots import FitPlots, PagePlots, Plots, RunPlots, texts
from nebosvod.notebook.summaries.alert import AlertSummary
from nebosvod.notebook.summaries.approaches import ApproachesSummary
from nebosvod.notebook.summaries.ephemeris import EphemerisSummary
from nebosvod.notebook.summaries.reading import read
from nebosvod.notebook.summaries.risk import RiskSummary
from nebosvod.notebook.tables import Tables
from nebosvod.notebook.typed import Summary, summary_of
from nebosvod.report.kit.facts import leading, size
from nebosvod.report.kit.gathered import Gathered, gathering
from nebosvod.report.kit.standing import PageFigure
from nebosvod.report.kit.wording import percent, plane_name, quantity
from nebosvod.report.pages import report_text
from nebosvod.report.run.verdict import verdict
from nebosvod.results import result as stored
from nebosvod.results.folder import RunFolder
from nebosvod.results.result import OwnedFolder, json_text, write_files

Item = Mapping[str, Any]
STYLE = "background:#fff;color:#1a1a1a;padding:.6em .8em;border:1px solid #ccc;max-width:60em"
TONES = {"good": "#00734f", "caution": "#8a5a00", "bad": "#a3320b"}  # on white, contrast AA
MOST_ROWS, MOST_SOURCES = 12, 4


class Page:
    """A page as HTML: `save` writes it, a notebook shows it in a frame."""

    def __init__(self, text: str) -> None:
        self.text = text

    def save(self, path: str | Path, *, overwrite: bool = False) -> Path:
        """Write it to a file; returns its path.

        Raises
        ------
        OutputError
            If the file is there and not to be overwritten, or cannot be written.
        """
        place = Path(path)
        if overwrite:
            return write_whole(place, self.text.encode("utf-8"))
        write_new_text(place, self.text)
        return place

    def __repr__(self) -> str:
        return f"<Page of {len(self.text) // 1024} kB; .save(path) writes it>"

    def _repr_html_(self) -> str:
        frame = 'width="100%" height="640" style="border:1px solid #ccc;background:#fff" title="report"'
        return f'<iframe srcdoc="{escape(self.text)}" sandbox="allow-scripts allow-downloads" {frame}></iframe>'


class Answer(ABC):
    """What a command found.

    Attributes
    ----------
    summary : every number, as the JSON of the command has it; units in the key names.
    """

    kind: ClassVar[str] = "answer"

    def __init__(self, summary: Item) -> None:
        self.summary = summary

    @property
    def title(self) -> str:
        """What it is about."""
        return str(self.summary.get("title") or self.summary.get("mission") or self.kind)

    @property
    def headline(self) -> str:
        """The answer in a sentence, as on top of its page."""
        return plain(self._words("headline", "verdict", "said"))

    @property
    def facts(self) -> list[tuple[str, str]]:
        """The numbers a reader looks for first, each with what it is."""
        return [(name, plain(value)) for name, value in self._gathered.words.get("tiles") or ()]

    @property
    def plot(self) -> Plots:
        """Its figures: `answer.plot.names` lists them, `answer.plot.NAME()` draws one with matplotlib."""
        return PagePlots(self.title, self._gathered.plates)

    def report(self, path: str | Path | None = None, *, overwrite: bool = False) -> Page:
        """Its page; with a path it is written there too."""
        page = Page(self._text)
        if path is not None:
            page.save(path, overwrite=overwrite)
        return page

    def summary_text(self) -> str:
        """The summary as JSON."""
        return json_text(self.summary)

    def picture(self) -> PageFigure | None:
        """The figure that a notebook shows with it; None where there is none."""
        found = self.plot.names
        return getattr(self.plot, found[0])() if found else None

    @abstractmethod
    def _page_text(self) -> str:
        """Its page as HTML."""

    @cached_property
    def _made(self) -> tuple[str, Gathered]:
        with gathering() as found:
            text = self._page_text()
        return text, found

    @property
    def _text(self) -> str:
        return self._made[0]

    @property
    def _gathered(self) -> Gathered:
        return self._made[1]

    def _words(self, *names: str) -> Any:
        """What the page says by the first of some names."""
        return next((found for name in names if (found := self._gathered.words.get(name))), "")

    @property
    def _tone(self) -> str:
        return TONES.get(str(self._words("tone")), "#1a1a1a")

    def __repr__(self) -> str:
        told = self.headline
        return f"<{type(self).__name__}: {self.title}{'. ' + told if told else ''}>"

    def _repr_html_(self) -> str:
        rows = "".join(
            f'<tr><th scope="row" style="text-align:left;font-weight:normal">{escape(name)}</th>'
            f'<td style="text-align:right;padding-left:1.5em">{escape(value)}</td></tr>'
            for name, value in self.facts[:MOST_ROWS]
        )
        table = f'<table style="border-collapse:collapse;margin:.4em 0">{rows}</table>' if rows else ""
        told = f'<p style="color:{self._tone};font-weight:bold;margin:.3em 0">{escape(self.headline)}</p>'
        title = f'<p style="margin:0">{escape(self.title)}</p>'
        return f'<div style="{STYLE}">{title}{told}{table}{self._rows()}{self._img()}</div>'

    def _rows(self) -> str:
        """A table of its own inside the HTML; empty where there is none."""
        return ""

    def _img(self) -> str:
        """The picture inside the HTML, with words for who cannot see it."""
        figure = self.picture()
        if figure is None:
            return ""
        data = base64.b64encode(figure.png(dpi=90.0)).decode()
        words = escape(f"{figure.label}. {figure.caption}")
        return f'<img alt="{words}" style="max-width:100%" src="data:image/png;base64,{data}">'


def plain(value: Any) -> str:
    """Words of a page as text."""
    return Markup(value).striptags() if value is not None else ""


class FolderAnswer(Answer):
    """An answer that can be kept as a folder.

    Attributes
    ----------
    tables : by name, astropy tables with units, moments as Time.
    arrays : by name, as docs/report.md lists them; manifest : where it came from.
    """

    ending: ClassVar[str] = "run"

    def __init__(self, result: stored.Result) -> None:
        super().__init__(result.summary)
        self.stored = result
        self.manifest: Item = result.manifest
        self.arrays: Mapping[str, npt.NDArray[Any]] = result.arrays
        self.tables = Tables(result.tables)

    @property
    def failed(self) -> bool:
        """Whether the command ends with exit code 1: no convergence, not observable, or a question without answer."""
        return self.stored.failed

    @classmethod
    def load(cls, folder: str | Path) -> Self:
        """Read a folder back.

        Raises
        ------
        InputError
            If it is not the folder of such an answer; says what it is instead.
        """
        found = answer_of(stored.Result.load(folder))
        if not isinstance(found, cls):
            raise InputError(
                f"{folder}: is the folder of a {found.kind}; read it by nebosvod.{type(found).__name__}.load"
            )
        return found

    def save(self, folder: str | Path | None = None, *, overwrite: bool = False) -> Path:
        """Write the folder with its report, whole or not at all; returns its path.

        Parameters
        ----------
        folder : `./NAME-run` (for a fit `./NAME-fit`) by default, as the command would.
        overwrite : replace an earlier answer of this program there.

        Raises
        ------
        OutputError
            If something is in the way, or the place cannot be written.
        """
        place = Path(folder) if folder is not None else Path(f"{self._slug}-{self.ending}")
        try:
            with OwnedFolder(place, report_text, overwrite=overwrite) as target:
                target.publish(self.stored)
        except OutputError as error:
            for option, here in (("--overwrite", "overwrite=True"), (" with -o", ""), ("-o for ", "")):
                error.args = (str(error).replace(option, here),)
            raise
        return place

    def lent(self, parent: Path, ending: str = "") -> Path:
        """Its files, without the page, in a new folder for another function to read."""
        folder = parent / f"{self._slug}-{ending or self.ending}"
        folder.mkdir(parents=True)
        write_files(folder, self.stored, lambda _: "")
        return folder

    @property
    def _slug(self) -> str:
        from nebosvod.mission.slugs import slug

        return slug(str(self.summary.get("mission") or self.summary.get("object") or self.kind))

    def _page_text(self) -> str:
        with tempfile.TemporaryDirectory() as folder:
            write_files(Path(folder), self.stored, report_text)
            return (Path(folder) / "report.html").read_text("utf-8")


class Result(FolderAnswer):
    """What a run found: how well the orbit and its predictions are known, and which source is to blame.

    Examples
    --------
    >>> import nebosvod
    >>> result = nebosvod.run("minimal")
    >>> result
    <Result: The smallest mission, a month of a fictitious near-Earth asteroid. ...>
    >>> result.typed.estimates[0].sigma_position
    <Quantity 16.886... km>
    >>> result.tables["budget"]["sigma_position_km"].max()
    <Quantity ... km>
    >>> figure = result.plot.geometry()
    """

    kind = "run"
    pictures: ClassVar[tuple[str, ...]] = (
        "target_plane",
        "ellipse",
        "geometry",
    )  # what a notebook shows, by preference

    @property
    def typed(self) -> Summary:
        """The summary with types: quantities with units, moments as Time."""
        return summary_of(self.summary)

    @property
    def headline(self) -> str:
        """The answer in a sentence, as on top of its page."""
        return plain(verdict(self._run).headline)

    @property
    def facts(self) -> list[tuple[str, str]]:
        """Sigmas of the predictions and of the orbit, and the largest sources of the first of them."""
        main = self._run.main
        if main is None:
            return []
        rows = leading(self._run, main)
        told = [(f"{p['name']} ({plane_name(p['plane'], p.get('body'))}), 1σ", plain(size(p))) for p in rows]
        told += [
            ("position at the reference epoch, 1σ", plain(quantity(main["sigma_position_km"], "km"))),
            ("velocity, 1σ", plain(quantity(main["sigma_velocity_m_s"], "m_s"))),
        ]
        shares = [(row["source"], row["share_total"]) for row in rows[0]["budget"]] if rows else []
        shares = shares or [(row["source"], row["share_position"]) for row in self._run.budget(main["name"])]
        of = rows[0]["name"] if rows else "position"
        largest = sorted(shares, key=lambda one: -one[1])[:MOST_SOURCES]
        return [*told, *((f"share of {source} in {of}", plain(percent(share))) for source, share in largest)]

    @property
    def plot(self) -> RunPlots:
        """Figures: `budget()`, `target_plane()`, `geometry()`, `timeline()` and more, as figures of matplotlib."""
        visible = self.stored.tables.get("visibility")
        return RunPlots(self.title, self._run, None if visible is None else texts(visible.columns))

    def picture(self) -> PageFigure | None:
        """The first of its `pictures` that there is."""
        for name in self.pictures:
            try:
                return cast(PageFigure, getattr(self.plot, name)())
            except InputError:
                continue
        return None

    @property
    def _run(self) -> RunFolder:
        return RunFolder(manifest=self.manifest, summary=self.summary, arrays=self.arrays)

    @property
    def _tone(self) -> str:
        return TONES[verdict(self._run).tone]


class Fit(Result):
    """What a fit of real observations found."""

    kind, ending = "fit", "fit"
    pictures = ("target_plane", "ellipse", "residuals")
    headline, facts = Answer.headline, Answer.facts

    @property
    def plot(self) -> FitPlots:
        """Figures: `residuals()`, `stations()`, `correlation()`, `target_plane()`, `ellipse()`."""
        return FitPlots(self.title, self._run, None)

    @property
    def _tone(self) -> str:
        return TONES.get(str(self._words("tone")), "#1a1a1a")


class Risk(FolderAnswer):
    """How probable it is that an orbit hits, for each virtual impactor."""

    kind = ending = "risk"

    @property
    def typed(self) -> RiskSummary:
        """The summary with types: quantities with units, moments as Time."""
        return read(self.summary, RiskSummary)


class Alert(FolderAnswer):
    """How probable an impact is when observations are too few for an orbit."""

    kind = ending = "alert"

    @property
    def typed(self) -> AlertSummary:
        """The summary with types: quantities with units, moments as Time."""
        return read(self.summary, AlertSummary)


class Listed(FolderAnswer):
    """An answer that is one table, of the name of its kind."""

    shown: ClassVar[tuple[str, ...]]

    def _rows(self) -> str:
        table = self.tables[self.kind]
        if not len(table):
            return ""
        cut = table[list(self.shown)][:MOST_ROWS]
        for name in self.shown:
            if getattr(getattr(cut[name], "dtype", None), "kind", "") == "f":
                cut[name].info.format = ".6g"
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # erfa calls every UTC date to come dubious
            lines = cut.pformat(html=True, max_width=-1, max_lines=-1)
        more = f"<p>{counted(len(table), 'row')} in all</p>" if len(table) > MOST_ROWS else ""
        return "".join(lines) + more


class Sky(Listed):
    """Where an orbit is seen, and how well that is known: an ephemeris."""

    kind = ending = "ephemeris"
    shown = ("epoch_utc", "ra_deg", "dec_deg", "semi_major_arcsec", "semi_minor_arcsec", "distance_au", "V")

    @property
    def typed(self) -> EphemerisSummary:
        """The summary with types: quantities with units, moments as Time."""
        return read(self.summary, EphemerisSummary)


class Approaches(Listed):
    """What an orbit comes near to, and how near."""

    kind = ending = "approaches"
    shown = ("body", "epoch_tdb", "distance_km", "sigma_distance_km", "impact_probability_linear")

    @property
    def typed(self) -> ApproachesSummary:
        """The summary with types: quantities with units, moments as Time."""
        return read(self.summary, ApproachesSummary)


KINDS: Mapping[str | None, type[FolderAnswer]] = {
    None: Result, "fit": Fit, "risk": Risk, "alert": Alert, "ephemeris": Sky, "approaches": Approaches,
}  # fmt: skip


def answer_of(result: stored.Result) -> FolderAnswer:
    """The answer of a stored result, by its kind."""
    kind = result.summary.get("kind")
    return KINDS.get(kind if isinstance(kind, str) else None, Result)(result)
