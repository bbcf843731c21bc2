"""Two settings that look for the same objects: who sees what the other does not, and whether that is chance."""

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy import stats

from nebosvod.cli import main
from nebosvod.studies.paired import difference, paired
from tests.nebosvod.studies.test_population import SCHEMA


def flags(both: int, only_here: int, only_first: int, neither: int) -> tuple[np.ndarray, np.ndarray]:
    """What the first and the other setting see of so many objects."""
    first = np.repeat([True, False, True, False], [both, only_here, only_first, neither])
    here = np.repeat([True, True, False, False], [both, only_here, only_first, neither])
    return first, here


def test_the_interval_is_that_of_newcombe() -> None:
    """Newcombe 1998, Statistics in Medicine 17, 2635, method 10 for 36, 12, 2, 0: 0.0569 to 0.3404."""
    found = difference(*flags(36, 12, 2, 0))
    assert found["difference"] == pytest.approx(0.2)
    assert found["interval_95"] == pytest.approx([0.0569, 0.3404], abs=5e-5)
    assert (found["n"], found["only_here"], found["only_first"]) == (50, 12, 2)


def test_p_is_that_of_a_coin_thrown_for_each_object_that_one_alone_sees() -> None:
    assert difference(*flags(36, 12, 2, 0))["p"] == pytest.approx(stats.binomtest(2, 14).pvalue)
    assert difference(*flags(3, 5, 5, 1))["p"] == 1.0
    assert difference(*flags(9, 0, 0, 3))["p"] == 1.0


def test_it_covers_the_true_difference_as_often_as_it_says() -> None:
    rng, parts = np.random.default_rng(4), (0.6, 0.05, 0.02, 0.33)
    intervals = [difference(*flags(*rng.multinomial(100, parts)))["interval_95"] for _ in range(600)]
    covered = np.mean([low <= 0.03 <= high for low, high in intervals])
    assert covered > stats.binom.ppf(0.005, 600, 0.95) / 600


def test_a_study_of_a_catalogue_tells_what_a_deeper_limit_sees_more(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("objects.csv").write_text(
        "full_name,epoch,e,a,i,om,w,ma,H\n"
        + "".join(
            f"b{k},2461800.5,{0.1 + 0.05 * k},{1.1 + 0.1 * k},{2 + k},{40 * k},{70 * k},{55 * k},{19 + k}\n"
            for k in range(5)
        ),
        "utf-8",
    )
    Path("s.yaml").write_text(
        "schema_version: 1\nstudy: s\nmission: minimal\nobjects: {from: objects.csv}\n"
        "vary:\n  limit: {set: telescopes.*.limiting_magnitude, values: [18, 30]}\n"
        "answer:\n  - {name: sigma, of: predictions.ten days later.semi_axes_km.0}\n",
        "utf-8",
    )
    assert main(["study", "s.yaml", "-o", "o", "--workers", "1"]) in (0, 1)
    said, found = capsys.readouterr().out, json.loads(Path("o/study.json").read_text("utf-8"))
    (row,) = found["paired"]
    seen = [one["n_seen"] for one in found["seen"]]
    assert row["n"] == 5
    assert row["only_here"] == seen[1] - seen[0] > 0 == row["only_first"]
    assert (row["than"], row["where"]) == ({"limit": 18.0}, {"limit": 30.0})
    assert f"limit 30 beside limit 18, the same 5 objects: {row['only_here']} seen only here, 0 only there" in said
    assert "The same 5 objects, beside limit 18" in Path("o/study.html").read_text("utf-8")
    assert SCHEMA["properties"]["paired"]["items"]["required"] == list(row)


def test_a_sample_whose_settings_differ_at_each_object_pairs_nothing() -> None:
    study: Any = SimpleNamespace(
        axes=[SimpleNamespace(name="object"), SimpleNamespace(name="limit")], objects=1, drawn=0
    )
    columns = {
        "object": np.array(["a", "b", "c"]), "limit": np.array([1.0, 2.0, 3.0]),
        "status": np.array(["ok", "ok", "not_seen"]), "draw": np.zeros(3),
    }  # fmt: skip
    assert paired(study, columns) == []
    assert paired(study, {name: values[:0] for name, values in columns.items()}) == []
