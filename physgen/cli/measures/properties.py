"""`physgen evaluate properties`."""

from __future__ import annotations

import argparse
from pathlib import Path

from physgen.cli.arguments import Parser
from physgen.cli.measures.output import add_output, hand_over
from physgen.cli.output import Bar
from physgen.problems import InputError

ABOUT = "Masses, and orders of friction and elasticity, against what others measured."
EXAMPLE = "properties -o out/properties"


def add(parser: Parser) -> None:
    about = (
        "objects with what is true of them, in YAML; default: 42 of the YCB set, and published comparisons"
    )
    parser.add_argument("table", metavar="TABLE", nargs="?", type=Path, help=about)
    parser.option("--backend", "ROLE=NAME", str, "what answers: physics=NAME", [], action="append")
    parser.option("--config", "FILE", Path, "read this in place of ~/.config/physgen/physgen.toml")
    parser.flag("--hide-size", "tell the name of each object alone, not its size")
    add_output(parser)


def run(options: argparse.Namespace) -> int:
    from physgen.evaluate.measure import check_folder
    from physgen.evaluate.properties import SHIPPED, Asked, ask, findings, plots, read_table
    from physgen.registry import Backends, choices, load_plan

    check_folder(options.output, plots=True)
    if others := set(choices(options.backend)) - {"physics"}:
        role = f'"{", ".join(sorted(others))}"'
        raise InputError.of("--backend", role, "has no part in this", "write physics=NAME")
    table = read_table(options.table or SHIPPED)
    backends = Backends(load_plan(options.backend, config=options.config).of(("physics",)))
    bar = Bar()
    answers = ask(table, backends, not options.hide_size, bar.show)
    bar.clear()
    backends.close()
    photos = all(item.photo is not None for item in table.items)
    found = findings(table, answers, Asked(backends.name("physics"), not options.hide_size, photos))
    if options.output:
        found = found.with_parts(plots(table, answers), first=False)
    return hand_over(found, options)
