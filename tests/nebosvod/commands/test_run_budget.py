"""The budget of a prediction in a terminal: a source whose loss would make it worse is not left unexplained."""

from typing import Any

import pytest

from nebosvod.commands.run_answer import _budget_of


@pytest.mark.parametrize(("left_km", "said"), [(3125.0, True), (4.0, False), (None, False)])
def test_a_total_that_grows_without_a_source_is_explained(left_km: float | None, said: bool) -> None:
    row: dict[str, Any] = {"source": "measurement noise V2", "share_total": 1.0, "sigma_total_km": 5.0}
    row["if_vanished"] = {"sigma_total_km_new_gain": left_km}
    asked = {"name": "encounter", "plane": "b_plane", "sigma_km": [3.0, 4.0], "budget": [row]}
    told = _budget_of(asked, "batch").caption
    assert (told is not None) is said
    if said:
        assert "would trust those measurements too much" in str(told)
