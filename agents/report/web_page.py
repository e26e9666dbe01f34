"""A comparison as one HTML page with interactive charts, which needs no network."""

import os
import platform
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from agents.evaluation.conclusions import Comparison
from agents.evaluation.contestants import Episodes, Field
from agents.evaluation.measurement import Studies, TaskResult
from agents.evaluation.motions import Motions
from agents.report.charts import Panel, frequency, robustness
from agents.report.comparison import episodes_in_words, paired_cells
from agents.report.pages import FOLDER, decimals, not_scored_cells, web_page
from agents.scoring import FREQUENCY, spread_frequency
from agents.training.runs import Run, by_dotted_name, commit, versions
from mm_gym import Scene
from mm_gym.arrays import Array
from mm_gym.drawing import ACTUATORS, COLOURS
from mm_gym.tasks import short_name

LARGEST = 5 * 2**20  # size that a page stays below [bytes]
DIGITS = 5  # significant digits of what is drawn: a fiftieth of a pixel
SHOWN = 2_000  # control steps of a response that are drawn, from its start

BRIGHT = ("#56B4E9", "#F08A4B", "#2FBF94", "#E2A1C8", "#F2B632", "#9AD4F5", "#F2F2F2")
"""The colours of `COLOURS`, lighter: on a dark ground."""


@dataclass(frozen=True)
class Group:
    """Panels with one legend, under a heading; `linked` ones are zoomed together."""

    name: str
    title: str
    text: str
    panels: list[Panel]
    linked: bool = False


STEADY = (
    "Steady amplitude of x1 at the frequency of a harmonic force, which takes the place of the "
    "excitation, over the static deflection. Linear loops are the same at every amplitude."
)
CHANGED = "Each controller as it is, on scenes that differ from the one it was made for."

STUDIED = Studies(robustness=True, frequency=True, motions=True)  # what the page takes


def report_page(compared: Field, comparison: Comparison) -> str:
    """Return the page of a comparison that was measured with `STUDIED`."""
    tasks = [_on_page(compared, comparison, result) for result in comparison.results]
    charts = [
        {name: task[name] for name in ("labels", "agents", "springs")}
        | {"groups": [_data(group) for group in task["groups"]]}
        for task in tasks
    ]
    return web_page(
        "report",
        title=", ".join(task["name"] for task in tasks),
        episodes=episodes_in_words(comparison),
        tasks=tasks,
        overall=comparison.overall,
        charts=charts,
        paired=paired_cells,
        place=_place,
        colours=list(zip(COLOURS, BRIGHT, strict=True)),
        style=Markup((FOLDER / "report.css").read_text("utf-8")),  # noqa: S704 - our own file
        script=Markup((FOLDER / "report.js").read_text("utf-8")),  # noqa: S704 - our own file
        made_with={"commit": commit(), "Python": platform.python_version(), **versions()},
        machine=f"{platform.machine()}, {platform.system()}",
    )


def _place(value: float, span: tuple[float, float]) -> str:
    """Return where a cost lies between the ends of the bars, in per cent of a logarithmic axis."""
    low, high = (np.log(max(end, 1e-12)) for end in span)
    place = (np.log(max(value, 1e-12)) - low) / max(high - low, 1e-9)
    return f"{100.0 * min(max(place, 0.0), 1.0):.2f}"


def _on_page(compared: Field, comparison: Comparison, result: TaskResult) -> dict[str, Any]:
    """Return a task on the page: its table, its controllers in the charts, and the charts."""
    scene, rows = compared.scenes[result.task], comparison.tables[result.task]
    labels, found = list(result.motions), list(result.motions.values())
    penalties = result.sample.penalties[result.compared, 0]  # of the reference's first seed
    median = int(np.argsort(penalties)[penalties.size // 2])
    groups = [
        _responses(scene, found, median),
        _spectra(found),
        _costs(scene, result, labels, comparison.episodes),
        Group("frequency", "Steady response over frequency", STEADY, frequency(result.loops)),
        Group("robustness", "Robustness", CHANGED, robustness(result.outcomes)),
    ]
    fields = by_dotted_name(scene.model_dump(mode="json"))
    return {
        "name": short_name(result.task),
        "against": result.against,
        # The ends of the bars of the table [-].
        "digits": decimals((row.cost.value for row in rows), 4),
        "span": (min(row.cost.low for row in rows), max(row.cost.high for row in rows)),
        "rows": rows,
        "not_scored": not_scored_cells(result.not_scored),
        "labels": labels,  # of the controllers in the charts, the agents first
        "agents": sum(one.label in labels for one in compared.contestants),
        "groups": [group for group in groups if group.panels],
        "springs": scene.springs.kind != "none",
        "scene": {"digest": scene.digest} | {key: str(value) for key, value in fields.items()},
        "runs": _runs(compared, result.task),
    }


def _data(group: Group) -> dict[str, Any]:
    """Return a group as what JSON can hold."""
    found = asdict(group)
    for panel in found["panels"]:
        panel["x"], panel["curves"] = _points(panel["x"]), [_points(one) for one in panel["curves"]]
    return found


def _points(values: Array) -> list[float | None]:
    return [float(f"{v:.{DIGITS}g}") if np.isfinite(v) else None for v in values.tolist()]


def _responses(scene: Scene, found: Sequence[Motions], episode: int) -> Group:
    shown = slice(0, SHOWN + 1)

    def panel(curves: Sequence[Array], label: str, *, held: bool = False) -> Panel:
        shorter = [one[shown] for one in curves]
        return Panel(found[0].time[shown], shorter, "time [s]", label, held=held)

    panels = [
        panel([1e3 * one.displacement[:, episode] for one in found], "carriage x1 [mm]"),
        panel([1e3 * one.stroke[:, episode] for one in found], "relative displacement [mm]"),
    ]
    for k, name in enumerate(scene.actuation.names):
        applied = [one.applied[:, episode, k] for one in found]
        panels.append(panel(applied, ACTUATORS[name], held=True))
    cut = f" Its first {SHOWN} control steps are drawn." if scene.control.steps > SHOWN else ""
    text = f"Episode {episode} of the first seed, of median cost for the reference.{cut}"
    return Group("response", "Response", text, panels, linked=True)


def _spectra(found: Sequence[Motions]) -> Group:
    """Return the spectra, up to where all are below a millionth of the peak.

    They begin behind what Hann's window leaks of the mean.
    """
    pairs = [one.spectrum() for one in found]
    lasted = [pair for pair in pairs if pair[0].size]
    if not lasted:
        return Group("spectrum", "", "", [])
    frequencies = lasted[0][0]
    highest = np.max([power for _, power in lasted], axis=0)
    end = int(np.flatnonzero(highest >= 1e-6 * highest[2:].max())[-1]) + 1
    kept = slice(2, max(end, 4))
    curves = [1e6 * power[kept] for _, power in pairs]
    text = (
        "Power spectral density of x1, the mean over the episodes of the first seed that lasted to "
        "their end: periodograms in Hann's window."
    )
    panel = Panel(frequencies[kept], curves, "frequency [Hz]", "of x1 [mm²/Hz]", y_log=True)
    return Group("spectrum", "Spectrum", text, [panel])


def _costs(scene: Scene, result: TaskResult, labels: Sequence[str], episodes: Episodes) -> Group:
    """Return the episodes' costs, over the frequency that is drawn or from easy to hard."""
    band = spread_frequency(scene, episodes.each).get(FREQUENCY)
    penalties = [result.sample.penalties[result.labels.index(label)] for label in labels]
    if band is not None:
        x = band / (2.0 * np.pi)
        curves = [np.sqrt(one.mean(axis=0)) for one in penalties]
        title, label = "Cost over frequency", "frequency of the excitation [Hz]"
        text = "Each point is the episodes of all seeds at one frequency."
    else:
        x = 100.0 * np.arange(1, penalties[0].size + 1) / penalties[0].size
        curves = [np.sqrt(np.sort(one, axis=None)) for one in penalties]
        title, label = "Cost of the episodes", "episodes that cost at most this [%]"
        text = "Each controller's own order, from its easiest episode to its hardest."
    low = min(float(curve.min()) for curve in curves)
    panel = Panel(x, curves, label, "cost [-]", y_log=low > 0.0)
    return Group("cost", title, text, [panel])


def _runs(compared: Field, task: str) -> dict[str, dict[str, str]]:
    """Return what the record of each run among the contestants says, by the run's folder."""
    found: dict[str, dict[str, str]] = {}
    for one in compared.contestants:
        for text in one.texts.get(task, ()):
            run = Run(Path(text).name, Path(text).parent)
            if os.path.lexists(run.record):
                found[text] = _told(run.read())
    return found


def _told(record: dict[str, Any]) -> dict[str, str]:
    """Return a run's record in lines: not its scene, whose digest tells it, nor the user's code."""
    kept = ("command", "scene_digest", "python", "machine", "settings", "versions")
    return {
        name: str(value)
        for name, value in by_dotted_name(
            {key: record[key] for key in kept if key in record}
        ).items()
        if value is not None
    }
