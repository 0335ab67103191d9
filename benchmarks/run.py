"""``make bench [ONLY=name]``: run every benchmark and write benchmarks/<name>.md. Never part of the tests.

A benchmark is a module here with ``main() -> str`` that returns a section of Markdown: medians of several runs,
peers measured in the same run, ratios rather than bare times.
"""

import importlib
import pkgutil
import platform
import sys
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent


def main(only: list[str]) -> int:
    """Run the named benchmarks, or all; 2 where a name is unknown."""
    sys.path.insert(0, str(HERE))
    names = sorted(m.name for m in pkgutil.iter_modules([str(HERE)]) if m.name != "run" and not m.name.startswith("_"))
    if unknown := set(only) - set(names):
        print(f"bench: no benchmark {', '.join(sorted(unknown))}; there are {', '.join(names)}", file=sys.stderr)
        return 2
    for name in only or names:
        start = time.perf_counter()
        print(f"bench: {name} ...", flush=True)
        section = importlib.import_module(name).main()
        machine = f"Python {platform.python_version()}, {platform.machine()}; took {time.perf_counter() - start:.0f} s."
        (HERE / f"{name}.md").write_text(f"{section.rstrip()}\n\n{machine}\n", encoding="utf-8")
        print(section, flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
