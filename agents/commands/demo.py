"""Evolve a network in seconds, train PPO, plan, and report all with the controllers.

This is what ``make demo`` runs. All control the adaptive absorber, on the same hundred held-out
episodes as in docs/tasks.md, in three minutes if two cores are idle. At the end it writes a web
page of all, ``runs/NAME/report.html``.
"""

from pathlib import Path

from agents.commands._search import search_and_score
from agents.commands.report import Arguments, write_report
from agents.commands.train import train_and_report
from agents.controllers.learned import Learned
from agents.errors import command
from agents.evaluation.headroom import EPISODES
from agents.evaluation.plans import Effort, Planner
from agents.evolution.search import EvolveSettings, evolve
from agents.policies import load_policy
from agents.training.config import TrainSettings, read_settings
from agents.training.runs import Run, numbered

SETTINGS = Path(__file__).parents[2] / "configs" / "agents" / "pre_stretch.toml"

GENERATIONS = 600  # of the evolution: some fifteen seconds on two cores

LONGEST = {"evolution": 180.0, "PPO": 180.0}
"""Time [s] after which a search ends, on a machine that is busy with other work; that of the
evolution includes compilation, the first time, which can take a minute there."""

EFFORT = Effort(
    random=3,
    kept=2,
    first=8,
    second=20,
    rounds=2,
    steps=10,
    searches=1,
    generations=100,
    descent=0,
    last=10,
)
"""Of the planner: some nine seconds, and a cost 0.01 % above that of the plans in docs/tasks.md."""


@command
def main() -> None:
    """Run anew, next to earlier demos, or continue an interrupted one."""
    settings = read_settings(SETTINGS, TrainSettings)
    trained = numbered(settings.model_copy(update={"time_budget": LONGEST["PPO"]}))
    evolved = EvolveSettings(
        task=trained.task,
        name=f"{trained.name}-evolved",
        generations=GENERATIONS,
        time_budget=LONGEST["evolution"],
    )
    search_and_score(evolved, evolve)
    network = Learned(load_policy(Run(evolved.name).policy), "evolved network")
    planner = Planner(trained.load_scene(), {}, EFFORT)
    train_and_report(trained, [planner, network], episodes=EPISODES, name="PPO")
    folders = str(Run(evolved.name).folder), str(Run(trained.name).folder)
    write_report(Arguments(subjects=folders, out=Run(trained.name).folder / "report.html"))
