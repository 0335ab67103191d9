"""Cache of the rows measured from bags, in ``.table-cache.json`` next to them, so that no bag is read twice.

Rows are keyed by a hash of the bag's content, so that copied or renamed bags are recognised; the hash itself is cached
by the names, sizes and times of the bag's files, so that untouched bags are not hashed again. Settings shared by bags
(robot, cameras) are stored once.
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
RECIPE = "13"
"""Version of the way rows are measured; increment it on a change, to discard rows of earlier versions."""

Measured = tuple[Row, Setting]


@dataclass
class Cache:
    """Rows and settings by content hash, and the content hash of each bag by the state of its files."""

    folder: Path
    measured: dict[str, Measured] = field(default_factory=dict)
    seen: dict[str, tuple[str, str]] = field(default_factory=dict)
    """By bag name: the state of its files (``file_state``) and its content hash."""
    tabled: set[str] = field(default_factory=set)
    """Content hashes of the bags when trials.csv was written; empty if unknown."""
    written: str = ""
    """The hash of trials.csv as last written, if it contained no manual edits."""
    changed: bool = False
    """Whether files of a bag are not as they were when the cache was written."""

    @classmethod
    def read(cls, folder: Path) -> "Cache":
        """The cache of a folder; empty if it can't be read."""
        try:
            content = files.read_json(folder / CACHE)
            own = cls(folder, tabled=set(content.get("tabled", ())), written=str(content.get("written", "")))
            if content["recipe"] != RECIPE:
                return own
            settings = [_setting(entry) for entry in content["settings"]]
            rows = zip(*(_numbers(content["rows"][name]) for name in COLUMNS), strict=True)
            which = [settings[index] for index in content["setting"]]
            pairs = [(Row(*row), setting) for row, setting in zip(rows, which, strict=True)]
            seen = {name: (str(state), str(key)) for name, (state, key) in content["seen"].items()}
            return dataclasses.replace(own, measured=dict(zip(content["hash"], pairs, strict=True)), seen=seen)
        except (InputError, TypeError, ValueError, AttributeError, LookupError):
            return cls(folder)

    def key(self, bag: Path) -> str:
        """The hash of a bag's content, computed only if its files have changed; empty if they can't be read."""
        before, key = self.seen.get(bag.name, ("", ""))
        try:
            state = file_state(bag)
            if state != before:
                key = content_hash(bag)
                self.seen[bag.name], self.changed = (state, key), True
        except OSError:  # no permission, or a disk that is gone
            self.seen[bag.name], self.changed = ("", ""), True
            return ""
        return key

    def trial_id(self, bag: Path) -> str:
        """The trial id in a bag, if cached; else the bag's name."""
        found = self.measured.get(self.seen.get(bag.name, ("", ""))[1])
        return found[0].trial_id if found else bag.name

    def get(self, key: str, bag: Path) -> Measured | None:
        """The cached row and setting of a bag."""
        found = self.measured.get(key)
        return found and (found[0], dataclasses.replace(found[1], where=str(bag)))

    def write(self, keys: Mapping[Path, str]) -> None:
        """Write the cache, with these bags only."""
        kept = [key for key in dict.fromkeys(keys.values()) if key in self.measured]
        shared: dict[Setting, int] = {}
        which = [shared.setdefault(_without_place(self.measured[key][1]), len(shared)) for key in kept]
        content = {
            "recipe": RECIPE,
            "hash": kept,
            "rows": {name: [_jsonable(getattr(self.measured[key][0], name)) for key in kept] for name in COLUMNS},
            "setting": which,
            "settings": [_plain(setting) for setting in shared],
            "seen": {bag.name: self.seen[bag.name] for bag in keys},
            "tabled": sorted(self.tabled),
            "written": self.written,
        }
        # A read-only campaign is read all the same, only without a cache.
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


def file_state(bag: Path) -> str:
    """Hash of the names, sizes and times of a bag's files; includes ctime, which users can't set. Empty without a bag.

    A trial that is run again has the name of the bag before it, but not this.
    """
    try:
        stats = [(file.name, file.stat()) for file in files_of(bag)]
    except FileNotFoundError:
        return ""
    text = "\0".join(f"{name}\0{stat.st_size}\0{stat.st_mtime_ns}\0{stat.st_ctime_ns}" for name, stat in stats)
    return hashlib.blake2b(text.encode(), digest_size=16).hexdigest()


def files_of(bag: Path) -> Sequence[Path]:
    """The files of a bag, by name."""
    return sorted(path for path in bag.iterdir() if path.is_file()) if bag.is_dir() else [bag]


def _without_place(setting: Setting) -> Setting:
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
