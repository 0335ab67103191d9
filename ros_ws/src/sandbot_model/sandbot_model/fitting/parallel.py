"""Fits in parallel, by ``sandbot_common.parallel.Workers``."""

import sys
from collections.abc import Callable
from types import ModuleType

from sandbot_common.parallel import Map as Map
from sandbot_model.physics.catalogue import USER_MODULE

Progress = Callable[[str, int, int], None]
"""Called after each fit with (purpose, fits done, fits in all)."""


def users_modules() -> list[ModuleType]:
    """Modules of users' effects, which a worker process could not import by name."""
    return [module for name, module in sys.modules.items() if name.startswith(USER_MODULE)]
