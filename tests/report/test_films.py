"""Which film a report shows."""

from __future__ import annotations

from physgen.report.films import linked_film


def test_the_best_film_is_shown() -> None:
    assert linked_film(["video.gif", "frames", "video.mp4"]).source == "video.mp4"
    assert linked_film(["frames", "video.gif"]).name == "video.gif"
    assert linked_film(["frames"]).source == "frames/00000.png"
