"""A matrix of campaigns, analysed in several processes; every outcome is written as soon as it is known."""

import dataclasses
import json
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from operator import itemgetter
from pathlib import Path
from typing import Any

from tqdm import tqdm


def collect(
    analyse: Callable[[Any], dict[str, Any]], wanted: Sequence[Any], path: Path, workers: int | None = None
) -> list[dict[str, Any]]:
    """Outcomes of the wanted cases as they ended; what ``path`` (JSON lines) holds is not run again.

    Cases are flat dataclasses of two fields or more, which ``analyse`` returns among what it found.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    known = [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []
    key = itemgetter(*(field.name for field in dataclasses.fields(wanted[0])))
    done, asked = set(map(key, known)), set(map(dataclasses.astuple, wanted))
    todo = [case for case in wanted if dataclasses.astuple(case) not in done]
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool, path.open("a") as out:
        running = [pool.submit(analyse, case) for case in todo]
        for future in tqdm(as_completed(running), total=len(todo), unit="campaign"):
            known.append(future.result())
            out.write(json.dumps(known[-1]) + "\n")
            out.flush()
    return [one for one in known if key(one) in asked]
