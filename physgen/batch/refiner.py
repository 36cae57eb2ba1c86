"""What a command says of the model that refines -> the plan that it and the files make, in any process."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path

from physgen.configured import plan
from physgen.crew import Plan
from physgen.problems import InputError, Problem
from physgen.whole import stamped


@dataclass(frozen=True)
class Refiner:
    """Whose weights refine, and on what, as the command said it."""

    setting: str = ""
    """`NAME[:WEIGHTS]`."""
    config: Path | None = None
    """In place of the files physgen.toml."""
    device: str | None = None
    planned: Plan | tuple[Problem, ...] | None = field(default=None, compare=False, repr=False)
    """What the files said to the command, or what is wrong with them, for a process that does not read them."""
    said: str = ""
    """The same as text, by which processes know it."""

    def plan(self) -> Plan:
        """With what the files say. Raises InputError."""
        if isinstance(self.planned, Plan):
            return self.planned
        if self.planned is not None:
            raise InputError(self.planned)
        told = plan(config=self.config, device=self.device)
        said = told.choices.get("refine")
        if not self.setting or (
            said is not None and said.name == self.setting
        ):  # a bare name: the file has its weights
            return told
        return plan([f"refine={self.setting}"], config=self.config, device=self.device)

    def settled(self) -> Refiner:
        """The same where files say something else, or nothing; worked out once a process."""
        return _settled(self)

    @property
    def told(self) -> str:
        """Who would refine, as text: where it changes, clips are made again."""
        try:
            told = self.plan()
            who = told.choices.get("refine")
            chosen = None if who is None else (who.name, who.weights, stamped(Path(who.weights)))
            return repr((chosen, told.device, told.dtype, told.options))
        except InputError as error:  # told of where a clip is to be refined
            return str(error)


NOBODY = Refiner()
"""A command that says nothing of it."""


@cache
def _settled(who: Refiner) -> Refiner:
    try:
        planned: Plan | tuple[Problem, ...] = who.plan()
    except InputError as error:
        planned = tuple(error.problems)
    return replace(who, planned=planned, said=repr(planned))
