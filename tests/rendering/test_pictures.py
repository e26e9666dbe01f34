"""A picture shows the state that it is drawn from."""

from math import cos, pi, sin

import numpy as np
import pytest

from mm_gym.lanes import layout
from mm_gym.rendering import history as rows
from mm_gym.rendering import look
from mm_gym.rendering import mechanism as place
from mm_gym.rendering.mechanism import recent_impulse
from mm_gym.scene import Scene

NEAR = 24  # difference of a colour's components that smooth edges may make

FORCE = {"force": {"limit": 4.0}}


def where(pixels, colour):
    """Return the places (y, x) of a colour."""
    return np.nonzero(np.abs(pixels.astype(int) - colour).max(axis=2) <= NEAR)


def arrow(pixels, colour):
    """Return the extent of a colour [units] within the carriage's body."""
    y, x = where(pixels, colour)
    top, bottom = look.PIXELS * place.TOP, look.PIXELS * place.BOTTOM
    x = x[(top < y) & (y < bottom)] / look.PIXELS
    return (x.min(), x.max()) if x.size else None


def colour_at(pixels, x, y):
    return pixels[round(look.PIXELS * y), round(look.PIXELS * x)].astype(int)


@pytest.mark.parametrize(
    "changed",
    [{"x1": 1e-3}, {"x2": 5e-3}, {"force": 2.0}, {"stretch": 2.9}, {"x1": -8e-3, "x2": -8e-3}],
)
def test_pictures_differ_when_the_state_differs(studio, changed):
    rest = {"x1": 0.0, "x2": 0.0, "force": 0.0, "stretch": 1.0}
    one, other = (studio("Hybrid").put(**rest | more).pixels for more in ({}, changed))
    assert (one != other).any()


def test_pictures_are_equal_when_the_state_is(studio):
    one, other = (studio("Hybrid").put(x1=1e-3).step(0.5, -0.5).pixels for _ in range(2))
    np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("offset", [-0.02, -0.004, 0.0, 0.007, 0.02])
def test_sphere_is_at_its_offset_and_has_turned_by_offset_over_radius(studio, offset):
    shown = studio("CarriageForce").put(x1=0.0, x2=offset)
    pixels, scale = shown.pixels, shown.view.scale
    radius = 0.6 * place.RADIUS
    x, y = place.REST + offset * scale, place.TOP - place.FILM - place.RADIUS
    angle = offset * scale / place.RADIUS  # clockwise, as y points downwards
    for quarter, colour in enumerate([look.SHADE, look.SHINE] * 2):
        turn = angle + 0.5 * pi * (quarter + 0.5)
        seen = colour_at(pixels, x + radius * cos(turn), y + radius * sin(turn))
        assert np.abs(seen - colour).max() <= NEAR


def test_carriage_is_at_its_displacement(studio):
    middles = []
    for x1 in (-0.01, 0.0, 0.01):
        shown = studio("CarriageForce").put(x1=x1, x2=x1)
        y, x = where(shown.pixels, look.FILM)
        x = x[np.abs(y / look.PIXELS - place.TOP) < 5.0]
        middles.append(0.5 * (x.min() + x.max()) / look.PIXELS)
        moved = x1 * shown.view.scale
        # A pixel is 1.25 units; both ends and the place itself are rounded to pixels.
        assert middles[-1] == pytest.approx(place.REST + moved, abs=2.5)
    assert middles[0] < middles[1] < middles[2]


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_arrow_of_the_control_points_along_the_force(studio, sign):
    pixels = studio("CarriageForce").put(x1=0.0, x2=0.0, force=3.0 * sign).pixels
    left, right = arrow(pixels, look.CONTROL)
    ends = (left, right) if sign > 0.0 else (right, left)
    assert ends[0] == pytest.approx(place.REST, abs=2.5)
    # 128 units for 4 N, whose tip is too thin to be seen in its own colour.
    assert sign * (ends[1] - place.REST) == pytest.approx(96.0, abs=4.0)


@pytest.mark.parametrize("phase", [0.5 * pi, -0.5 * pi])
def test_arrow_of_the_disturbance_points_along_the_force(studio, phase):
    harmonic = {"kind": "harmonic", "amplitude": 1.0, "frequency": 50.0, "phase": phase}
    shown = studio(Scene(excitation=[harmonic], actuation=FORCE)).put(x1=0.0, x2=0.0)
    left, right = arrow(shown.pixels, look.DISTURBANCE)
    assert (right > place.REST + 20.0) == (phase > 0.0)
    assert (left < place.REST - 20.0) == (phase < 0.0)
    assert shown.past.now(rows.PUSH) == pytest.approx(sin(phase), abs=1e-12)


@pytest.mark.parametrize("size", [-0.04, 0.03])
def test_impulse_is_found_from_the_jump_of_the_velocity(studio, size):
    impulse = {"kind": "impulse", "size": size, "time": 0.02}
    shown = studio("PreStretchShock", excitation=[impulse]).put()
    for _ in range(4):
        shown.step(0.0)
        assert arrow(shown.pixels, look.DISTURBANCE) is None
    left, right = arrow(shown.step(0.0).pixels, look.DISTURBANCE)
    # The trapezoidal rule over 5 ms, a twentieth of a period, errs by (2 pi / 20)^2 / 12 < 1 %.
    assert recent_impulse(shown.subject, shown.past) == pytest.approx(size, rel=0.02)
    middle = place.REST + shown.past.now(layout.X1) * shown.view.scale
    assert (right > middle + 60.0) == (size > 0.0)
    assert (left < middle - 60.0) == (size < 0.0)


def test_force_of_zero_has_no_arrow(studio):
    still = studio("CarriageForce").put(x1=0.0, x2=0.0, force=0.0).pixels.astype(int)
    y, x = round(look.PIXELS * 189.0), round(look.PIXELS * place.REST)
    middle = still[y - 3 : y + 4, x - 2 : x + 3]
    assert (np.ptp(middle, axis=2) < NEAR).all()  # the line where arrows begin is grey


def texts_of(shown, monkeypatch):
    """The texts of a picture."""
    texts, canvas = [], shown.picture._canvas
    write = canvas.text

    def noted(text, *others):
        texts.append(text)
        return write(text, *others)

    monkeypatch.setattr(canvas, "text", noted)
    assert shown.pixels.any()
    return texts


@pytest.mark.parametrize(
    ("velocity", "slip", "said"), [(5.0, 0.1, "sticks"), (0.2, 0.1, "sticks"), (0.2, 0.3, "slips")]
)
def test_sphere_sticks_below_the_reference_velocity(studio, monkeypatch, velocity, slip, said):
    start = {"interface.reference_velocity": velocity, "initial": {"sphere_velocity": slip}}
    scene = {"actuation": {"damping": {"of": "carriage"}}, "excitation": [], **start}
    shown = studio("CarriageForceFriction", **scene).put()
    assert shown.plant.support.slips == (said == "slips")
    assert f"the sphere {said}" in texts_of(shown, monkeypatch)


def test_record_of_an_inertial_force_is_expected_to_be_a_force(studio, tmp_path):
    (tmp_path / "ground.txt").write_text("0.0 0.0\n0.5 0.5\n1.0 0.0\n")
    record = {"kind": "record", "file": str(tmp_path / "ground.txt"), "target": "force"}
    record |= {"inertial_mass": -1000.0, "scale_to": {"peak": 2.0}}
    assert studio("CarriageForce", excitation=[record]).subject.disturbance == 2000.0


JUMP = {"kind": "impulse", "target": "ground", "size": -0.0999, "time": 0.02}
PUSH = {"kind": "harmonic", "amplitude": 0.5, "frequency": 60.0}
SHAKE = PUSH | {"target": "ground", "amplitude": 12.0}


@pytest.mark.parametrize(
    ("task", "changes"),
    [
        *((name, {}) for name in ("CarriageForce", "PreStretch", "PreStretchShock", "Hybrid")),
        ("CarriageForceFriction", {"excitation": [PUSH, SHAKE]}),
        ("PreStretchShock", {"excitation": [JUMP], "actuation.force.limit": 0.5}),
    ],
)
def test_texts_do_not_overlap(studio, task, changes):
    shown = studio(task, **changes).put()
    for _ in range(9):
        shown.step(*(-0.99 for _ in shown.plant.actuators))
    assert shown.pixels.shape == (look.SIZE[1], look.SIZE[0], 3)
    boxes = [(x, y, *text.get_size()) for text, (x, y) in shown.picture._canvas._texts]
    for k, (x, y, width, height) in enumerate(boxes):
        assert x >= 0
        assert x + width <= look.SIZE[0]
        # A line is a fifth higher than its letters.
        assert not any(
            x < left + wide and left < x + width and abs(y - top) < 0.8 * min(height, high)
            for left, top, wide, high in boxes[:k]
        )


def test_springs_change_colour_and_pitch_with_the_stretch(studio):
    ends = look.spring_colour(0.0), look.spring_colour(1.0)
    counts = []
    for stretch, colour, other in ((1.0, *ends), (3.0, *ends[::-1])):
        shown = studio("PreStretch").put(x1=0.0, x2=0.0, stretch=stretch)
        top = round(look.PIXELS * (place.POST_TOP - 5))
        springs = shown.pixels[top : round(look.PIXELS * 150), : round(look.PIXELS * 600)]
        assert where(springs, colour)[0].size > 100
        assert not where(springs, other)[0].size
        counts.append(where(springs, colour)[0].size)
    assert counts[0] > 1.5 * counts[1]  # three times the coils


def test_stretch_of_one_side_grows_with_the_offset(studio):
    shown = studio("PreStretch").put(x1=0.0, x2=0.006, stretch=2.0).pixels
    band = shown[round(look.PIXELS * 100) : round(look.PIXELS * 150)]
    middle = round(look.PIXELS * place.REST)
    red = [
        half[..., 0][half.max(axis=2) - half.min(axis=2) > 60].mean()
        for half in (band[:, : middle - 30], band[:, middle + 30 : round(look.PIXELS * 600)])
    ]
    assert red[0] > red[1] + 20  # longer springs are redder


def test_only_the_parts_of_the_scene_are_drawn(studio):
    alone = Scene(interface={"kind": "none"}, carriage={"damping": 0.0}, actuation=FORCE)
    rolling, sprung = studio("CarriageForce"), studio("PreStretch")
    drawn = []
    for shown in (studio(alone), rolling, sprung):
        pixels = shown.put(x1=0.0, x2=0.0).pixels
        above = pixels[round(look.PIXELS * 90) : round(look.PIXELS * 155)]
        above = above[:, round(look.PIXELS * 60) : round(look.PIXELS * 600)]
        post = above[:, round(look.PIXELS * (place.REST + place.POST - 60))]
        drawn.append((bool(where(above, look.SHADE)[0].size), bool((post < 255).any())))
    assert drawn == [(False, False), (True, False), (True, True)]
    damper = round(look.PIXELS * 200), round(look.PIXELS * 52)
    assert (studio(alone).put().pixels[damper] == 255).all()
    assert (rolling.pixels[damper] < 255).any()


def test_force_between_the_masses_has_an_arrow_on_both(studio):
    grounded = studio("CarriageForce")
    between = {"actuation.force.between": "masses"}
    shown = studio("CarriageForce", **between).put(x1=0.0, x2=0.0, force=3.0).pixels
    above = slice(round(look.PIXELS * 90), round(look.PIXELS * place.TOP))
    body = slice(round(look.PIXELS * 60), round(look.PIXELS * 600))
    x = where(shown[above, body], look.CONTROL)[1] / look.PIXELS + 60.0
    assert x.min() < place.REST - 60.0 < place.REST < x.max() + 10.0
    low, high = arrow(shown, look.CONTROL)
    assert low > place.REST - 10.0
    assert high > place.REST + 60.0
    alone = grounded.put(x1=0.0, x2=0.0, force=3.0).pixels
    assert not where(alone[above, body], look.CONTROL)[0].size


@pytest.mark.parametrize("of", ["interface", "carriage"])
def test_semi_active_damper_is_darker_the_more_it_damps(studio, of):
    device = {"damping": {"of": of, "minimum": 0.5, "maximum": 5.0}}
    place_of = (place.REST, place.TOP - 2.0) if of == "interface" else (52.0, 200.0)
    seen = []
    for damping in (0.5, 2.0, 5.0):
        shown = studio("CarriageForce", actuation=device).put(x1=0.0, x2=0.05, damping=damping)
        seen.append(colour_at(shown.pixels, *place_of).sum())
    assert seen[0] > seen[1] > seen[2]
    assert shown.subject.damped_row in (layout.C, layout.D)


def test_limits_are_drawn_if_there_are_any(studio):
    limits = {"objective.displacement_limit": 0.012, "objective.rail_half_length": 0.02}
    shown = studio("CarriageForce", **limits).put(x1=0.0, x2=0.0)
    y, x = where(shown.pixels, look.LIMIT)
    for limit, height in ((0.012, place.GROUND - 6.0), (0.02, place.TOP - 12.0)):
        for side in (-1.0, 1.0):
            expected = place.REST + side * limit * shown.view.scale
            near = np.abs(y / look.PIXELS - height) < 8.0
            assert np.abs(x[near] / look.PIXELS - expected).min() < 2.5
    assert not where(studio("CarriageForce").put().pixels, look.LIMIT)[0].size


@pytest.mark.parametrize("x1", [0.0, 0.3, -0.3, 3e-9, 1e6])
def test_nothing_leaves_the_picture_however_far_the_carriage_moves(studio, x1):
    shown = studio("Hybrid").put(x1=x1, x2=-x1, stretch=3.0)
    pixels, scale = shown.pixels, shown.view.scale
    assert abs(x1) * scale <= place.ROOM
    assert 2.0 * abs(x1) * scale <= place.TRAVEL
    ground = slice(round(look.PIXELS * 120), round(look.PIXELS * 260))
    border = np.ones(pixels.shape[:2], bool)
    border[4:-4, 4:-4] = False
    border[ground] = False
    assert (pixels[border] == 255).all()


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_motion_that_could_not_be_followed_is_drawn_too(studio, value):
    assert studio("Hybrid").put(x1=0.0).put(x1=value, v1=value).pixels.any()


def test_camera_shows_fast_motions_of_the_ground(studio):
    frequency = 150.0
    harmonic = {"kind": "harmonic", "target": "ground", "amplitude": 4.0, "frequency": frequency}
    shown = studio(Scene(excitation=[harmonic], actuation=FORCE, control={"time_step": 2e-3})).put()
    for _ in range(400):
        shown.step(0.0)
    seen = shown.past.rows[rows.GROUND, -200:]
    # The response of a seismometer at r times its own frequency is r^2 / |r^2 - 1 - 2 i zeta r|:
    # 1.0 here, at r = 7.9, but for the mean of an acceleration over a control step, 1 %.
    assert seen.max() - seen.min() == pytest.approx(2.0 * 4.0 / frequency**2, rel=0.05)


def test_past_begins_anew_with_the_episode(studio):
    shown = studio("PreStretch").put()
    for _ in range(5):
        shown.step(0.1)
    assert shown.past.rows[rows.STEP].tolist() == [0, 1, 2, 3, 4, 5]
    shown.lanes.restart()
    shown.history.note()
    shown.step(0.1)
    assert shown.past.rows[rows.STEP].tolist() == [0, 1]
