"""Does a run say how it ended: of how much, and whether its agent is worth having?"""

from pathlib import Path

import numpy as np
import pytest
from rollouts import PUSHING

from agents.commands import descend, evolve, iterate
from agents.commands import train as command
from agents.controllers.constant import ConstantAction
from agents.controllers.learned import Learned
from agents.evolution.search import EvolveSettings
from agents.gradient.settings import GradientSettings
from agents.policies import load_policy
from agents.scoring import validation_cost
from agents.training.config import TrainSettings
from agents.training.progress import Ending, read_ending
from agents.training.runs import Run
from agents.training.starts import start_of
from agents.value_iteration.iteration import IterateSettings
from mm_gym import load_scene

FRAME = """
[springs]
kind = "small_on_large"
[[excitation]]
kind = "noise"
rms = 0.5
low_frequency = 5.0
high_frequency = 60.0
sample_time = 0.005
[sensors]
channels = ["carriage_displacement"]
noise = { carriage_displacement = 1e-4 }
delay = 2
[actuation.force]
limit = 10.0
[objective]
effort_weight = 0.001
[control]
steps = 150
"""
"""A light frame under a random force, of which one late and noisy displacement is observed."""

SHORT = {
    "evolve": ["--generations", "1", "--candidates", "4", "--episodes", "2"],
    "descend": ["--iterations", "1", "--episodes", "2"],
    "train": ["--steps", "320", "--lanes", "16", "--ppo.rollout", "10", "--evaluations", "1"],
}


@pytest.fixture(autouse=True)
def frame(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(command, "report_run", lambda *_, **__: None)  # the laws' tuning takes long
    (tmp_path / "frame.toml").write_text(FRAME)
    return load_scene(tmp_path / "frame.toml")


@pytest.fixture
def lines_of(capsys, monkeypatch):
    def lines(module, *arguments):
        monkeypatch.setattr("sys.argv", ["command", *arguments])
        capsys.readouterr()
        assert module.main() is None
        return capsys.readouterr().out.splitlines()

    return lines


@pytest.mark.parametrize("kind", [EvolveSettings, GradientSettings, IterateSettings, TrainSettings])
def test_no_time_ends_a_run_unless_one_is_asked_for(kind):
    assert kind().time_budget is None


@pytest.mark.parametrize(
    ("module", "arguments", "counted"),
    [
        (iterate, ["PreStretchShock", "--points", "5", "--stretches", "5"], (160, "sweeps")),
        (evolve, ["CarriageForce", "--candidates", "4", "--episodes", "2"], (200, "generations")),
        (descend, ["CarriageForce", "--episodes", "2"], (600, "iterations")),
        (command, ["CarriageForce", "--steps", "9000", "--lanes", "16"], (9000, "control steps")),
    ],
)
def test_time_budget_that_ends_a_run_is_told_last_and_kept(module, arguments, counted, lines_of):
    budget = ["--name", "brief", "--time-budget", "1e-9"]
    lines = lines_of(module, *arguments, *budget)
    ending, (total, unit) = read_ending(Run("brief")), counted
    assert (ending.total, ending.time_budget) == (total, 1e-9)
    assert 0 <= ending.done < total
    told = f"ended by its time budget of 1e-09 s after {ending.done:,} of {total:,} {unit}; "
    assert lines[-1].startswith(told)
    # The same command does nothing, and says so again.
    assert lines_of(module, *arguments, *budget)[-1] == lines[-1]


def test_run_ended_by_time_goes_on_without_a_budget(lines_of):
    arguments = ["CarriageForce", "--generations", "3", "--candidates", "4", "--episodes", "2"]
    lines_of(evolve, *arguments, "--time-budget", "1e-9")
    lines = lines_of(evolve, *arguments)
    assert read_ending(Run("CarriageForce")).done == 3
    assert not any("budget" in line for line in lines)


def test_searches_of_one_task_do_not_take_each_others_folder(lines_of):
    lines_of(evolve, "PreStretchShock", *SHORT["evolve"])
    lines_of(descend, "PreStretchShock", *SHORT["descend"])
    coarse = ["--points", "5", "--stretches", "5", "--sizes", "3", "--sweeps", "2"]
    lines_of(iterate, "PreStretchShock", *coarse)
    names = {"PreStretchShock", "PreStretchShock-gradient", "PreStretchShock-values"}
    assert {folder.name for folder in Path("runs").iterdir()} == names


@pytest.mark.usefixtures("untuned")
class TestLateNoisyFrame:
    """Where the natural controller of a force is worse than no control."""

    def costs(self, scene):
        def cost(law):
            start = start_of(scene, EvolveSettings(law=law), np.random.default_rng(0))
            return validation_cost(scene, Learned(start.policy()))

        return {law: cost(law) for law in ("regulator", "lqg", "none", "auto")}

    def test_auto_begins_as_what_is_best_there(self, frame):
        costs = self.costs(frame)
        assert costs["none"] == validation_cost(frame, ConstantAction(frame))
        assert costs["auto"] == costs["lqg"] < 0.7 * costs["none"] < costs["regulator"]

    @pytest.mark.parametrize("module", [evolve, descend])
    def test_search_ends_at_its_best_start_or_below(self, module, frame, lines_of):
        short = SHORT[module.__name__.split(".")[-1]]
        arguments = ["CarriageForce", "--scene", "frame.toml", "--name", "mine", *short]
        lines = lines_of(module, *arguments)
        cost = validation_cost(frame, Learned(load_policy(Run("mine").policy)))
        # The search acts in single precision.
        assert cost <= min(self.costs(frame).values()) * (1.0 + 1e-4)
        ending = read_ending(Run("mine"))
        assert ending.cost == pytest.approx(cost, rel=1e-4)
        if ending.cost == ending.began_with:
            assert lines[-1].startswith("note: on the validation episodes no agent was better than")

    def test_search_that_is_worse_than_no_control_says_so_and_is_no_control(self, frame, lines_of):
        own = ["CarriageForce", "--scene", "frame.toml", "--name", "mine", "--law", "regulator"]
        lines = lines_of(evolve, *own, *SHORT["evolve"])
        without = validation_cost(frame, ConstantAction(frame))
        ending = read_ending(Run("mine"))
        assert ending.replaced
        assert ending.cost > ending.no_control == without
        assert lines[-1] == (
            "warning: on the validation episodes all agents were worse than no control: "
            f"the best costs {ending.cost:.6g}, no control {without:.6g}; the policy is no control"
        )
        assert validation_cost(frame, Learned(load_policy(Run("mine").policy))) == without

    def test_trained_agent_that_is_worse_than_no_control_says_so(self, lines_of, tmp_path):
        (tmp_path / "bad.py").write_text(PUSHING)
        base = ["CarriageForce", "--scene", "frame.toml", "--name", "mine", "--base", "bad.py:Law"]
        lines = lines_of(command, *base, *SHORT["train"])
        ending = read_ending(Run("mine"))
        assert ending.began_as == "bad.py:Law"
        assert ending.no_control < ending.cost <= ending.began_with
        assert lines[-1].startswith("warning: on the validation episodes all agents were worse")
        assert lines[-1].endswith("; the policy is the best agent")


@pytest.mark.parametrize(
    ("costs", "told"),
    [
        ((0.5, 0.6, 0.7), []),
        ((0.5, 0.5, 0.7), ["note"]),
        ((0.9, 1.0, 0.7), ["warning"]),
        ((0.9, 0.9, 0.7), ["warning"]),
        ((None, None, 0.7), ["warning"]),
        ((0.70001, 0.8, 0.7), []),  # round-off
        ((0.5, None, None), []),
    ],
)
def test_notes_are_of_what_the_costs_are(costs, told):
    named = dict(zip(("cost", "began_with", "no_control"), costs, strict=True))
    ending = Ending(unit="sweep", done=2, total=2, time_budget=None, began_as="a law", **named)
    assert [note.split(":")[0] for note in ending.notes] == told
