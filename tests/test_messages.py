"""Templates of messages: their sentences, their fields at each call, and the tests that raise them."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import physgen
from physgen.messages import Message, Note

PACKAGE = Path(physgen.__file__).parent
METHODS = {"refusal", "problem", "warning", "error", "error_at", "impossible", "text"}


def calls() -> Iterator[tuple[Message | Note, ast.Call, str]]:
    """Each call of a template by its name, with its place in the code."""
    for path in sorted(PACKAGE.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not isinstance(node, ast.Call):
                continue
            name = re.fullmatch(r"(Message|Note)\.(\w+)\.(\w+)", ast.unparse(node.func))
            if name is not None and name[3] in METHODS:
                place = f"{path.relative_to(PACKAGE)}:{node.lineno}"
                kind = Message if name[1] == "Message" else Note
                yield kind[name[2]], node, place


def test_calls_give_the_fields_of_their_template() -> None:
    wrong = []
    for message, call, place in calls():
        names = {keyword.arg for keyword in call.keywords}
        if None not in names and names != message.fields:
            wrong.append((place, message.name, names, message.fields))
    assert not wrong


def test_every_template_is_used() -> None:
    text = "\n".join(
        path.read_text(encoding="utf-8")
        for path in PACKAGE.rglob("*.py")
        if path.name != "messages.py"
    )
    names = set(re.findall(r"\b(?:Message|Note)\.[A-Z]\w+", text))
    assert {str(one) for one in (*Message, *Note)} - names == set()


def test_sentences_are_verb_phrases_without_a_full_stop() -> None:
    for message in Message:
        for sentence in message.value:
            assert sentence == sentence.strip()
            assert not sentence.endswith(".") or sentence.endswith("...")
            assert "  " not in sentence
            # words of the project's own language
            assert not re.search(
                r"\b(is no|holds no|went|take it out|lacks)\b", sentence
            )
