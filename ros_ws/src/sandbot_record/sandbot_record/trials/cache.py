"""What bags gave, kept beside them in ``.table-cache.json``: no bag is read twice.

By the hash of its content, so that a bag that was copied or renamed is known; and by the names, sizes and times of its
files, so that one nobody has touched is not even hashed. Columns, and what bags share (robot, cameras) once.
"""

import contextlib
import dataclasses
import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from sandbot_common import files
from sandbot_common.accuracy import Accuracy
from sandbot_common.errors import InputError
from sandbot_common.robot import robot_from_mapping
from sandbot_record.trials.setting import Setting
from sandbot_record.trials.table import COLUMNS, Row

CACHE = ".table-cache.json"
RECIPE = "11"
"""Raise it when rows are made otherwise: none of an earlier one is taken."""

Measured = tuple[Row, Setting]


@dataclass
class Cache:
    """Rows and settings by content hash, and the hash of each bag by what its files looked like."""

    folder: Path
    measured: dict[str, Measured] = field(default_factory=dict)
    seen: dict[str, tuple[str, str]] = field(default_factory=dict)
    """By a bag's name: what its files looked like, and its hash."""
    tabled: set[str] = field(default_factory=set)
    """Hashes of the bags as they were when trials.csv was written; none where that is not known."""
    written: str = ""
    """The hash of trials.csv as it was written, if nothing in it was a person's."""

    @classmethod
    def read(cls, folder: Path) -> "Cache":
        """The cache of a folder; one that can't be read is none."""
        try:
            content = files.read_json(folder / CACHE)
            own = cls(folder, tabled=set(content.get("tabled", ())), written=str(content.get("written", "")))
            if content["recipe"] != RECIPE:
                return own
            settings = [_setting(one) for one in content["settings"]]
            rows = zip(*(_numbers(content["rows"][name]) for name in COLUMNS), strict=True)
            which = [settings[index] for index in content["setting"]]
            pairs = [(Row(*row), setting) for row, setting in zip(rows, which, strict=True)]
            seen = {name: (str(looks), str(key)) for name, (looks, key) in content["seen"].items()}
            return dataclasses.replace(own, measured=dict(zip(content["hash"], pairs, strict=True)), seen=seen)
        except (InputError, TypeError, ValueError, AttributeError, LookupError):
            return cls(folder)

    def key(self, bag: Path) -> str:
        """The hash of a bag's content; it is read only where its files look otherwise than before."""
        looks = _looks(bag)
        before, key = self.seen.get(bag.name, ("", ""))
        if looks != before:
            key = content_hash(bag)
            self.seen[bag.name] = (looks, key)
        return key

    def trial_id(self, bag: Path) -> str:
        """What a bag calls its trial, if that is known; else its own name."""
        found = self.measured.get(self.seen.get(bag.name, ("", ""))[1])
        return found[0].trial_id if found else bag.name

    def get(self, key: str, bag: Path) -> Measured | None:
        """What a bag gave."""
        found = self.measured.get(key)
        return found and (found[0], dataclasses.replace(found[1], where=str(bag)))

    def write(self, keys: Mapping[Path, str]) -> None:
        """Keep what is known of these bags, and of no others."""
        kept = [key for key in dict.fromkeys(keys.values()) if key in self.measured]
        shared: dict[Setting, int] = {}
        which = [shared.setdefault(_nowhere(self.measured[key][1]), len(shared)) for key in kept]
        content = {
            "recipe": RECIPE,
            "hash": kept,
            "rows": {name: [_jsonable(getattr(self.measured[key][0], name)) for key in kept] for name in COLUMNS},
            "setting": which,
            "settings": [_plain(one) for one in shared],
            "seen": {bag.name: self.seen[bag.name] for bag in keys},
            "tabled": sorted(self.tabled),
            "written": self.written,
        }
        # A read-only campaign is read all the same, only not as fast the next time.
        with contextlib.suppress(OSError):
            files.write_text(self.folder / CACHE, json.dumps(content, allow_nan=False))


def content_hash(bag: Path) -> str:
    """Hash of the bag's files."""
    digest = hashlib.blake2b(digest_size=16)
    for file in files_of(bag):
        digest.update(f"\0{file.name}\0{file.stat().st_size}\0".encode())
        with file.open("rb") as stream:
            while block := stream.read(1 << 20):
                digest.update(block)
    return digest.hexdigest()


def _looks(bag: Path) -> str:
    """Names, sizes and times of a bag's files; the time of the last change of any kind can't be set by anybody."""
    stats = [(file.name, file.stat()) for file in files_of(bag)]
    told = "\0".join(f"{name}\0{one.st_size}\0{one.st_mtime_ns}\0{one.st_ctime_ns}" for name, one in stats)
    return hashlib.blake2b(told.encode(), digest_size=16).hexdigest()


def files_of(bag: Path) -> Sequence[Path]:
    """The files of a bag, by name."""
    return sorted(path for path in bag.iterdir() if path.is_file()) if bag.is_dir() else [bag]


def _nowhere(setting: Setting) -> Setting:
    rate = None if math.isnan(setting.frame_rate_hz) else setting.frame_rate_hz  # a NaN is not equal to itself
    return dataclasses.replace(setting, where="", frame_rate_hz=rate)  # type: ignore[arg-type]


def _plain(setting: Setting) -> dict[str, Any]:
    return {name: value for name, value in dataclasses.asdict(setting).items() if name != "where"}


def _setting(content: Mapping[str, Any]) -> Setting:
    robot, rate, accuracy = content["robot"], content["frame_rate_hz"], content["accuracy"]
    return Setting(
        "",
        None if robot is None else robot_from_mapping(robot, CACHE),
        math.nan if rate is None else float(rate),
        None if accuracy is None else Accuracy(**accuracy),
    )


def _numbers(column: Sequence[Any]) -> list[Any]:
    return [math.nan if value is None else value for value in column]


def _jsonable(value: Any) -> Any:
    return None if isinstance(value, float) and math.isnan(value) else value
