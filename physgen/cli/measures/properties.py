"""`physgen evaluate properties`."""

from __future__ import annotations

import argparse
from pathlib import Path

from physgen.cli.measures.output import add_output, hand_over
from physgen.cli.output import Bar, print_error, print_problem
from physgen.problems import InputError

ABOUT = "Masses, and orders of friction and elasticity, against what others measured."
EXAMPLE = "properties -o out/properties"


def add(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "table",
        metavar="TABLE",
        nargs="?",
        type=Path,
        help="objects with what is true of them, in YAML; default: 42 of the YCB set, and published comparisons",
    )
    parser.add_argument(
        "--backend", metavar="ROLE=NAME", action="append", default=[], help="what answers: physics=NAME"
    )
    parser.add_argument("--config", metavar="FILE", type=Path, help="instead of every physgen.toml")
    parser.add_argument(
        "--answers",
        metavar="FILE",
        type=Path,
        help="score these answers, JSON as --save-answers writes it; no backend is asked",
    )
    parser.add_argument(
        "--save-answers", metavar="FILE", type=Path, help="write what is answered, as --answers takes it"
    )
    parser.add_argument(
        "--hide-size", action="store_true", help="tell the name of each object alone, not its size"
    )
    add_output(parser)


def run(options: argparse.Namespace) -> int:
    from physgen.evaluate.measure import check_folder
    from physgen.evaluate.objects import SHIPPED, read_answers, read_table, write_answers
    from physgen.evaluate.properties import Asked, ask, findings, plots
    from physgen.registry import Backends, choices, configuration_files, load_plan

    _check_flags(options)
    check_folder(options.output, plots=True)
    if others := set(choices(options.backend)) - {"physics"}:
        role = f'"{", ".join(sorted(others))}"'
        raise InputError.of("--backend", role, "has no part in this", "write physics=NAME")
    table = read_table(options.table or SHIPPED)
    if options.answers:
        answers = read_answers(options.answers, table)
        asked = Asked(str(options.answers), False, False, False)
    else:
        if options.config is None:
            for path in configuration_files():
                print_error(f"{path}: chooses backends where no flag does")
        backends = Backends(load_plan(options.backend, config=options.config).of(("physics",)), print_problem)
        bar = Bar()
        answers = ask(table, backends, not options.hide_size, bar.show)
        bar.clear()
        backends.close()
        photos = all(item.photo is not None for item in table.items)
        asked = Asked(backends.name("physics"), not options.hide_size, photos, True)
        if options.save_answers:
            write_answers(options.save_answers, answers, backends.name("physics"))
    found = findings(table, answers, asked)
    if options.output:
        found = found.with_parts(plots(table, answers), first=False)
    return hand_over(found, options)


def _check_flags(options: argparse.Namespace) -> None:
    """Refuses flags that leave each other without a meaning."""
    if options.answers is None:
        return
    beside = {
        "--backend": options.backend,
        "--save-answers": options.save_answers,
        "--hide-size": options.hide_size,
    }
    for flag, value in beside.items():
        if value:
            fix = f"leave {flag} or --answers out"
            raise InputError.of(flag, "", "has no meaning beside --answers: no backend is asked", fix)
