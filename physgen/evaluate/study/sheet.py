"""A study -> its page: one HTML file that asks nothing of any network, and says nowhere which clip is whose."""

from __future__ import annotations

import base64
from collections.abc import Callable
from pathlib import Path

from physgen.evaluate.study.making import Study
from physgen.evaluate.study.questions import QUESTIONS, SCALE
from physgen.evaluate.study.told import ANSWERS, VERSION
from physgen.files import resource, write_with_backup
from physgen.problems import InputError
from physgen.report.html import script_json, template

TITLE = "How real are these videos?"
PARTS = ("keep", "order", "save", "clip", "page")
"""Of the script, in the order in which they build on each other."""


def key_beside(page: Path) -> Path:
    """Where a page's key goes."""
    return page.with_name(f"{page.stem}.key.json")


def check_page(page: Path) -> None:
    """Raises InputError where no page can go, before anything is made."""
    if page.is_dir() or page.suffix.lower() not in (".html", ".htm"):
        raise InputError.of("-o", f'"{page}"', "is no name for a page", "end it in .html, e.g. -o study.html")


def write_study(
    study: Study, page: Path, title: str = TITLE, keep: Callable[[Path], None] = lambda kept: None
) -> Path:
    """The page and its key, whose path is returned. Those of another study there are kept as NAME~, and told of."""
    check_page(page)
    page.parent.mkdir(parents=True, exist_ok=True)
    key = key_beside(page)
    write_with_backup(key, study.key.text().encode(), keep)  # first: no page without its key
    write_with_backup(page, html(study, title).encode(), keep)
    return key


def html(study: Study, title: str = TITLE) -> str:
    """Scenes are numbers, in the order in which clips come: names would tell what is to be seen."""
    scenes = list(dict.fromkeys(clip.scene for clip in study.clips))
    data = {
        "form": ANSWERS,
        "version": VERSION,
        "study": study.name,
        "questions": [{"key": q.key, "claim": q.claim} for q in QUESTIONS],
        "clips": [
            {"name": clip.name, "scene": scenes.index(clip.scene), "size": clip.size} for clip in study.clips
        ],
        "scenes": [
            {"photo": study.photos.get(scene, ""), "words": study.words.get(scene, "")} for scene in scenes
        ],
    }
    parts = [resource("templates", "study", f"{part}.js").read_text(encoding="utf-8") for part in PARTS]
    page: str = template("study.html.j2").render(
        title=title,
        count=len(study.clips),
        questions=QUESTIONS,
        scale=SCALE,
        words=bool(study.words),
        photos=bool(study.photos),
        films=[(clip.name, base64.b64encode(clip.film).decode("ascii")) for clip in study.clips],
        data=script_json(data),
        script='(() => {\n"use strict";\n' + "\n".join(parts) + "})();",
    )
    return page
