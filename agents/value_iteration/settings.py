"""The settings of a value iteration."""

from __future__ import annotations

from typing import Annotated, ClassVar, Self

from pydantic import Field, model_validator

from agents.network.files import LARGEST
from agents.training.config import SEED_BITS, Count, TimedSettings
from agents.value_table.kernel import NODES


class IterateSettings(TimedSettings):
    """The grid, and how long its values are iterated."""

    task: str = "mm_gym/PreStretchShock-v0"
    """a registered id"""
    seed: Annotated[int, Field(ge=0, lt=1 << SEED_BITS)] = 0
    """without effect, as nothing is drawn; so that sweeps over seeds can have it"""
    evaluations: Count = 5
    """validations during the run; the best policy is kept"""
    points: Annotated[int, Field(ge=NODES, le=101)] = 25
    """of each of the three directions of a motion"""
    stretches: Annotated[int, Field(ge=2, le=1001)] = 33
    """over the actuator's range"""
    sizes: Annotated[int, Field(ge=2, le=101)] = 7
    """of a motion, where there are random impulses; without, the value is as its square"""
    sweeps: Count = 160
    """of the whole run"""
    threads: Count = 2
    """among which a sweep is divided; results do not depend on it"""

    growing: ClassVar[tuple[str, ...]] = ("sweeps", "time_budget")
    suffix: ClassVar[str] = "-values"

    @model_validator(mode="after")
    def _fits_a_file(self) -> Self:
        size = 16 * self.stretches * self.points**3 * self.sizes  # four faces of four bytes
        if size > 0.99 * LARGEST:
            msg = (
                f"points, stretches, sizes: got a table of {size / 2**20:.0f} MiB; "
                f"allowed: less than {LARGEST / 2**20:.0f} MiB"
            )
            raise ValueError(msg)
        return self
