"""Errors of control steps over the bounds that methods promise, in random scenes.

    python -m tests.numerics.bounds --scenes 30000 --out bounds.jsonl

measures the scenes of `random_scenes`, a few lanes and control steps each, from their true
starts, against `double_double_kernel`, or `device_kernel` for what that does not know, and prints
the table of docs/numerics.md. It goes on where
it was broken off: what the file has already is not measured again.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import warnings
from dataclasses import asdict, dataclass
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import mpmath as mp
import numpy as np

from mm_gym import CompileError, SimulationError, compile_scene, simulate
from mm_gym.excitation import impulse_process, noise, record
from mm_gym.excitation import kinds as kernels
from mm_gym.excitation.harmonics import rotate
from mm_gym.excitation.impulses import pass_impulses
from mm_gym.excitation.kinds import excite
from mm_gym.lanes import layout
from mm_gym.law.interface import LINE
from mm_gym.simulation.lanes import Lanes
from mm_gym.step.task import command, hold

from . import device_kernel
from . import double_double_kernel as precise
from .random_scenes import DEVICES, METHODS, STEPS, method_of, random_plant

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    from mm_gym import Scene
    from mm_gym.plant.plant import Plant

    Array = NDArray[np.float64]

LANES, LANES_WITH_DEVICES = 6, 3
NOTHING = 1e-15  # size of motions [m, m/s] that are rounding of balanced forces
BALANCED = 4  # how many scenes with devices there are to one whose energy is added up, too
ROUND_OFF = 1e-12  # bound of the methods whose only error is round-off
REFRESH = 1024  # sample intervals after which kernels compute phases anew

ROUNDED = 10.0
"""Round-off that a tolerance is allowed on top, in units of the effect of rounding the reference's
state to doubles after each series."""

LATE = Fraction(1, 2**52)
"""By what part of the episode's time impulses and records may be late: its last digit. What that
costs is allowed on top as well."""


class Step(NamedTuple):
    """A control step of one lane, as `double_double_kernel.advance` takes it."""

    parameters: Array
    lengths: Array
    lines: Array
    jumps: Array
    oscillators: Array
    phases: Array

    def end(self, start: Array, *, rounded: bool = False) -> tuple[int, Array, Array]:
        """Return status, the (4,) end and the (4,) scale: the largest position and velocity."""
        state, largest = start.astype(np.float64).copy(), np.zeros(4)
        status = precise.advance(*self, state, largest, rounded)
        return int(status), state, np.repeat([largest[:2].max(), largest[2:].max()], 2)


@dataclass(frozen=True)
class Outcome:
    """The worst control step of a random scene.

    Attributes
    ----------
    seed
        Of the scene.
    method, kind
        What propagated it, and its kind of plant.
    bound
        The bound of the error [-].
    ratio
        The largest error over the bound.
    floor
        What rounding of state and time may add to the bound, in units of it, where the ratio is
        above 1 and the bound is a tolerance; otherwise 0.
    steps
        The control steps measured, in all lanes.
    imbalance
        Of energy, in units of what is exchanged; of each scene `BALANCED` with devices, else 0.
    """

    seed: int
    method: str
    kind: str
    bound: float
    ratio: float
    floor: float
    steps: int
    imbalance: float = 0.0

    @property
    def excess(self) -> float:
        """The error over what is allowed."""
        return self.ratio / (1.0 + self.floor)


def outcome(seed: int, folder: Path) -> Outcome:
    """Return the outcome of a seed; records are written to a folder."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        scene, plant = random_plant(seed, folder)
    rng = np.random.default_rng([seed, 1])
    is_tolerant = plant.method.option is not None
    bound = scene.solver.tolerance if is_tolerant else ROUND_OFF
    has_device = plant.support.interface is not LINE
    lanes = Lanes(plant, LANES_WITH_DEVICES if seed >= DEVICES else LANES)
    lanes.seed(seed)
    lanes.restart()
    grow_old(lanes, int(10.0 ** rng.uniform(0.0, 4.0)) if rng.random() < 0.5 else 0)
    found: list[tuple[_Lane, Array, Array, Array, Array]] = []
    largest = np.zeros((lanes.count, 4))
    for _ in range(STEPS):
        status, starts, followed = advance(lanes, rng)
        if status > layout.ENDED:
            break
        for i, lane in enumerate(followed):
            reached, want, scale = lane.reach(starts[:, i])
            if has_device and _largest(lanes.values[:4, i] - want, scale) > bound:
                # It may be the reference that missed a kink.
                reached, want, scale = lane.reach(starts[:, i], device_kernel.FINER)
            if reached == precise.OK and scale.min() > NOTHING:
                # Round-off is measured by the trajectory, tolerances by the control step alone.
                largest[i] = np.maximum(largest[i], scale)
                over = scale if is_tolerant else largest[i]
                found.append((lane, starts[:, i], lanes.values[:4, i] - want, want, over))
    imbalance = imbalance_of(scene, rng) if seed >= DEVICES and seed % BALANCED == 0 else 0.0
    worst = max(found, key=lambda one: _largest(one[2], one[4]), default=None)
    if worst is None:
        return Outcome(seed, plant.method.name, plant.support.kind, bound, 0.0, 0.0, 0, imbalance)
    lane, start, difference, want, scale = worst
    ratio, floor = _largest(difference, scale) / bound, 0.0
    if ratio > 1.0 and is_tolerant and not has_device:
        rounded = lane.step().end(start, rounded=True)[1] - want
        late = lane.step(late=LATE).end(start)[1] - want
        floor = (ROUNDED * _largest(rounded, scale) + _largest(late, scale)) / bound
    return Outcome(
        *(seed, plant.method.name, plant.support.kind, bound, ratio, floor, len(found), imbalance)
    )


def imbalance_of(scene: Scene, rng: np.random.Generator) -> float:
    """Return what the balance of an episode's energy leaves, over all that is exchanged.

    The motion is worked out to 1e-11, or as well as the scene allows. The quadrature of interfaces
    in value form takes the plant's method at a tolerance of its own, so that the balance closes all
    the same. It is not a number where energy is not followed.
    """
    limits = {name: getattr(scene.actuation, name) for name in scene.actuation.names}
    actions = [
        rng.uniform(*((-a.limit, a.limit) if name == "force" else (a.minimum, a.maximum)), STEPS)
        for name, a in limits.items()
    ]
    for tolerance in 10.0 ** np.arange(-11, -5):
        try:
            with warnings.catch_warnings():
                warnings.filterwarnings("ignore", "solver.tolerance has no effect")
                plant = compile_scene(scene.replace(**{"solver.tolerance": tolerance}))
            found = simulate(
                plant,
                duration=STEPS * scene.control.time_step,
                action=np.transpose(actions) if actions else None,
                seed=0,
            )
            gap = np.abs(found.energy - found.energy[0] - found.work.total).max()
            exchanged = max(found.work.throughput.max(), found.energy.max())
            return float(gap / exchanged) if exchanged > 0.0 else float(gap)
        except (CompileError, SimulationError):
            continue
    return np.nan


def _largest(difference: Array, scale: Array) -> float:
    with np.errstate(invalid="ignore"):
        parts = np.abs(difference) / scale
    return float(np.where(difference == 0.0, 0.0, parts).max())


def grow_old(lanes: Lanes, steps: int) -> None:
    """Let the episodes of all lanes be some control steps old, without their motion."""
    plant, values = lanes.plant, lanes._values
    intervals = plant.support.intervals_per_step
    count = steps * intervals
    for j in range(len(plant.support.ground)):
        harmonic = layout.HARMONICS + layout.HARMONIC_ROWS * j
        for i in range(lanes.count):
            time = Fraction(plant.support.sample_interval) * (count - count % REFRESH)
            sine, cosine, *_ = _harmonic(values[:, i], harmonic, time)
            values[harmonic + layout.SINE, i], values[harmonic + layout.COSINE, i] = (
                sine[0],
                cosine[0],
            )
    for made in range(count - count % REFRESH, count):
        values[layout.NOW, 0] = made // intervals
        rotate(plant.model, values, made % intervals, 0, lanes.count)
    values[layout.NOW, 0] = steps
    if plant.support.sampled:
        for i in range(lanes.count):
            lane = values[:, i : i + 1].copy()
            pass_impulses(plant.model, lane, float(count))
            values[:, i] = lane[:, 0]


def advance(lanes: Lanes, rng: np.random.Generator) -> tuple[int, Array, list[_Lane]]:
    """Make a control step; return status, starts (n, lanes), and the lanes for the reference."""
    plant, values, count = lanes.plant, lanes._values, lanes.count
    intervals = plant.support.intervals_per_step
    actions = rng.uniform(-1.2, 1.2, len(plant.actuators) * count)
    command(plant.task, values, actions, lanes.rewards, 0, count)
    hold(plant.model, values, 0, count)
    before, samples = values[:, :count].copy(), []
    filters = [row + noise.VALUE for kind, _, row, _ in _parts(plant) if kind == kernels.FILTER]
    samples, status = [before[filters]], layout.OK
    own = plant.entries.kernels(plant.task, plant.model, values, excited=True)[0]
    for interval in range(intervals):
        if plant.support.sampled:
            excite(plant.model, values, lanes.streams, interval, 0, count)
            samples.append(values[filters, :count].copy())
            status = max(status, plant.entries.cross(plant.model, values, interval, own, 0, count))
        else:
            status = max(status, plant.entries.propagate(plant.model, values, 0, count))
        rotate(plant.model, values, interval, 0, count)
    if not np.isfinite(values[:4, :count]).all():
        status = layout.DIVERGED
    if status > layout.ENDED:
        return status, before, []
    age = int(values[layout.NOW, 0])
    values[layout.NOW, 0] += 1.0
    followed = [
        _Lane(plant, before[:, i], age, [sample[:, i] for sample in samples]) for i in range(count)
    ]
    return status, before[plant.support.state_rows], followed


def _parts(plant: Plant) -> list[tuple[int, int, int, Array]]:
    """Return kind, target, first row and own slots of each part but the harmonics."""
    described = plant.support.excitation
    slots = described[kernels.FIRST : kernels.FIRST + kernels.SIZE * int(described[0])]
    return [
        (int(s[kernels.KIND]), int(s[kernels.TARGET]), int(s[kernels.ROW]), s[kernels.OWN :])
        for s in slots.reshape(-1, kernels.SIZE)
    ]


def _harmonic(lane: Array, row: int, time: Fraction) -> tuple[tuple[float, float], ...]:
    """Return sine, cosine, frequency and growth of a harmonic at a time [s]."""
    with mp.workdps(45):
        frequency = mp.mpf(lane[row + layout.FREQUENCY])
        angle = mp.mpf(lane[row + layout.PHASE]) + frequency * _exactly(time)
        numbers = mp.sin(angle), mp.cos(angle), frequency, mp.mpf(0)
        return tuple(_pair_of(x) for x in numbers)


def _exactly(x: Fraction) -> mp.mpf:
    return mp.mpf(x.numerator) / x.denominator


def _pair_of(x: mp.mpf) -> tuple[float, float]:
    high = float(x)
    return high, float(x - high)


def _pair(x: Fraction) -> tuple[float, float]:
    high = float(x)
    return high, float(x - Fraction(high))


class _Lane:
    """A lane at the start of a control step, and the samples of noise in it."""

    def __init__(self, plant: Plant, lane: Array, age: int, samples: list[Array]) -> None:
        self.plant, self.lane, self.samples = plant, lane, samples
        self.count = plant.support.intervals_per_step
        self.past = age * self.count
        self.interval = Fraction(plant.support.sample_interval)
        self.begin = self.clock = self.past * self.interval
        self.end = self.count * self.interval
        self.parts = _parts(plant)

    def step(self, late: Fraction = Fraction(0)) -> Step:
        """Return what the reference takes, with impulses and records by a late clock."""
        self.clock = self.begin * (1 + late)
        jumps, ends = self._jumps(), self._sweep_ends()
        places = {
            Fraction(0),
            *jumps,
            *(place for place in ends.values() if place),
            *self._corners(),
        }
        if self.samples[0].size:
            places |= {k * self.interval for k in range(self.count)}
        starts = sorted(place for place in places if place < self.end)
        stops = [*starts[1:], self.end]
        oscillators, phases = self._oscillators({place: k for k, place in enumerate(starts)}, ends)
        return Step(
            self._parameters(),
            np.array([_pair(b - a) for a, b in zip(starts, stops, strict=True)]),
            np.array([self._lines(a, b) for a, b in zip(starts, stops, strict=True)]),
            np.array([jumps.get(place, (0.0, 0.0)) for place in starts]),
            np.array(oscillators).reshape(-1, precise.FIELDS),
            np.array(phases).reshape(-1, 4, 2),
        )

    def _parameters(self) -> Array:
        names = self.plant.support.names  # of a damping under control: what its actuator holds
        c, d = (names.get(f"{part}.damping", layout.C) for part in ("interface", "carriage"))
        rows = (
            *(
                layout.M1,
                layout.M2,
                layout.K1,
                d,
                layout.ALPHA,
                layout.BETA,
                c,
                layout.MU1,
                layout.MU2,
                layout.VR,
            ),
            *(layout.CHI, layout.FN, layout.K0, layout.L0, layout.STRETCH, layout.FORCE),
        )
        found = np.append(self.lane[list(rows)], self._reaction())
        if self._springs() == "linear":
            found[precise.STRETCH] = 0.0
        return found

    def _reaction(self) -> float:
        """Return what acts on the sphere where a force acts on the carriage [N]."""
        return -float(self.lane[layout.FORCE]) if self.plant.support.is_between else 0.0

    def _springs(self) -> str:
        """Return the springs' kind."""
        names = self.plant.support.names
        if "springs.stiffness" not in names:
            return "none"
        if "springs.rest_length" in names:
            return "finite_stretch"
        return "small_on_large" if self.lane[layout.STRETCH] > 0.0 else "linear"

    def reach(self, start: Array, finer: int = 1) -> tuple[int, Array, Array]:
        """Return status, end and scale as `Step.end`, by the reference that knows the scene."""
        support, lane = self.plant.support, self.lane
        if support.interface is LINE:
            return self.step().end(start)
        numbers = {name: float(lane[row]) for name, row in support.names.items()}
        numbers |= {"force": float(lane[layout.FORCE]), "reaction": self._reaction()}
        numbers["springs.stretch"] = float(lane[layout.STRETCH])
        kinds = support.interface.kind, self._springs()
        end, largest = device_kernel.end_of(
            *(numbers, kinds, self.step(), start), finer * device_kernel.STEPS
        )
        scale = np.repeat([largest[:2].max(), largest[2:4].max()], 2)
        return precise.OK, end[:4], scale

    def _jumps(self) -> dict[Fraction, tuple[float, float]]:
        """Return by what impulses change v1 and v2 [m/s], by the time since the step's start."""
        model, lane, jumps = self.plant.model, self.lane[:, None].copy(), {}
        step, last = self.plant.support.sample_interval, float(self.past + self.count)
        described = int(model[layout.EXCITATION]) + kernels.FIRST
        for k, (kind, target, row, _) in enumerate(self.parts):
            own = described + kernels.SIZE * k + kernels.OWN
            while kind == kernels.IMPULSE:
                time = float(lane[row + impulse_process.NEXT, 0])
                if time >= step * (last * (1.0 - impulse_process.CLOSE)):
                    break
                size = impulse_process.take(model, own, lane, row, 0.0, 0)
                jump = (-size, -size) if target else (size / self.lane[layout.M1], 0.0)
                place = max(Fraction(time) - self.clock, Fraction(0))
                v1, v2 = jumps.get(place, (0.0, 0.0))
                jumps[place] = v1 + jump[0], v2 + jump[1]
        return jumps

    def _whole(self, row: int) -> int:
        """Return the sample intervals of a sweep."""
        highest = max(self.lane[row + n] for n in (kernels.START_FREQUENCY, kernels.END_FREQUENCY))
        duration = max(self.lane[row + kernels.DURATION], kernels.LONGEST_TURN / highest)
        intervals = float(duration) / float(self.interval)
        return max(1, int(np.ceil(intervals - 1e-9)))

    def _sweep_ends(self) -> dict[int, Fraction | None]:
        """Return the first row of each sweep -> when it ends, if in the step."""
        ends: dict[int, Fraction | None] = {}
        for kind, _, row, _ in self.parts:
            if kind == kernels.SWEEP:
                place = (self._whole(row) - self.past) * self.interval
                ends[row] = place if 0 < place < self.end else None
        return ends

    def _points(self, own: Array) -> tuple[Array, Array]:
        block = self.plant.support.excitation[int(own[record.TABLE]) :]
        return tuple(record.points_in(block, 0)[0])

    def _clock(self, row: int) -> tuple[Fraction, Fraction]:
        """Return start and time scale of a record."""
        start, scale = self.lane[row + record.START], self.lane[row + record.TIME_SCALE]
        return Fraction(float(start)), Fraction(float(scale))

    def _corners(self) -> list[Fraction]:
        found: list[Fraction] = []
        for kind, _, row, own in self.parts:
            if kind == kernels.RECORD:
                start, scale = self._clock(row)
                low = float(start + self.clock / scale)
                high = float(start + (self.clock + self.end) / scale)
                times = self._points(own)[0]
                inside = times[(low <= times) & (times <= high)]
                found += [(Fraction(float(t)) - start) * scale - self.clock for t in inside]
        return [place for place in found if 0 < place < self.end]

    def _lines(self, begin: Fraction, end: Fraction) -> list[tuple[float, float]]:
        """Return force [N] and ground acceleration [m/s^2], each at both ends of a piece."""
        middle, totals, filters = float(begin + end) / 2.0, [0.0] * 4, 0
        for kind, target, row, own in self.parts:
            line = None
            if kind == kernels.FILTER:
                line = self._between(filters, middle)
                filters += 1
            elif kind == kernels.RECORD:
                line = self._segment(row, own, middle)
            if line is not None:
                first, length, low, high = line
                for n, place in enumerate((begin, end)):
                    part = float(place - first) / length
                    totals[2 * target + n] += (1.0 - part) * low + part * high
        return [(total, 0.0) for total in totals]

    def _between(self, part: int, middle: float) -> tuple[Fraction, float, float, float]:
        """Return start, length and end values of a filter's line."""
        k = int(middle / float(self.interval))
        ends = float(self.samples[k][part]), float(self.samples[k + 1][part])
        return k * self.interval, float(self.interval), *ends

    def _segment(
        self, row: int, own: Array, middle: float
    ) -> tuple[Fraction, float, float, float] | None:
        """Return the same of a record's line, in the control step's time."""
        (start, scale), (times, values) = self._clock(row), self._points(own)
        here = float(start) + (float(self.clock) + middle) / float(scale)
        k = int(np.searchsorted(times, here, "right")) - 1
        if k < 0 or k >= len(times) - 1:
            return None
        factor = float(self.lane[row + record.SCALE])
        first = (Fraction(float(times[k])) - start) * scale - self.clock
        length = float(times[k + 1] - times[k]) * float(scale)
        return first, length, factor * float(values[k]), factor * float(values[k + 1])

    def _oscillators(
        self, pieces: dict[Fraction, int], ends: dict[int, Fraction | None]
    ) -> tuple[list[tuple[float, ...]], list[tuple[tuple[float, float], ...]]]:
        oscillators: list[tuple[float, ...]] = []
        phases: list[tuple[tuple[float, float], ...]] = []
        for j, ground in enumerate(self.plant.support.ground):
            row = layout.HARMONICS + layout.HARMONIC_ROWS * j
            amplitude = float(self.lane[row + layout.AMPLITUDE])
            oscillators.append((amplitude, float(ground), 0, 0.0, 0.0))
            phases.append(_harmonic(self.lane, row, self.begin))
        for kind, target, row, own in self.parts:
            if kind == kernels.SWEEP:
                place, is_over = ends[row], self.past >= self._whole(row)
                shape = 0 if is_over else 2 if own[0] > 0.0 else 1
                until = float(pieces[place]) if place is not None else np.inf
                last = float(self.lane[row + kernels.END_FREQUENCY])
                amplitude = float(self.lane[row + kernels.SWEEP_AMPLITUDE])
                oscillators.append((amplitude, float(target), shape, last, until))
                phases.append(self._sweep(row, is_logarithmic=own[0] > 0.0))
        return oscillators, phases

    def _sweep(self, row: int, *, is_logarithmic: bool) -> tuple[tuple[float, float], ...]:
        """Return sine, cosine, frequency and growth of a sweep at the step's start."""
        with mp.workdps(45):
            first, last = (
                mp.mpf(self.lane[row + n]) for n in (kernels.START_FREQUENCY, kernels.END_FREQUENCY)
            )
            length = _exactly(self._whole(row) * self.interval)
            time, over = min(_exactly(self.begin), length), _exactly(self.begin) >= length
            growth = mp.log(last / first) / length if is_logarithmic else (last - first) / length
            if not is_logarithmic:
                frequency, angle = first + growth * time, (first + growth * time / 2) * time
            elif growth == 0:
                frequency, angle = first, first * time
            else:
                frequency = first * mp.exp(growth * time)
                angle = first * mp.expm1(growth * time) / growth
            angle += mp.mpf(self.lane[row + kernels.SWEEP_PHASE])
            if over:
                frequency = last
                angle += last * (_exactly(self.begin) - length)
            numbers = mp.sin(angle), mp.cos(angle), frequency, growth
            return tuple(_pair_of(x) for x in numbers)


def table(outcomes: Iterable[Outcome]) -> str:
    """Return the distribution of error over bound, by method, as a table of Markdown."""
    by_method: dict[str, list[Outcome]] = {}
    for one in outcomes:
        by_method.setdefault(one.method, []).append(one)
    lines = [
        "| method | scenes | control steps | median | 90 % | 99 % | 99.9 % | largest | exceed |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for method, found in sorted(by_method.items()):
        excess = np.array([one.excess for one in found])
        quantiles = np.quantile(excess, [0.5, 0.9, 0.99, 0.999, 1.0])
        lines.append(
            f"| `{method}` | {len(found):,} | {sum(one.steps for one in found):,} | "
            + " | ".join(f"{x:.1g}" if x < 0.1 else f"{x:.2f}" for x in quantiles)
            + f" | {int((excess > 1.0).sum())} |"
        )
    return "\n".join(lines)


def _read(file: Path) -> dict[int, Outcome]:
    lines = file.read_text(encoding="utf-8").splitlines() if file.exists() else []
    found = [Outcome(**json.loads(line)) for line in lines]
    return {one.seed: one for one in found}


def main() -> None:
    """Measure seeds that the file does not have, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=int, default=1000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--method", choices=METHODS, help="only scenes made for this method")
    parser.add_argument("--out", type=Path, required=True)
    arguments = parser.parse_args()
    found = _read(arguments.out)
    seeds = range(arguments.first, arguments.first + arguments.scenes)
    if arguments.method:
        seeds = [seed for seed in seeds if method_of(seed) == arguments.method]
    with arguments.out.open("a", encoding="utf-8") as out, tempfile.TemporaryDirectory() as folder:
        for seed in seeds:
            if seed not in found:
                found[seed] = outcome(seed, Path(folder))
                out.write(json.dumps(asdict(found[seed])) + "\n")
                out.flush()
                (Path(folder) / f"{seed}.csv").unlink(missing_ok=True)
            if not found[seed].excess <= 1.0:
                sys.stderr.write(f"{found[seed]}\n")
    sys.stdout.write(table(found.values()) + "\n")


if __name__ == "__main__":
    main()
