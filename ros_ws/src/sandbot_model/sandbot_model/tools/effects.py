"""effects: print the catalogue of physical effects."""

from collections.abc import Sequence

from sandbot_common import cli
from sandbot_model.tools import arguments


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line."""
    return cli.run(_effects, argv)


def _effects(argv: Sequence[str]) -> None:
    parser = cli.Parser(prog="effects", description=__doc__)
    arguments.add_catalogue(parser)
    parser.add_argument("--json", type=cli.output, metavar="OUT", help="write the catalogue as JSON")
    args = parser.parse_args(argv)
    # Imported now that the options are understood: --help is answered at once.
    from sandbot_model.physics.catalogue import catalogue, describe

    effects = catalogue(args.effects_from, args.effect)
    for effect in effects.values():
        print(f"{effect.identifier}  [{effect.stage}]  {effect.formula}")
        for parameter in effect.parameters:
            span = f"{parameter.low:g} .. {parameter.high:g}, start {parameter.start:g}"
            print(f"    {parameter.name} [{parameter.unit}] {span}: {parameter.doc}")
        print(f"    seen in {effect.seen_in} ({effect.source})")
    if args.json is not None:
        arguments.write_json(args.json, {"schema": "sandbot.effects/1", "effects": describe(effects)})


if __name__ == "__main__":
    raise SystemExit(main())
