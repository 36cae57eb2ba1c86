"""A sweep's gallery is sorted by what became of its clips, as the table beside them has it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from browser import opened
from exhibits import exhibit, failure

from physgen.report.clips import clips_in
from physgen.report.gallery import sweep_outcomes, write_gallery

ROWS = (("slow", "812.44444", "1.25"), ("fast", "2100", ""), ("still", "0", "0.1"))
SORTED = "() => [...document.querySelectorAll('[data-part=cards] > .clip .open')].map(e => e.textContent)"
SAID = "() => [...document.querySelectorAll('.ranked')].map(e => e.textContent)"


def table(home: Path) -> None:
    lines = [
        "number,name,variant,folder,a.b,state,error,peak_speed,objects.ball.rest_time,touches,video,manifest"
    ]
    lines += [
        f"{k},{name},,{name},7,done,,{speed},{rest},2,{name}/video.mp4,{name}/manifest.json"
        for k, (name, speed, rest) in enumerate(ROWS)
    ]
    lines += ["3,lost,,,7,failed,no such thing,,,,,"]
    (home / "sweep.csv").write_text("\n".join(lines) + "\n")
    (home / "sweep.json").write_text(json.dumps({"sweep": 1, "units": {"peak_speed": "px/s"}}))


def made(home: Path) -> Path:
    for k, (name, *_) in enumerate(ROWS):
        exhibit(home / name, seed=k)
    failure(home, "lost", "no such thing")
    exhibit(home / "others" / "ordinary", seed=4)
    table(home)
    return home


def test_outcomes_are_those_of_the_table_that_differ(tmp_path: Path) -> None:
    clips = clips_in([made(tmp_path)])
    found = {end.column: end for end in sweep_outcomes(clips)}
    assert list(found) == ["peak_speed", "objects.ball.rest_time"]  # touches are 2 in all
    assert (found["objects.ball.rest_time"].name, found["peak_speed"].unit) == ("ball rest time", "px/s")
    told = {clip.name: value for clip, value in zip(clips, found["peak_speed"].values, strict=True)}
    assert told == {"slow": 812.44444, "fast": 2100, "still": 0, "lost": None, "ordinary": None}


def test_a_table_that_is_none_says_nothing(tmp_path: Path) -> None:
    made(tmp_path)
    for text in ("", "a,b\n1,2\n", (tmp_path / "sweep.csv").read_text().replace("2100", "quick"), "\0" * 99):
        (tmp_path / "sweep.csv").write_text(text)
        assert sweep_outcomes(clips_in([tmp_path])) == []


def test_cards_are_sorted_by_an_outcome_and_say_it(browser: Any, tmp_path: Path) -> None:
    write_gallery([made(tmp_path)], tmp_path / "index.html")
    with opened(browser, tmp_path / "index.html", ready=False) as seen:
        sort = seen.page.locator("[data-part=sort]")
        sort.select_option(label="peak speed")
        seen.drawn()
        assert seen.page.evaluate(SORTED)[:3] == ["still", "slow", "fast"]
        assert seen.page.evaluate(SAID)[:3] == [
            "peak speed 0 px/s",
            "peak speed 812.4 px/s",
            "peak speed 2100 px/s",
        ]
        assert set(seen.page.evaluate(SAID)[3:]) == {"peak speed no value"}
        sort.select_option(label="ball rest time")
        seen.page.locator("[data-part=desc]").click()
        seen.drawn()
        assert seen.page.evaluate(SORTED)[:2] == ["slow", "still"]
        assert "sort=%3Dobjects.ball.rest_time" in seen.page.url
        sort.select_option(label="name")
        seen.drawn()
        assert seen.page.evaluate(SAID) == []
        assert seen.errors == []
