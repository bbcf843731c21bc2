"""Figures of a mission before it is run: where everything is, and what each telescope can see."""

from functools import cached_property

from nebosvod.engine.assembly import nominal_view
from nebosvod.mission import Mission
from nebosvod.notebook.plots import Plots, texts
from nebosvod.report.kit.standing import PageFigure
from nebosvod.report.run import geometry, timeline, viewing
from nebosvod.results.folder import RunFolder
from nebosvod.results.run_tables import all_arrays, visibility_table
from nebosvod.scene.scene import PlannedScene, build_scene


class MissionPlots(Plots):
    """Figures of a mission; they propagate its orbit and measure nothing.

    Examples
    --------
    >>> import nebosvod
    >>> figure = nebosvod.load_mission("minimal").plot.timeline()
    """

    def __init__(self, mission: Mission) -> None:
        super().__init__(mission.name)
        self._mission = mission

    def geometry(self) -> PageFigure:
        """Sun, Earth, telescopes and the asteroid, seen from the north of the ecliptic."""
        return self._first([geometry.geometry_plate(self._run)], "no exposure that can be made")

    def viewing(self) -> PageFigure:
        """Distance and angle from the Sun at each exposure."""
        return self._first([viewing.viewing(self._run)], "no two exposures that can be made")

    def timeline(self) -> PageFigure:
        """Every scheduled epoch of each telescope: seen, or lost and why; below, the brightness."""
        table = visibility_table(self._scene)
        return self._first([timeline.timeline_plate(self._run, texts(table.columns))], "no schedule of two epochs")

    @cached_property
    def _scene(self) -> PlannedScene:
        return build_scene(self._mission)

    @cached_property
    def _run(self) -> RunFolder:
        nominal = nominal_view(self._scene)
        summary = {
            "reference_epoch_tdb": self._mission.reference_epoch.iso(),
            "telescopes": [one.name for one in self._mission.telescopes],
            "estimators": [],
        }
        return RunFolder(
            manifest={}, summary=summary, arrays=all_arrays(self._scene, nominal, [], nominal.observation.psi)
        )
