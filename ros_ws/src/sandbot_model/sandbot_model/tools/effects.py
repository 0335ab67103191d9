"""effects: print the catalogue of physical effects, or cards of the ones named."""

import textwrap
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from sandbot_common import cli
from sandbot_common.errors import InputError
from sandbot_common.files import write_json
from sandbot_common.suggest import did_you_mean
from sandbot_model.tools import arguments

if TYPE_CHECKING:
    from sandbot_model.physics.effect import Effect


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line."""
    return cli.run(_effects, argv)


def _effects(argv: Sequence[str]) -> None:
    parser = cli.Parser(prog="effects", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help="effects to print a card of (default: list all)")
    arguments.add_catalogue(parser)
    parser.add_argument("--json", type=cli.output, metavar="OUT", help="write the catalogue as JSON")
    parser.add_argument("--quantities", action="store_true", help="print the symbols that a formula may contain")
    args = parser.parse_args(argv)
    if args.quantities:
        if args.names or args.effect or args.effects_from or args.json is not None:
            raise InputError("--quantities: prints the symbols and nothing else; leave out all other arguments")
        print(_quantities())
        return
    # Imported only once the options are parsed, so that --help is answered at once.
    from sandbot_model.physics.catalogue import catalogue, describe

    effects = catalogue(args.effects_from, args.effect)
    for name in args.names:
        if name not in effects:
            raise InputError(f"effect {name!r} is not in the catalogue{did_you_mean(name, effects)}")
    if args.names:
        from sandbot_model.tools.card import card

        print("\n\n".join(card(effects[name], effects) for name in args.names))
        effects = {name: effects[name] for name in args.names}
    else:
        _list(effects)
    if args.json is not None:
        write_json(args.json, {"schema": "sandbot.effects/1", "effects": describe(effects)})


def _list(effects: "Mapping[str, Effect]") -> None:
    for effect in effects.values():
        print(f"{effect.identifier}  [{effect.stage}]  {effect.formula}")
        for parameter in effect.parameters:
            span = f"{parameter.low:g} .. {parameter.high:g}, start {parameter.start:g}"
            print(f"    {parameter.name} [{parameter.unit}] {span}: {parameter.doc}")
        print(f"    seen in {effect.seen_in} ({effect.source})")


def _quantities() -> str:
    from sandbot_model.fitting.text import table, wrapped
    from sandbot_model.physics.formula import FUNCTIONS, SHORT
    from sandbot_model.physics.symbols import listed

    rows = [["symbol", "unit", "from stage", "meaning"]]
    rows += [[", ".join(symbol.spellings), symbol.unit, symbol.stage, symbol.doc] for symbol in listed()]
    functions = sorted({*FUNCTIONS, *SHORT})
    return "\n".join(
        [
            table(wrapped(rows), left=(0, 1, 2, 3)),
            "",
            "A formula reads what exists at its stage, and sets it: X -> ..., X *= ..., +=.",
            *textwrap.wrap(f"Functions: {', '.join(functions)}; pi.", 80),
        ]
    )


if __name__ == "__main__":
    raise SystemExit(main())
