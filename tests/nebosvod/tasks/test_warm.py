"""Warm processes: messages as they come, a stale request that holds nothing up, a process that dies alone."""

import asyncio
import json
import os
import time
from collections.abc import Iterator, Mapping
from typing import Any

import pytest

from nebosvod.errors import WorkerError
from nebosvod.tasks.warm import WarmProcesses

OPENER = f"{__name__}:opened"


def opened() -> Any:
    """A process that counts its requests."""
    count = 0

    def serve(request: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
        nonlocal count
        count += 1
        yield {"process": os.getpid(), "count": count}
        if request["verb"] == "sleep":
            time.sleep(60.0)
        elif request["verb"] == "die":
            os._exit(9)
        elif request["verb"] == "wrong":
            raise ValueError("no")
        yield {"done": request["verb"]}

    return serve


async def all_of(warm: WarmProcesses, verb: str) -> list[Any]:
    return [json.loads(said) async for said in warm.messages({"verb": verb})]


def test_what_nobody_waits_for_is_ended_and_the_next_is_served_at_once(tmp_path: Any) -> None:
    async def go() -> None:
        warm = WarmProcesses(OPENER)
        try:
            first = await all_of(warm, "a")
            assert [first[0]["count"], first[1]] == [1, {"done": "a"}]
            wrong = await all_of(warm, "wrong")
            assert wrong[1]["text"] == "ValueError: no"
            slept = warm.messages({"verb": "sleep"})
            busy = json.loads(await anext(slept))["process"]
            await slept.aclose()
            started = time.monotonic()
            second = await all_of(warm, "b")
            assert second[0]["process"] != busy
            assert time.monotonic() - started < 40.0  # 60 s would it sleep
            with pytest.raises(WorkerError, match="exit code 9"):
                await all_of(warm, "die")
            assert (await all_of(warm, "c"))[1] == {"done": "c"}
        finally:
            warm.end()

    asyncio.run(go())
