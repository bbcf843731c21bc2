"""What `alert` says of what cannot hit: no false alarm, no place where it would fall, a range told both ways."""

import json
import re
import sys
from pathlib import Path
from typing import Any

import pytest

from nebosvod.cli import main
from nebosvod.dynamics import Ephemeris

sys.path.insert(0, str(Path(__file__).resolve().parent))
from kinds import KINDS, made  # type: ignore[import-not-found]


@pytest.mark.parametrize(
    ("name", "most"), [("comet, e = 1", 0.01), ("main belt", 0.01), ("flyby at 1 LD, 5 d before", 0.03)]
)
def test_what_cannot_hit_is_below_a_bound_and_falls_nowhere(
    name: str, most: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of few drawn orbits that hit and weigh 1e-6, a date and a place were told; the bound was that of all draws.

    Three of the effective draws of what comes near the Earth, times its share of the weight, bound the far ones.
    """
    truth = made(KINDS[name], Ephemeris.load())
    (tmp_path / "kind.psv").write_text(truth.text, "utf-8")
    assert main(["alert", str(tmp_path / "kind.psv"), "--json", "--hours", "1"]) == 0
    found: dict[str, Any] = json.loads(capsys.readouterr().out)
    assert found["bound"]
    assert found["probability"] is None
    assert 1e-6 <= found["high"] < most
    assert found["impact"] is None
    region = found["regions"]["95"]
    assert region["range_au"][0] < truth.range_au < region["range_au"][1]
    assert region["rate_km_s"][0] < truth.rate_km_s < region["rate_km_s"][1]
    told = re.search(r"within a factor of ([\d.]+)", found["message"])
    assert told is not None
    ends = found["quantities"]["range_au"]
    factor = float(told[1]) * 1.06  # two digits
    assert ends["median"] / factor < ends["q16"]
    assert ends["q84"] < ends["median"] * factor


def test_no_orbit_of_an_answer_about_bound_ones_is_unbound(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """At 40 au noise of the motion alone unbinds half of the orbits drawn about bound ones: a was -4 au."""
    truth = made(KINDS["opposition, 40 au"], Ephemeris.load())
    (tmp_path / "kind.psv").write_text(truth.text, "utf-8")
    assert main(["alert", str(tmp_path / "kind.psv"), "--json", "--hours", "1"]) == 0
    found: dict[str, Any] = json.loads(capsys.readouterr().out)
    assert found["bound_to_the_sun"]
    assert found["scores"]["hyperbolic"] == 0.0
    assert all(found["quantities"]["a_au"][name] > 0.0 for name in ("q025", "q16", "median", "q84", "q975"))
    assert found["quantities"]["e"]["q975"] < 1.0
    assert found["regions"]["95"]["range_au"][0] < truth.range_au < found["regions"]["95"]["range_au"][1]
