"""Orders that a reader would not expect, and why they are so."""

from __future__ import annotations

from typing import TYPE_CHECKING

from agents.training.config import short_name

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    Row = Mapping[str, str | float]

MARGIN = 1e-3
"""Relative differences of costs up to this one count as none."""

NO_BETTER = "no better than the best constant"

PASSIVE = (
    "It has another damper in the interface, eleven times the task's, which takes out more energy "
    "than any stretch; no actuator of the task changes the damping."
)

SEEKING = (
    "Its wobble takes half a second and the slope is known after tens of them: an episode is too "
    "short, and the wobble itself costs."
)
LINEAR = "Its model is linear about rest, where the sphere sticks: it does not break it loose."

EXPLAINED: dict[tuple[str, str, str], str] = {
    ("CarriageForceDuffing", "velocity feedback", "LQR"): (
        "The LQR is designed about rest, where the cubic spring is not felt, and does not fit "
        "large motions; a damper takes energy out of the motion on any spring."
    ),
    ("CarriageForceFriction", "LQR", NO_BETTER): (
        "99 % of its cost is the sphere's offset, which it does not see; it stills the carriage in "
        "a way that moves the sphere a little farther out."
    ),
    ("CarriageForceFriction", "velocity feedback", "LQR"): (
        "Neither sees the sphere's offset, which is 99 % of what both pay for; the gentler one "
        "moves it less."
    ),
    ("PreStretch", "best passive damper", NO_BETTER): (
        "It is tuned against the worst of all frequencies, with springs that do not reach the "
        "optimum; the best constant stretch is tuned to the band of the task."
    ),
    ("PreStretch", "resetting stiffness", NO_BETTER): (
        "Resetting needs several switches a period; here the springs take five periods of the "
        "carriage from one end to the other."
    ),
    ("PreStretch", "predictive", "informed"): (
        "83 % of the matching stretch's cost comes in the first half second, while springs and "
        "motion settle; the law is that of the steady motion, and the plans use the transient."
    ),
    ("CarriageForceFriction", "H-infinity", NO_BETTER): LINEAR,
    ("CarriageForceFriction", "finite-horizon LQR", NO_BETTER): LINEAR,
    ("CarriageForceFriction", "linear MPC", NO_BETTER): LINEAR,
    ("PreStretch", "extremum seeking", NO_BETTER): SEEKING,
    ("PreStretchNoise", "extremum seeking", NO_BETTER): SEEKING,
    ("PreStretchShock", "extremum seeking", NO_BETTER): SEEKING,
    ("PreStretchNoise", "best passive damper", "law"): PASSIVE,
    ("PreStretchShock", "best passive damper", "law"): PASSIVE,
}
"""(task, start of a name or role, what it beats or `NO_BETTER`) -> why."""


def surprises(task: str, rows: Sequence[Row]) -> list[tuple[str, str | None]]:
    """Return what is unexpected in the order of a task's controllers, each with its explanation.

    Unexpected is: what does no better than the best constant; a law of more knowledge that costs
    more than one of less; a passive damper that costs less than all laws; a simple law that costs
    less than the LQR.

    Returns
    -------
    list of tuple
        Sentences; the explanation is None where there is none yet.
    """
    found = []
    for better, worse, key in _unexpected(rows):
        told = f"{worse} is {NO_BETTER}." if key[1] == NO_BETTER else f"{better} beats {worse}."
        found.append((told[0].upper() + told[1:], _explanation(task, *key)))
    return found


def _unexpected(rows: Sequence[Row]) -> Iterator[tuple[str, str, tuple[str, str]]]:
    """Yield which controller costs less than which, and by what its explanation is found."""
    of: dict[str, list[Row]] = {}
    for row in rows:
        of.setdefault(str(row["role"]), []).append(row)
    (constant,) = of["constant"]
    for role in ("passive", "law", "predictive", "informed", "learned", "planner"):
        for row in of.get(role, []):
            if _beats(constant, row):
                yield _name(constant), _name(row), (_name(row), NO_BETTER)
    regulators = [row for row in of.get("law", []) if _name(row).startswith("LQR")]
    simple = [row for row in of.get("law", []) if _name(row).startswith("velocity feedback")]
    yield from _pairs(simple, regulators, None, "LQR")
    for role, above in (("law", "predictive"), ("predictive", "informed")):
        yield from _pairs(_best(of.get(role, [])), of.get(above, []), role, above)
    observing = [row for role in ("law", "predictive", "learned") for row in of.get(role, [])]
    yield from _pairs(observing, of.get("planner", []), None, "planner")
    yield from _pairs(of.get("passive", []), _best(of.get("law", [])), None, "law")


def _pairs(
    better: Sequence[Row], worse: Sequence[Row], role: str | None, against: str
) -> Iterator[tuple[str, str, tuple[str, str]]]:
    for one in better:
        for other in worse:
            if _beats(one, other):
                first = _name(one) if role is None else str(one["role"])
                yield _name(one), _name(other), (first, against)


def _best(rows: Sequence[Row]) -> list[Row]:
    return sorted(rows, key=lambda row: float(row["cost"]))[:1]


def _beats(one: Row, other: Row) -> bool:
    return float(one["cost"]) < float(other["cost"]) * (1.0 - MARGIN)


def _name(row: Row) -> str:
    return str(row["controller"])


def _explanation(task: str, name: str, against: str) -> str | None:
    short = short_name(task)
    for (of_task, start, other), why in EXPLAINED.items():
        if of_task == short and name.startswith(start) and other == against:
            return why
    return None
