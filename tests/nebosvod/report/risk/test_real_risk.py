"""A real risk, of 2024 BX1 two hours before its fall: its folder obeys the schema, its page shows where."""

import html
import json
import re
from pathlib import Path

import jsonschema
import numpy as np
import pytest

from nebosvod.borders.shape import schema_file
from nebosvod.cli import main
from nebosvod.results.folder import SCHEMAS

ORBIT = Path(__file__).resolve().parents[4].parent / "shared" / "data" / "orbits" / "neocc" / "2024BX1.ke0"


@pytest.mark.skipif(not ORBIT.is_file(), reason="the folder of reference data is not here")
def test_2024_bx1_has_a_folder_of_its_schema_and_a_page_with_its_place(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "bx1"
    asked = ["risk", str(ORBIT), "--until", "2024-02-01", "--draws", "200", "-o", str(folder)]
    assert main(asked) == 0
    summary = json.loads((folder / "summary.json").read_text("utf-8"))
    jsonschema.validate(summary, schema_file(SCHEMAS["risk"]))
    page = (folder / "report.html").read_bytes()
    assert main(["report", str(folder)]) == 0
    assert (folder / "report.html").read_bytes() == page
    text = html.unescape(page.decode())
    # every drawn orbit hits, and is seen inside the enlarged ellipse of some 65 x 19 m
    near = text[text.index('<figure id="target-0"') :].split("</figure>")[0].split('<g class="axes">')[2]
    dots = dict(re.findall(r'<(?:path|g) class="s" data-n="(drawn, [^"]+)"(.+)', near))
    assert dots["drawn, hits"].count("M") > 190
    # stones were found about 52.63 N, 12.73 E (Bischoff et al. 2024): on land, west of Berlin
    with np.load(folder / "arrays.npz") as arrays:
        assert np.median(arrays["longitude_deg"]) == pytest.approx(12.7, abs=0.1)
    assert "of 200\xa0places on land" in re.sub(r"<[^>]+>", "", text)
    assert '<figure id="map-corridor-near"' in text
    assert main(asked) == 3  # the folder is there
    assert "--overwrite" in capsys.readouterr().err
    assert main([*asked, "--overwrite"]) == 0
