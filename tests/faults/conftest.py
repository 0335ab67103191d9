import sys
import warnings
from pathlib import Path

# The bags the unit tests use.
sys.path.insert(0, str(Path(__file__).parents[1] / "unit" / "sandbot_record"))

with warnings.catch_warnings():
    # The first message serialised imports lark, which imports a deprecated module.
    warnings.simplefilter("ignore", DeprecationWarning)
    import rosidl_generator_py  # noqa: F401
