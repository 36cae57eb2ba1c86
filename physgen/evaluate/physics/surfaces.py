"""Rows of belts, static friction, bumpers, and of one-way and group passages."""

from __future__ import annotations

from functools import partial
from math import sqrt

import numpy as np

from physgen.evaluate.physics.scorecard import (
    Case,
    Document,
    Draw,
    Errors,
    Measure,
    Row,
    Run,
    Unit,
)
from physgen.evaluate.physics.staging import GRAVITY, box, circle, scene, segment


def _conveyor_errors(
    run: Run,
    *,
    time: float,
    pull: float,
    speed: float,
    side: float,
    distance: float,
    mass: float,
) -> Errors:
    """Return the errors of the parcel's path and of the belt's work."""
    track = run.track("parcel")
    work = run.trajectory.energy.work
    # Friction accelerates with mu g up to the belt's speed.
    slides = np.minimum(track.times, time)
    exact = pull * slides**2 / 2 + speed * (track.times - slides)
    moved = side * track.displacements[:, 0]
    path_error = float(np.abs(moved - exact).max())
    # The friction mu m g acts on the belt over its path u²/(mu g).
    belt_work = mass * speed**2
    return {
        "way": path_error / distance,
        "work": abs(float(work[-1]) / belt_work - 1),
    }


def _conveyor(draw: Draw) -> list[Case]:
    """Return the case of a conveyor. Errors: largest deviation of the path over the
    pick-up distance u²/(2 mu g), and of the work over m u².

    One half of the work is lost to friction, and one half becomes kinetic energy.
    """
    mu = draw.number(0.15, 0.6)
    mass = draw.mass()
    speed = draw.number(80, 240, 0)
    side = draw.sign()
    begin = 320.0 - side * 240
    objects = {
        "parcel": box((begin, 250), (90, 20), mass=mass, friction=mu, elasticity=0.0)
    }
    belt = segment((20, 260), (620, 260), friction=mu, conveyor=side * speed)
    pull = mu * GRAVITY
    time = speed / (mu * GRAVITY)
    # The way of the parcel until it has the belt's speed.
    distance = speed**2 / (2 * pull)

    measure = partial(
        _conveyor_errors,
        time=time,
        pull=pull,
        speed=speed,
        side=side,
        distance=distance,
        mass=mass,
    )

    # The parcel then rides for a part of the way that remains.
    duration = time + 0.6 * (480 - distance) / speed
    document = scene((640, 320), duration, objects, {"belt": belt})
    return [Case(document, measure)]


BAND_LENGTH = 120.0
"""Length of the relaxed spring, px."""
PULL_TIME = 6
"""Duration of the hand's motion, s; longer than any scene."""


def _stretch_errors(run: Run, *, sticks: float, high: float, low: float) -> Errors:
    """Return the errors of the spring's largest and smallest stretch."""
    block = run.track("block")
    hand = run.track("hand")
    stretch = hand.x - block.x - BAND_LENGTH
    # The spring is relaxed at the start, so that only later minima count.
    later_stretch = stretch[block.times > sticks]
    spread = high - low
    return {
        "most": abs(float(stretch.max()) - high) / spread,
        "least": abs(float(later_stretch.min()) - low) / spread,
    }


def _stick_slip(draw: Draw) -> list[Case]:
    """Return the case of stick-slip motion. Error: deviation of the spring's largest
    and smallest stretch over their difference.

    A block on a spring with an end moving at v sticks up to a stretch of mu_s N/k. It
    then swings about mu_k N/k by R, R² = ((mu_s - mu_k) N/k)² + (v/w)², until its speed
    is 0.
    """
    mass = draw.mass()
    kinetic = draw.number(0.15, 0.3)
    static = kinetic + draw.number(0.12, 0.25)
    pull = draw.number(20, 50, 0)
    rate = 2 * np.pi * draw.number(1.5, 2.5)
    stiffness = mass * rate**2
    # Stretch of the spring by the block's weight: friction is mu times this stretch.
    weight = mass * GRAVITY / stiffness
    # At the end of sticking, the block is at rest and the hand moves with `pull`.
    swing = np.hypot((static - kinetic) * weight, pull / rate)
    high = kinetic * weight + swing
    low = kinetic * weight - swing
    # Static friction holds while the hand stretches the spring.
    sticks = static * weight / pull
    # One period of the spring, and the stretch again at the pull's speed, bound a slip.
    slips = 2 * sqrt(mass / stiffness) * np.pi + (high - low) / pull
    surface = {"friction": kinetic, "static_friction": static, "elasticity": 0.0}
    document = _pulled_block(mass, pull, stiffness, surface, sticks + slips + 0.2)
    measure = partial(_stretch_errors, sticks=sticks, high=high, low=low)
    return [Case(document, measure)]


def _pulled_block(
    mass: float,
    pull: float,
    stiffness: float,
    surface: Document,
    duration: float,
) -> Document:
    """Return the scene of a block on a floor, on a spring with an end moving at `pull`
    px/s.
    """
    start = [80, 200]
    end = [80 + BAND_LENGTH, 200]
    path = [[0, *end], [PULL_TIME, end[0] + PULL_TIME * pull, end[1]]]
    objects = {
        "block": box(start, (40, 30), mass=mass, **surface),
        "hand": circle(end, 6, motion={"path": path}),
    }
    band = {
        "objects": ["block", "hand"],
        "spring": [start, end],
        "stiffness": stiffness,
    }
    # At the engine's resting depth, the block need not settle.
    floor = segment((0, 214.995), (640, 214.995), **surface)
    return scene(
        (640, 280),
        min(duration, PULL_TIME - 0.1),
        objects,
        {"floor": floor},
        joints={"band": band},
    )


def _bumper(draw: Draw) -> list[Case]:
    """Return the case of a bumper. Errors: deviation of the height after a bounce over
    e² h, and of the work over m g h (e² - 1).
    """
    e = draw.number(1.05, 1.6)
    height = draw.number(40, 90, 1)
    mass = draw.mass()
    radius = draw.number(10, 20)
    objects = {
        "ball": circle(
            (160, 300 - radius - height),
            radius,
            mass=mass,
            elasticity=1.0,
            friction=0.0,
        )
    }
    # A pair's elasticity is a geometric mean: e² and 1 give e.
    bumper = segment((60, 300), (260, 300), elasticity=round(e * e, 6), friction=0.0)
    e = sqrt(round(e * e, 6))
    fall = sqrt(2 * height / GRAVITY)

    def measure(run: Run) -> Errors:
        track = run.track("ball")
        work = run.trajectory.energy.work
        late = track.times > fall
        top = 300 - radius - float(track.y[late].min())
        # A bumper that speeds up a ball does work, and the balance must contain it.
        gain = mass * GRAVITY * height * (e * e - 1)
        return {
            "height": abs(top / (e * e * height) - 1),
            "work": abs(float(work[-1]) / gain - 1),
        }

    # The apex comes e fall times after the contact.
    duration = fall * (1 + e) + 0.1
    document = scene((320, 340), duration, objects, {"bumper": bumper})
    return [Case(document, measure)]


def _passing_walls(shelf: tuple[float, float], floor: float) -> dict[str, Document]:
    """Return a one-way shelf, a floor, and a floor of the group `back`."""
    x, y = shelf
    return {
        "shelf": segment((x - 90, y), (x + 90, y), one_way=[0, -1], elasticity=0.0),
        "floor": segment((0, floor), (640, floor)),
        "rear": segment((0, 380), (640, 380), collision_group="back", elasticity=0.0),
    }


def _passing_errors(
    run: Run,
    *,
    lands: float,
    start: float,
    speed: float,
    radius: float,
    shelf: float,
    rise: float,
) -> Errors:
    """Return the errors of the flight and of the final places."""
    climber = run.track("climber")
    ghost = run.track("ghost")
    # Samples beside the landing may lie on either side of it.
    flies = climber.times < lands - 0.01
    times = climber.times[flies]
    exact = start - speed * times + GRAVITY * times**2 / 2
    falls = ghost.times < sqrt(2 * (290 - radius) / GRAVITY) - 0.01
    drop = GRAVITY * ghost.times[falls] ** 2 / 2
    ends = (
        abs(climber.y[-1] - (shelf - radius)) < 0.1,
        abs(ghost.y[-1] - (380 - radius)) < 0.1,
        abs(run.track("block").displacements[-1, 1]) < 0.1,
    )
    climb_error = np.abs(climber.y[flies] - exact).max()
    climb_part = climb_error / (start - shelf + rise)
    fall_part = np.abs(ghost.displacements[falls, 1] - drop).max() / 290
    return {
        "flight": float(max(climb_part, fall_part)),
        "ends": float(not all(ends)),
    }


def _passing(draw: Draw) -> list[Case]:
    """Return the case of one-way shelves and groups. Errors: deviation of the flight
    from y0 - v t + g t²/2 over its height, and wrong final places.

    A ball passes up through a one-way shelf without contact, and lands on it. A ball of
    another group falls through floor and block onto a floor of its group.
    """
    radius = draw.number(8, 20)
    mass = draw.mass()
    rise = draw.number(70, 120, 0)
    side = draw.sign()
    shelf = 200.0
    start = shelf + draw.number(50, 120, 1)
    # The ball rises by `rise` above its place on the shelf.
    speed = sqrt(2 * GRAVITY * (start - shelf + radius + rise))
    x = 320 - side * 160
    objects = {
        "climber": circle(
            (x, start), radius, mass=mass, velocity=[0, -speed], elasticity=0.0
        ),
        "block": box((640 - x, 300), (80, 60), mass=draw.mass()),
        "ghost": circle(
            (640 - x, 90),
            radius,
            elasticity=0.0,
            collision_group="back",
            collides_with=["back"],
        ),
    }
    walls = _passing_walls((x, shelf), 330)
    # The climb takes v/g; the fall from the apex ends on the shelf.
    lands = speed / GRAVITY + sqrt(2 * rise / GRAVITY)

    measure = partial(
        _passing_errors,
        lands=lands,
        start=start,
        speed=speed,
        radius=radius,
        shelf=shelf,
        rise=rise,
    )

    document = scene((640, 400), lands + 0.4, objects, walls)
    return [Case(document, measure)]


ROWS = (
    Row(
        47, "conveyor", "block that a belt picks up", "u²/(2 mu g) to the belt's speed; work m u²",
        "mu 0.15 to 0.6, belts at 80 to 240 px/s to either side, 20 to 500 g",
        "Largest deviation of the way over the pick-up distance, and the belt's work over its closed form: as for "
        "sliding, 0.3 %.",
        (Measure("way", 3e-3), Measure("work", 3e-3)), _conveyor,
    ),
    Row(
        48, "stick-slip", "block on a spring that sticks and slips", "mu_k N/k ± R, R² = ((mu_s - mu_k) N/k)² + (v/w)²",
        "mu_k 0.15 to 0.3, mu_s 0.12 to 0.25 above it, 1.5 to 2.5 swings a second, pulled at 20 to 50 px/s",
        "Largest and least stretch of the spring over their difference. Friction changes at a step: 1 %.",
        (Measure("most", 1e-2), Measure("least", 1e-2)), _stick_slip,
    ),
    Row(
        49, "bumper", "bumper of elasticity above 1", "height e² h; work m g h (e² - 1)",
        "e 1.05 to 1.6, heights of 40 to 90 px, 20 to 500 g",
        "Height after the bounce and the work over their closed forms: 1 %, as for bounces.",
        (Measure("height", 1e-2), Measure("work", 1e-2)), _bumper,
    ),
    Row(
        50, "passing", "one-way shelf and collision groups", "free flight through what lets it pass",
        "balls of 8 to 20 px that rise 70 to 120 px above a shelf; one of a group behind floor and block",
        "Largest deviation from free flight over its height, 0.1 %, and whether all land where they must.",
        (Measure("flight", 1e-3), Measure("ends", 0, Unit.SWITCH)), _passing,
    ),
)  # fmt: skip
