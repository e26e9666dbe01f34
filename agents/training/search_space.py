"""The settings that tuning searches, and the file that it writes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from agents.training.algorithm_settings import OffPolicySettings, PPOSettings
from agents.training.config import TrainSettings
from mm_gym.scene import toml_block

if TYPE_CHECKING:
    from optuna import Trial

LAYERS = {"32 x 32": (32, 32), "64 x 64": (64, 64), "128 x 128": (128, 128), "256": (256,)}

RUN = ("name", "seed", "threads")
"""Settings that a file of settings leaves out: they are a run's own."""


def suggested(trial: Trial, settings: TrainSettings, name: str) -> TrainSettings:
    """Return the settings that a trial tries, under the name of its run."""
    chosen = settings.chosen
    reward = chosen.reward_scale * trial.suggest_float("reward", 0.1, 10.0, log=True)
    own: dict[str, Any] = {
        "learning_rate": _short(trial.suggest_float("learning_rate", 1e-4, 1e-2, log=True)),
        "discount": round(1.0 - trial.suggest_float("1 - discount", 5e-3, 0.2, log=True), 4),
        "hidden": LAYERS[trial.suggest_categorical("hidden", list(LAYERS))],
        "reward_scale": _short(reward),
    }
    if isinstance(chosen, PPOSettings):
        own |= {
            "rollout": trial.suggest_categorical("rollout", [25, 50, 100, 200]),
            "epochs": trial.suggest_int("epochs", 3, 15),
            "gae_lambda": _short(trial.suggest_float("gae_lambda", 0.8, 0.99)),
            "initial_log_std": _short(trial.suggest_float("initial_log_std", -2.0, 0.5)),
        }
        parts = trial.suggest_categorical("batches", [2, 4, 8, 16, 32])
        samples = settings.lanes * own["rollout"]
        sizes = range(max(2, samples // parts), samples + 1)
        own["batch_size"] = next(size for size in sizes if samples % size == 0)
    if isinstance(chosen, OffPolicySettings):
        own |= {
            "gradient_steps": trial.suggest_int("gradient_steps", 1, 16, log=True),
            "batch_size": trial.suggest_categorical("batch_size", [128, 256, 512]),
        }
    if "tau" in type(chosen).model_fields:
        own["tau"] = _short(trial.suggest_float("tau", 2e-3, 5e-2, log=True))
    data = plain(settings)
    data[settings.algorithm] |= own
    if settings.scene is None:  # an own scene is always normalised
        data["normalise_observations"] = trial.suggest_categorical(
            "normalise_observations", [False, True]
        )
    if settings.base is not None:
        data["authority"] = _short(trial.suggest_float("authority", 0.1, 1.0))
    return TrainSettings.of(data | {"name": name})


def _short(value: float) -> float:
    """Return a value with three digits, which a file can hold and no training tells from it."""
    return float(f"{value:.3g}")


def plain(settings: TrainSettings) -> dict[str, Any]:
    """Return the settings of a training alone, whatever a subclass adds, as data."""
    return settings.model_dump(include=set(TrainSettings.model_fields))


def as_toml(settings: TrainSettings, comment: str, name: str) -> str:
    """Return a file like those of `configs/agents`: what differs from the defaults.

    Parameters
    ----------
    comment
        Its first lines.
    name
        The name of its runs.
    """
    default, data = TrainSettings().model_dump(), plain(settings)
    head = "".join(f"# {line}\n" for line in comment.splitlines())
    top: dict[str, Any] = {"task": settings.task, "name": name}
    tables: list[str] = []
    for key, value in data.items():
        if key == "task" or key in RUN or value == default[key]:
            continue
        if not isinstance(value, dict):
            top[key] = value
        elif key in ("changes", settings.algorithm):
            own = {k: v for k, v in value.items() if v != default[key].get(k)}
            tables.append(toml_block(f"[{key}]", own))
    return "\n".join([head + toml_block("", top), *tables])
