"""``python tools/trackway_command VERB …``."""

import signal
import sys
from pathlib import Path

# Until somebody is there to answer it: Ctrl-C in the middle of an import would be a traceback.
signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
sys.path[0] = str(Path(__file__).resolve().parents[1])

from trackway_command.main import main  # noqa: E402

raise SystemExit(main())
