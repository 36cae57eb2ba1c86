"""What raters are asked, word by word: two five-point questions, as in the paper's human evaluation."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Question:
    """One statement that a rater agrees with, or not."""

    key: str
    name: str
    """As the paper has it; raters do not see it."""
    claim: str
    hint: str
    asked: str = ""
    """Added to the hint where raters are told what was asked of the methods."""


QUESTIONS = (
    Question(
        "physical",
        "physical-realism",
        "The video is physically realistic.",
        "Things move, fall and meet as they would in reality.",
        "What happens is what was asked for.",
    ),
    Question(
        "photo",
        "photo-realism",
        "The video is photo-realistic.",
        "Every picture of it could have been taken by a camera.",
    ),
)
"""The paper, Human evaluation: "whether the content of the generated video is realistic in its dynamics and object
interactions and accurately reflects the instructed movements"."""
SCALE = ("strongly disagree", "disagree", "neither", "agree", "strongly agree")
"""Of scores 1 to 5; the paper names the ends, and calls 4 "Agree"."""
PAPER = (
    ("SEINE", 1.39, 1.86),
    ("DynamiCrafter", 1.68, 1.81),
    ("I2VGen-XL", 2.11, 2.25),
    ("PhysGen", 4.14, 3.86),
)
"""Its means of physical-realism and photo-realism: 14 participants, 15 videos a method."""
