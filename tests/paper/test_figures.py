"""Do the figures show what the paper's captions and text name, legibly and with units?"""

import numpy as np
import pytest

pytest.importorskip("matplotlib")

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_hex
from matplotlib.text import Text

from mm_gym.drawing import COLOURS, WIDTH, style
from mm_gym.paper import figures
from mm_gym.paper.figures import FIGURES

LETTERS = {
    "fig2": "ABCDEF",
    "fig2_caption": "ABCDEF",
    "fig3": "ABCD",
    "fig3_caption": "ABCD",
    "fig5": "AB",
    "fig6": "ABCDEF",
    "fig7": "",
    "fig8": "ABCD",
    "fig9": "AB",
    "fig10": "AB",
    "fig12": "ABCDEF",
    "bistable": "ABCDEF",
}
_drawn = {}


def figure_of(name):
    """Return a figure, laid out."""
    if name not in _drawn:
        with style():
            figure = FIGURES[name]()
            FigureCanvasAgg(figure).draw()
        _drawn[name] = figure
    return _drawn[name]


def panel(name, letter):
    return figure_of(name).axes[LETTERS[name].index(letter)]


def curves(axes, least=3):
    """Return the data of the lines with at least so many points, by colour."""
    lines = [line for line in axes.get_lines() if len(line.get_xdata()) >= least]
    return {to_hex(line.get_color()).upper(): line.get_xydata() for line in lines}


def path(name, letter, mass):
    """Return x [mm] and v [m/s] of a mass along its path."""
    return curves(panel(name, letter))[COLOURS[mass].upper()]


@pytest.mark.parametrize("name", FIGURES)
def test_every_panel_has_its_letter_and_every_axis_a_unit(name):
    figure = figure_of(name)
    titles = [axes.get_title(loc="left") for axes in figure.axes]
    assert "".join(title[:1] for title in titles) == LETTERS[name]
    assert figure.get_size_inches()[0] == WIDTH
    for axes in figure.axes:
        labels = [axes.get_xlabel(), axes.get_ylabel()]
        # An axis without a label is that of the panel below or to the side, which it is tied to.
        for label, siblings in zip(
            labels, (axes.get_shared_x_axes(), axes.get_shared_y_axes()), strict=True
        ):
            assert label.endswith("]") or (not label and len(siblings.get_siblings(axes)) > 1)


@pytest.mark.parametrize("name", FIGURES)
def test_nothing_is_clipped_and_no_text_is_smaller_than_in_print(name):
    figure = figure_of(name)
    width, height = figure.get_size_inches()
    with style():  # outside of it the ticks would be others
        box = figure.get_tightbbox()
    assert box.x0 >= 0.0 <= box.y0
    assert box.x1 <= width
    assert box.y1 <= height
    texts = [text for text in figure.findobj(Text) if text.get_text() and text.get_visible()]
    assert min(text.get_fontsize() for text in texts) >= 7.5


@pytest.mark.parametrize("figure", ["fig2", "fig3"])
def test_both_readings_of_the_masses_are_drawn_and_stated(figure):
    for suffix, masses in (("", (0.04, 0.1)), ("_caption", (0.1, 0.04))):
        stated = "$m_1$ = {:g} kg, $m_2$ = {:g} kg".format(*masses)
        assert stated in figure_of(figure + suffix).get_suptitle()


@pytest.mark.parametrize("name", ["fig2", "fig2_caption"])
def test_figure_2_marks_the_one_damping_that_the_paper_leaves_open(name):
    starred = [letter for letter in "ABCDEF" if "*" in panel(name, letter).get_title(loc="left")]
    assert starred == ["F"]
    assert "* assumed" in figure_of(name).get_suptitle()


@pytest.mark.parametrize("name", ["fig3", "fig3_caption"])
def test_figure_3_shows_paths_of_carriage_and_sphere_without_and_with_interface(name):
    assert panel(name, "B").get_title(loc="left").startswith("B: sphere, $c$ = 0")
    assert panel(name, "D").get_title(loc="left").startswith("D: sphere, $c$ = 1")
    for letter in "AC":
        carriage = path(name, letter, 0)
        assert carriage[0] == pytest.approx([10.0, 0.0])
        assert carriage[-1] == pytest.approx([0.0, 0.0], abs=0.01)
    still, moved = path(name, "B", 1), path(name, "D", 1)
    assert np.ptp(still, axis=0) == pytest.approx([0.0, 0.0], abs=0.0)
    assert moved[[0, -1]] == pytest.approx(np.array([[30.0, 0.0], [20.0, 0.0]]), abs=0.01)


def test_figure_5_says_that_no_measured_points_were_published():
    assert "publishes no data" in figure_of("fig5").get_suptitle()


@pytest.mark.parametrize(
    ("name", "start", "ends"), [("fig6", 30.0, (30.0, 20.0)), ("fig12", 10.0, (0.0, 0.0))]
)
def test_figures_6_and_12_show_both_displacements_and_both_paths(name, start, ends):
    for row, end in zip(("ABC", "DEF"), ends, strict=True):
        history = curves(panel(name, row[0]))
        for mass in range(2):
            x, v = path(name, row[1 + mass], mass).T
            assert x[0] == pytest.approx((10.0, start)[mass])
            assert np.array_equal(history[COLOURS[mass].upper()][:, 1], x)
            assert (x[-1], v[-1]) == pytest.approx((0.0, 0.0) if mass == 0 else (end, 0.0), abs=0.6)


def test_figure_6_shows_the_linear_system_behind():
    labels = [text.get_text() for text in figure_of("fig6").legends[0].get_texts()]
    assert "linear, $\\beta = 0$" in labels


def test_the_bistable_carriage_ends_in_a_marked_well_and_is_said_to_be_none_of_the_papers():
    assert "not a figure of the paper" in figure_of("bistable").get_suptitle()
    assert "none of the paper's" in figures.__doc__.replace("\n", " ")
    for letter, offset in (("B", None), ("E", 20.0)):
        carriage, sphere = path("bistable", letter, 0), path("bistable", "CF"[letter == "E"], 1)
        marks = [line for line in panel("bistable", letter).get_lines() if line.get_marker() == "+"]
        wells = marks[0].get_xdata()
        assert list(wells) == pytest.approx([-5.0, 5.0])
        assert np.abs(carriage[-1, 0] - wells).min() < 0.1
        assert np.abs(carriage[-1, 1]) < 0.01
        if offset is not None:  # the first integral
            assert sphere[-1, 0] - carriage[-1, 0] == pytest.approx(offset, abs=0.1)
    # The dashed curve of the hill's energy passes through the middle, and ends beyond the wells.
    hill = curves(panel("bistable", "B"))[COLOURS[3].upper()]
    assert np.abs(hill[:, 0]).max() == pytest.approx(5.0 * np.sqrt(2.0))
    assert hill[np.argmin(np.abs(hill[:, 0])), 1] == pytest.approx(0.0, abs=1e-9)


def test_figure_7_is_the_graph_of_the_friction_law():
    axes = figure_of("fig7").axes[0]
    assert "open circle" in figure_of("fig7").get_suptitle()
    stick, slip = COLOURS[0].upper(), COLOURS[1].upper()
    found = curves(axes, least=2)
    assert found[stick][-1] == pytest.approx([0.2, 0.509 * 0.3924])
    assert found[slip][0] == pytest.approx([0.2, 0.2545 * 0.3924])
    # mu1 > mu2 and chi > 0: the force falls where slip begins and rises from there on.
    assert np.all(np.diff(found[slip][:, 1]) > 0.0)


def test_figure_8_shows_what_the_linear_system_would_do():
    displacements, velocities = panel("fig8", "A"), panel("fig8", "B")
    level = [line for line in displacements.get_lines() if line.get_label().startswith("linear")]
    assert list(level[0].get_ydata()) == pytest.approx([20.0, 20.0])
    assert curves(displacements)[COLOURS[1].upper()][-1, 1] == pytest.approx(21.19, abs=0.05)
    assert np.abs(curves(velocities)[COLOURS[0].upper()][:, 1]).max() == pytest.approx(
        0.54, abs=0.01
    )
    assert path("fig8", "C", 0)[0] == pytest.approx([10.0, 0.0])
    assert path("fig8", "D", 1)[0] == pytest.approx([30.0, 0.0])
    (circle,) = panel("fig8", "D").collections
    assert np.asarray(circle.get_offsets()[0]) == pytest.approx([20.0, 0.0])
    assert circle.get_linestyle()[0][1] is not None  # dashed


def test_figure_9_shows_the_linear_twin_on_the_same_curves():
    for letter in "AB":
        axes = panel("fig9", letter)
        black = [line for line in axes.get_lines() if to_hex(line.get_color()) == "#000000"]
        own = curves(axes)
        for mass in range(2):
            # 1e-10 mm and m/s; the two are the same motion but for round-off.
            friction = own[COLOURS[mass].upper()][:, 1]
            assert np.abs(black[mass].get_ydata() - friction).max() < 1e-10


def test_figure_10_has_a_above_b_and_seven_and_five_curves():
    above, below = panel("fig10", "A"), panel("fig10", "B")
    assert above.get_position().y0 > below.get_position().y1
    assert [len(axes.get_legend().get_texts()) for axes in (above, below)] == [7, 5]


@pytest.mark.parametrize("letter", ["A", "B"])
def test_curves_of_figure_10_are_told_apart_without_colour(letter):
    axes = panel("fig10", letter)
    marked = [line for line in axes.get_lines() if line.get_marker() not in {".", "None"}]
    marks = [line.get_marker() for line in marked]
    assert len(set(marks)) == len(marks) == len(axes.get_legend().get_texts())
