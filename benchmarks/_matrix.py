"""A matrix of campaigns, analysed in several processes; every outcome is written as soon as it is known."""

import argparse
import dataclasses
import json
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, field
from multiprocessing import get_context
from operator import itemgetter
from pathlib import Path
from typing import Any

from tqdm import tqdm

from _figures import Figure


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


def options(about: str | None, seeds: int, out: Path, only: str = "") -> argparse.ArgumentParser:
    """What the command of a matrix takes; ``only`` says what may be chosen, if anything."""
    parser = argparse.ArgumentParser(description=about)
    parser.add_argument("--seeds", type=int, default=seeds)
    if only:
        parser.add_argument("--only", action="append", default=[], help=f"{only}; may be given again")
    parser.add_argument("--out", type=Path, default=out)
    parser.add_argument("--workers", type=int)
    return parser


@dataclass
class Matrix:
    """What `make bench` asks of a matrix of campaigns: ``sample``, and ``main`` with its ``figures`` afterwards."""

    analyse: Callable[[Any], dict[str, Any]]
    sampled: Callable[[], Sequence[Any]]
    """The cases of a sample."""
    wanted: Callable[[], Sequence[Any]]
    """Those that `make bench` has time for."""
    out: Path
    document: Callable[[Sequence[Mapping[str, Any]]], str]
    figures_of: Callable[[Sequence[Mapping[str, Any]]], list[Figure]]
    _results: list[dict[str, Any]] = field(default_factory=list)

    def sample(self) -> list[Figure]:
        """The figures of a sample."""
        with ProcessPoolExecutor() as pool:
            return self.figures_of(list(pool.map(self.analyse, self.sampled())))

    def main(self) -> str:
        """Run what is missing; the report, in Markdown."""
        self._results = collect(self.analyse, self.wanted(), self.out)
        return self.document(self._results)

    def figures(self) -> list[Figure]:
        """Those of the last ``main``."""
        return self.figures_of(self._results)
