"""`evaluate fidelity`."""

from __future__ import annotations

import argparse
import sys

from physgen.cli.printing import FAILED, OK, Bar, print_json


def fidelity(options: argparse.Namespace) -> int:
    from physgen.evaluate import fidelity as measure

    bar = Bar()
    if options.output:
        from physgen.evaluate.strips import write_strip

        for truth in measure.truths(options.truth, options.scenes):
            bar.show(f"{truth.name}: strip", 0, 1)
            path = write_strip(truth, options.output)
            bar.clear()
            print(path)
        return OK
    result = measure.evaluate(options.truth, options.scenes, bar.show)
    bar.clear()
    if options.json:
        print_json(result)
    else:
        sys.stdout.write(measure.markdown(result))
    if result["passed"] is None:
        print("no bar: none of these scenes is of the test half", file=sys.stderr)
        return OK if options.scenes else FAILED
    found = f"{result['ahead']:.2f} dB better than the paper's way, relit, over objects and shadows of the test half"
    print(f"{found}; the bar is {measure.BAR:g} dB", file=sys.stderr)
    return OK if result["passed"] else FAILED
