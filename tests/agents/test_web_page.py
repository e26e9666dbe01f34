"""Is the report's page whole, true to what was measured, and usable without network?"""

import json
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from browser import chromium
from tasks import CARRIAGE_FORCE

from agents.commands import report as command
from agents.evaluation.changed_scenes import NOMINAL
from agents.evaluation.conclusions import conclude
from agents.evaluation.contestants import Episodes, law_of, read_field
from agents.evaluation.measurement import measure
from agents.evaluation.motions import Motions
from agents.policies import network
from agents.report.web_page import STUDIED, report_page
from agents.scoring import evaluate

FORCE = "mm_gym/CarriageForce-v0"
FEW = Episodes(2, 6)
HOSTILE = "</script><b>&'{{x}}"


def run(folder):
    """A finished run of a policy that pushes against v1."""
    folder.mkdir(parents=True)
    ends = np.ones(1, np.float32)
    weight = np.array([[0.0, 0.0, -1.0, 0.0]], np.float32)
    network((weight,), (0.0 * ends,), "tanh", -ends, ends).save(folder / "policy.safetensors")
    record = {"settings": {"task": FORCE}, "scene_digest": CARRIAGE_FORCE.digest}
    record["scene"] = json.loads(CARRIAGE_FORCE.model_dump_json())
    (folder / "run.json").write_text(json.dumps(record))


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    """A run and two controllers, measured in a few episodes; the run's name is hostile."""
    folder = tmp_path_factory.mktemp("runs")
    run(folder / "agent")
    compared = read_field([str(folder / "agent"), "lqr"])
    (result,) = measure(compared, FEW, STUDIED)
    return compared, result


@pytest.fixture(scope="module")
def page(measured):
    compared, result = measured
    return report_page(compared, conclude([result], compared.scenes, FEW))


class Elements(HTMLParser):
    """Reads a page; a tag that does not close what is open fails."""

    VOID = ("meta", "link", "line", "circle", "br", "input")

    def __init__(self, text):
        super().__init__()
        self.open, self.texts, self.links, self.cells = [], [], [], []
        self.feed(text)
        assert not self.open

    def handle_starttag(self, tag, attrs):
        self.links += [value for name, value in attrs if name in {"src", "href", "action"}]
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        pass

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.texts.append((tuple(self.open[-1:]), data))


def charts(page):
    """The data of the charts."""
    parts = [text for tags, text in Elements(page).texts if text.startswith('[{"')]
    return json.loads("".join(parts))


def test_page_is_well_formed_and_names_nothing_elsewhere(page):
    found = Elements(page)
    assert found.links == ["data:,"]
    assert "default-src 'none'" in page
    assert "http" not in page.replace("http-equiv", "").replace("http://www.w3.org/2000/svg", "")


def test_table_has_the_rows_of_the_comparison(page, measured):
    compared, result = measured
    (rows,) = conclude([result], compared.scenes, FEW).tables.values()
    cells = [text.strip() for tags, text in Elements(page).texts if tags in {("td",), ("th",)}]
    for row in rows:
        assert row.controller in cells
        assert f"{row.cost.low:.4f} to {row.cost.high:.4f}" in cells
    # Nothing classical was chosen, so the best constant is what others are compared with.
    changes = [row.change for row in rows if row.change is not None]
    assert len(changes) == len(rows) - 1
    assert all(f"{100.0 * change.value:+.1f} %" in cells for change in changes)
    assert "against best constant" in page


def test_charts_hold_what_was_measured(page, measured):
    _, result = measured
    (task,) = charts(page)
    assert task["labels"] == ["agent", "lqr", "best constant"]
    assert task["agents"] == 2
    groups = {group["name"]: group for group in task["groups"]}
    assert list(groups) == ["response", "spectrum", "cost", "frequency", "robustness"]
    x1 = groups["response"]["panels"][0]
    assert x1["x"][-1] == pytest.approx(1.0)
    middle = int(np.argsort(result.sample.penalties[0, 0])[3])
    want = 1e3 * result.motions["lqr"].displacement[:, middle]
    np.testing.assert_allclose(x1["curves"][1], want, rtol=1e-4)
    (cost,) = groups["cost"]["panels"]
    assert cost["x"][-1] == 100.0
    costs = np.sqrt(np.sort(result.sample.penalties[1], axis=None))
    np.testing.assert_allclose(cost["curves"][0], costs, rtol=1e-4)
    labels = [panel["x_label"] for panel in groups["robustness"]["panels"]]
    assert labels[0].startswith("carriage mass")
    assert len(labels) == 5
    mass = groups["robustness"]["panels"][0]
    assert mass["x"] == [0.7, 0.8, 0.9, 1.0, 1.1, 1.2, 1.3]
    designed = next(o.cost for o in result.outcomes if (o.study, o.label) == (NOMINAL, "lqr"))
    assert mass["curves"][1][3] == pytest.approx(designed, rel=1e-4)


def test_motions_are_those_of_the_evaluation(measured):
    _, result = measured
    motion = result.motions["lqr"]
    generator = np.random.default_rng(0)
    scored = evaluate(CARRIAGE_FORCE, law_of("lqr", CARRIAGE_FORCE, generator), episodes=6)
    np.testing.assert_array_equal(scored.penalties, result.sample.penalties[2, 0])
    scale = CARRIAGE_FORCE.objective.displacement_scale
    np.testing.assert_array_equal(motion.displacement[1:] / scale, scored.displacement)
    np.testing.assert_array_equal(motion.applied[1:], scored.applied)
    np.testing.assert_array_equal(motion.time[1:], scored.time)
    assert abs(motion.displacement[0]).max() <= 0.01
    assert abs(motion.stroke[0]).max() <= 0.02


def test_spectrum_has_the_mean_square_of_the_motions_and_forgets_those_that_ended():
    time = 0.01 * np.arange(1001)
    x1 = np.sqrt(2.0) * np.sin(2.0 * np.pi * 5.0 * time)[:, None] * np.array([1.0, 3.0, 9.0])
    x1[500:, 2] = np.nan
    frequencies, power = Motions(time, x1, x1, x1[..., None]).spectrum()
    assert frequencies[power.argmax()] == pytest.approx(5.0, abs=0.1)
    # Hann's window keeps the mean square of a whole number of periods.
    assert np.trapezoid(power, frequencies) == pytest.approx((1.0 + 9.0) / 2.0, rel=1e-3)
    assert not Motions(time, x1[:, 2:], x1, x1).spectrum()[0].size


def test_names_are_text_wherever_they_stand(measured):
    compared, result = measured
    named = tuple(HOSTILE if label == "lqr" else label for label in result.labels)
    motions = {HOSTILE if label == "lqr" else label: m for label, m in result.motions.items()}
    outcomes = [replace(o, label=HOSTILE if o.label == "lqr" else o.label) for o in result.outcomes]
    other = replace(result, labels=named, motions=motions, outcomes=outcomes)
    text = report_page(compared, conclude([other], compared.scenes, FEW))
    assert "<b>" not in text
    assert charts(text)[0]["labels"][1] == HOSTILE
    assert any(HOSTILE in part for _, part in Elements(text).texts)


def test_provenance_tells_scene_and_run(page):
    text = "".join(text for _, text in Elements(page).texts)
    assert CARRIAGE_FORCE.digest in text
    assert "settings.task" in text
    assert FORCE in text
    assert "numba" in text


def test_same_command_writes_the_same_page(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run(tmp_path / "runs" / "agent")
    words = ["report", "runs/agent", "--no-baselines", "--seeds", "1", "--episodes", "2"]
    for name in ("a", "b"):
        monkeypatch.setattr("sys.argv", [*words, "--out", f"{name}.html"])
        assert command.main() is None
    assert (tmp_path / "a.html").read_bytes() == (tmp_path / "b.html").read_bytes()
    monkeypatch.setattr("agents.commands.report.LARGEST", 1000)
    monkeypatch.setattr("sys.argv", [*words, "--out", "c.html"])
    assert "allowed: less than 0.000953674 MiB; report on fewer" in command.main()
    assert not (tmp_path / "c.html").exists()


@pytest.mark.parametrize("words", [["report"], ["report", "runs/x"]])
def test_what_cannot_be_reported_is_refused(words, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", words)
    assert command.main().startswith("error: ")
    assert not list(tmp_path.iterdir())


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    with chromium(tmp_path_factory.mktemp("profile")) as found:
        yield found


@pytest.fixture(scope="module")
def file(page, tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "report.html"
    path.write_text(page, encoding="utf-8")
    return path


@pytest.mark.browser
@pytest.mark.parametrize("dark", [False, True])
@pytest.mark.parametrize("width", [390, 1280])
def test_page_is_drawn_without_an_error_or_a_request(browser, file, width, dark):
    browser.open(file, width, dark=dark)
    assert browser.complaints() == []
    assert browser.requests() == []
    assert browser.run("document.documentElement.scrollWidth") == width
    ground = browser.run("getComputedStyle(document.body).backgroundColor")
    assert (ground == "rgb(255, 255, 255)") is not dark
    # Two panels and the force, spectrum, costs, three forces, five studies: three curves each.
    drawn = "[...document.querySelectorAll('svg.chart path')].filter(p => p.getAttribute('d'))"
    assert browser.run(f"{drawn}.length") == 3 * (3 + 1 + 1 + 3 + 5)
    assert "NaN" not in browser.run("document.querySelector('main').innerHTML")
    browser.run("document.getElementById('theme').click()")
    assert browser.run("getComputedStyle(document.body).backgroundColor") != ground


@pytest.mark.browser
def test_charts_answer_to_the_pointer_and_keys(browser, file):
    browser.open(file, 1280, 2000)
    chart = "document.querySelectorAll('svg.chart')"
    box = browser.run(f"(b => [b.left, b.top, b.width])({chart}[0].getBoundingClientRect())")
    left, top, width = box
    browser.mouse("mouseMoved", left + width / 2, top + 50)
    told = browser.run("document.querySelector('output').innerText")
    assert told.startswith("time [s]: 0.")
    assert all(f"{name}: " in told for name in ("agent", "lqr", "best constant"))
    path = f"{chart}[%d].querySelector('path').getAttribute('d')"
    before = [browser.run(path % k) for k in range(5)]
    browser.mouse("mousePressed", left + 300, top + 50, pressed=True)
    browser.mouse("mouseMoved", left + 500, top + 50, pressed=True)
    browser.mouse("mouseReleased", left + 500, top + 50)
    zoomed = [browser.run(path % k) for k in range(5)]
    # The three panels of the response are zoomed together, others are not.
    assert [a == b for a, b in zip(before, zoomed, strict=True)] == [False] * 3 + [True] * 2
    browser.run("document.querySelector('.panel > button:not([hidden])').click()")
    assert [browser.run(path % k) for k in range(5)] == before
    browser.run("document.querySelector('.legend button').click()")
    assert browser.run(f"{chart}[0].querySelectorAll('path').length") == 2
    assert browser.run(f"{chart}[3].querySelectorAll('path').length") == 3
    browser.run(f"{chart}[4].focus()")
    for kind in ("keyDown", "keyUp"):
        browser.call("Input.dispatchKeyEvent", type=kind, key="ArrowRight")
    assert "episodes that cost" in browser.run("document.querySelectorAll('output')[4].innerText")
    assert browser.complaints() == []


@pytest.mark.browser
def test_animation_plays_pauses_and_shows_its_time_in_the_charts(browser, file):
    browser.open(file, 1280, 2000)
    place = "document.querySelector('.animation circle').getAttribute('cx')"
    before = browser.run(place)
    browser.run("document.querySelector('.controls button').click()")
    moved = f"{place} !== '{before}' ? r(true) : requestAnimationFrame(f)"
    assert browser.run(f"new Promise(r => {{ const f = () => {moved}; f() }})")
    browser.run("document.querySelector('.controls button').click()")
    browser.settle()
    stopped = browser.run(place)
    browser.settle()
    assert browser.run(place) == stopped
    slider = "document.querySelector('.controls input')"
    browser.run(f"{slider}.value = 50; {slider}.oninput()")
    assert browser.run("document.querySelector('.controls span').innerText") == "t = 0.50 s"
    x = browser.run(
        "document.querySelectorAll('svg.chart')[0].querySelectorAll('.hair')[1].getAttribute('x1')"
    )
    width = browser.run("document.querySelector('svg.chart').clientWidth")
    assert float(x) == pytest.approx(58 + 0.5 * (width - 68), abs=0.1)  # the axes' margins
    assert browser.complaints() == []
