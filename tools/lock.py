"""``make lock``: pin every wheel that requirements.in resolves to.

Not ``pip freeze``: the ROS wheels contain metadata of packages that are in no registry under those names.
"""

import json
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def main() -> int:
    """Resolve without installing and write requirements.lock."""
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--dry-run", "--ignore-installed", "--report", "-"]
    found = subprocess.run(
        [*command, "-r", str(ROOT / "requirements.in")], stdout=subprocess.PIPE, text=True, check=True
    )
    pins = sorted(
        f"{one['metadata']['name']}=={one['metadata']['version']}" for one in json.loads(found.stdout)["install"]
    )
    (ROOT / "requirements.lock").write_text("\n".join(pins) + "\n", encoding="utf-8")
    print(f"requirements.lock: {len(pins)} wheels")
    return 0


if __name__ == "__main__":
    sys.exit(main())
