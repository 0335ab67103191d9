"""Arguments that compare, discover and effects share."""

import json
from pathlib import Path
from typing import Any

from sandbot_common.cli import Parser
from sandbot_common.errors import InputError
from sandbot_common.files import write_text
from sandbot_model.walking import BASES


def add_catalogue(parser: Parser) -> None:
    """Where effects come from beside the catalogue."""
    parser.add_argument(
        "--effects-from",
        type=Path,
        action="append",
        default=[],
        metavar="FILE.py",
        help="your own effects: subclasses of sandbot_model.chain.Effect",
    )
    parser.add_argument(
        "--effect",
        action="append",
        default=[],
        metavar="'NAME: STAGE: FORMULA; a [unit] in LOW..HIGH'",
        help="an effect as a formula, e.g. 'boost: strength: k*(1 + a*(phi - 0.6)); a [1] in -5..5'",
    )


def add_data(parser: Parser) -> None:
    """What to read and what to write."""
    parser.add_argument("data", type=Path, nargs="+", metavar="DATA", help="a campaign folder, bags, or a trials CSV")
    parser.add_argument("--model", choices=tuple(BASES), default="simple", help="base model (default: simple)")
    parser.add_argument("--json", type=Path, metavar="OUT", help="write the result as JSON")
    parser.add_argument("--html", type=Path, metavar="OUT", help="write a self-contained report")
    parser.add_argument("--title", default=None, help="title of the report (default: the name of DATA)")


def write_json(path: Path, content: dict[str, Any]) -> None:
    """Write JSON, whole or not at all."""
    try:
        write_text(path, json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n")
    except OSError as error:
        raise InputError(f"{path}: can't be written: {error.strerror}") from None
