"""Excitation: forces on the carriage and accelerations of the ground, one class a kind."""

from __future__ import annotations

import glob
from itertools import islice
from typing import Annotated, ClassVar, Literal, get_args

from pydantic import AfterValidator, BeforeValidator, Field, ValidationInfo
from pydantic_core import PydanticKnownError

from mm_gym.errors import refuse
from mm_gym.records.options import MOST_LINES
from mm_gym.scene.part import Part, Ratio, Rule, below, listed, never, one_of, ordered

Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]
Range = Annotated[tuple[float, float], BeforeValidator(listed), AfterValidator(ordered)]
NumberOrRange = float | Range
PositiveOrRange = (
    Positive
    | Annotated[tuple[Positive, Positive], BeforeValidator(listed), AfterValidator(ordered)]
)
Name = Annotated[str, Field(min_length=1)]
Target = Literal["force", "ground"]
ForceUnit = Literal["N", "kN", "lbf"]
AccelerationUnit = Literal["m/s^2", "cm/s^2", "mm/s^2", "gal", "g", "ft/s^2", "in/s^2"]

UNITS = {
    "force": (get_args(ForceUnit), "a force"),
    "ground": (get_args(AccelerationUnit), "an acceleration of the ground"),
}
"""Target -> the units that its records may have, and what they are units of."""

FIXED_FIELDS = (
    *("sample_time", "time_step", "inertial_mass"),
    *("limit", "minimum", "maximum"),  # they say what an action means
)
"""Numbers that are the same in every episode."""


class Harmonic(Part):
    """amplitude * sin(frequency * t + phase)."""

    kind: Literal["harmonic"] = "harmonic"
    target: Target = "force"
    """a force on the carriage, or the acceleration of the ground"""
    amplitude: float
    """[N] or [m/s^2]"""
    frequency: NonNegative
    """[rad/s]"""
    phase: float = 0.0
    """[rad]"""


class Sweep(Part):
    """amplitude * sin(phase + integral of the frequency), which runs from start to end."""

    kind: Literal["sweep"] = "sweep"
    target: Target = "force"
    """a force on the carriage, or the acceleration of the ground"""
    amplitude: float
    """[N] or [m/s^2]"""
    start_frequency: Positive
    """[rad/s]"""
    end_frequency: Positive
    """[rad/s]; constant after it is reached"""
    duration: Positive
    """[s] from the start frequency to the end frequency, at least 0.5 / the highest frequency, and
    rounded up to whole sample intervals; a sample interval is at most 0.5 / the highest frequency,
    and shorter in fast sweeps"""
    spacing: Literal["linear", "logarithmic"] = "linear"
    """linear: equal differences of frequency in equal times; logarithmic: equal ratios"""
    phase: float = 0.0
    """[rad] at the start"""


class Sampled(Part):
    """Excitation that is sampled, and linear between the samples."""

    target: Target = "ground"
    """a force on the carriage, or the acceleration of the ground"""
    sample_time: Positive | None = None
    """longest sample interval [s]; the shortest sample time of a scene divides its control steps
    into equal sample intervals"""


class FilteredNoise(Sampled):
    """White noise through a linear filter, times an envelope.

    The samples have exactly the distribution of the filter's continuous output, up to a factor: a
    line between two samples varies less than they do, so both are scaled until the average over
    time is `rms`. The envelope is (t / rise)^2, then 1 for `plateau` seconds, then
    exp(-decay (t - rise - plateau)). By default `sample_time` is short enough that the standard
    deviation half-way between two samples is at most 1 % below theirs, and at most 0.25 / the
    filter's highest frequency.
    """

    rms: NonNegative
    """[N] or [m/s^2]: root mean square over time while the envelope is 1"""
    rise: NonNegative = 0.0
    """[s]"""
    plateau: NonNegative | None = None
    """[s]; by default to the end"""
    decay: NonNegative = 1.0
    """[1/s]"""

    rules: ClassVar[tuple[Rule, ...]] = (
        never(
            ("decay", "plateau"),
            lambda decay, plateau: decay != 1.0 and plateau is None,  # 1 is the default
            "decay: has no effect without plateau",
        ),
    )


def _is_below_one(ratio: float) -> bool:
    return 0.0 <= ratio < 1.0


class Noise(FilteredNoise):
    """Band-limited noise: white noise through Butterworth filters of second order."""

    kind: Literal["noise"] = "noise"
    target: Target = "force"
    """a force on the carriage, or the acceleration of the ground"""
    low_frequency: NonNegative = 0.0
    """[rad/s] at which the high-pass halves the power; 0 for no high-pass"""
    high_frequency: Positive
    """[rad/s] at which the low-pass halves the power"""

    rules: ClassVar[tuple[Rule, ...]] = (
        *FilteredNoise.rules,
        below("low_frequency", "high_frequency"),
    )
    ratios: ClassVar[dict[str, Ratio]] = {
        "low_ratio": Ratio(
            "low_frequency", "high_frequency", _is_below_one, "at least 0 and below 1"
        )
    }


class Soil(FilteredNoise):
    """The acceleration of a layer of soil on bedrock, whose acceleration is white noise."""

    ground_frequency: Positive
    """of the soil [rad/s]"""
    ground_damping: Positive = 0.6
    """its damping ratio [-]"""


class KanaiTajimi(Soil):
    """Filtered noise with the spectral density of Kanai (1957) and Tajimi (1960)."""

    kind: Literal["kanai_tajimi"] = "kanai_tajimi"


class CloughPenzien(Soil):
    """Kanai-Tajimi noise through a high-pass: no drift of the ground (Clough and Penzien, 1975)."""

    kind: Literal["clough_penzien"] = "clough_penzien"
    filter_frequency: Positive
    """of the high-pass [rad/s]"""
    filter_damping: Positive = 0.6
    """its damping ratio [-]"""


class Impulse(Part):
    """Impulses: jumps of the velocities, each at its own time.

    Random ones are a Poisson process. An impulse on the carriage changes v1 by size / m1; an
    impulse of the ground changes both velocities by -size.
    """

    kind: Literal["impulse"] = "impulse"
    target: Target = "force"
    """an impulse on the carriage, or a jump of the ground's velocity"""
    size: NumberOrRange
    """[N s] or [m/s]; if it is a range, each impulse draws a size"""
    rate: NonNegative = 0.0
    """mean number of impulses per second [1/s], at random times (Poisson)"""
    time: NonNegative | None = None
    """[s] of one further impulse; none by default"""

    rules: ClassVar[tuple[Rule, ...]] = (
        never(
            ("rate", "time"),
            lambda rate, time: rate == 0.0 and time is None,
            "time: missing; with rate = 0 and no time there is no impulse",
        ),
    )


def _unit_of_target(unit: object, info: ValidationInfo) -> object:
    """Return a unit; refuse what the target cannot have as pydantic's `Literal` does."""
    if unit is None or "target" not in info.data:  # a wrong target is reported by itself
        return unit
    is_force = info.data.get("inertial_mass") is None and info.data["target"] == "force"
    units, quantity = UNITS["force" if is_force else "ground"]
    if unit in units:
        return unit
    *others, last = map(repr, units)
    expected = f"{', '.join(others)} or {last} for {quantity}"
    raise PydanticKnownError("literal_error", {"expected": expected})  # noqa: EM101


def _with_period(spectral: object, period: float | None) -> str | None:
    if (spectral is None) == (period is None):
        return None
    if period is None:
        return "period: missing; spectral_acceleration is that of an oscillator of this period"
    return "period: has no effect without spectral_acceleration"


DAMPING = 0.05  # ratio of the oscillator of a spectral acceleration, if none is stated [-]


class ScaleTo(Part):
    """What records are scaled to: a number, or [low, high] for a uniform draw in each episode."""

    peak: PositiveOrRange | None = None
    """largest magnitude of the samples [m/s^2], or [N] of a record of a force"""
    spectral_acceleration: PositiveOrRange | None = None
    """pseudo-acceleration of an oscillator [m/s^2], see docs/excitation.md, section 5"""
    period: Positive | None = None
    """natural period of this oscillator [s]"""
    damping: Annotated[float, Field(ge=0, le=10)] = DAMPING
    """its damping ratio [-]"""

    rules: ClassVar[tuple[Rule, ...]] = (
        one_of("peak", "spectral_acceleration", "peak or spectral_acceleration"),
        Rule(("spectral_acceleration", "period"), _with_period),
        never(
            ("spectral_acceleration", "damping"),
            lambda spectral, damping: spectral is None and damping != DAMPING,
            "damping: has no effect without spectral_acceleration",
        ),
    )


MOST_FILES = 1000  # records of a set, at most


class Recorded(Sampled):
    """A record from a file, applied from `start` on: its piecewise-linear interpolant.

    It is zero before its first sample and after its last. Of several files each episode draws one.
    """

    kind: Literal["record"] = "record"
    file: Name | None = None
    """a PEER AT2 file, text in columns, or a .mat, .npy or .npz file; a path in a scene file is
    relative to that file's folder"""
    files: (
        Annotated[
            tuple[Name, ...], BeforeValidator(listed), Field(min_length=1, max_length=MOST_FILES)
        ]
        | Name
        | None
    ) = None
    """instead of file: a list of files, or a pattern such as "motions/*.at2", whose files are in
    alphabetical order; each episode draws one of them, with equal chances"""
    inertial_mass: float | None = None
    """[kg]: with target "force", the record is an acceleration a of the ground, and the force is
    -inertial_mass * a; negative if a mode moves less than its device, see `mm_gym.structure`"""
    unit: Annotated[
        Literal[ForceUnit, AccelerationUnit] | None, BeforeValidator(_unit_of_target)
    ] = None
    """unit of the values; by default g for AT2, else m/s^2 or N"""
    time_step: Positive | None = None
    """[s] between the samples: then no column of the file has times"""
    column: Annotated[int, Field(ge=1, le=1000)] | Annotated[str, Field(min_length=1)] | None = None
    """number, from 1, or name of the column with the samples; by default the only one, or the
    second of two. Without time_step the first column has the times [s]"""
    skip: Annotated[int, Field(ge=0, le=MOST_LINES)] = 0
    """number of lines to leave out at the beginning of a text"""
    variable: Annotated[str, Field(min_length=1)] | None = None
    """name of the array in a .mat or .npz file, or of the field of a struct, as in "run.acc"; by
    default the only one"""
    scale: float = 1.0
    """factor of the values [-]"""
    scale_to: ScaleTo | None = None
    """scales the whole record, before `start` too, in place of scale"""
    time_scale: Positive = 1.0
    """factor of the times [-]; below 1 the record runs faster"""
    start: NonNegative = 0.0
    """time of the record [s] at which an episode begins"""

    rules: ClassVar[tuple[Rule, ...]] = (
        one_of("file", "files", "file, or files for a set of records"),
        never(
            ("scale", "scale_to"),
            lambda scale, scale_to: scale != 1.0 and scale_to is not None,
            "scale: has no effect with scale_to",
        ),
        never(
            ("target", "inertial_mass", "scale_to.spectral_acceleration"),
            lambda target, mass, spectral: target == "force" and mass is None and spectral,
            "scale_to: spectral_acceleration is of the ground's motion; got target = 'force'",
        ),
        never(
            ("inertial_mass", "target"),
            lambda mass, target: mass is not None and target != "force",
            "inertial_mass: has no effect on the ground; set target = 'force'",
        ),
    )

    @property
    def source(self) -> str:
        """The field that names the files: "file" or "files"."""
        return "file" if self.files is None else "files"

    @property
    def paths(self) -> tuple[str, ...]:
        """The files, in order; those of a pattern are looked for.

        Raises
        ------
        SceneError
            If no file matches the pattern, or too many do.
        """
        if isinstance(self.files, tuple):
            return self.files
        if self.files is None:
            return () if self.file is None else (self.file,)
        found = tuple(islice(glob.iglob(self.files), MOST_FILES + 1))  # noqa: PTH207 - Path has no absolute patterns
        if not 1 <= len(found) <= MOST_FILES:
            got = f"{len(found)} files" if not found else f"more than {MOST_FILES} files"
            refuse(self.files, f"{got}", f"1 to {MOST_FILES} that match the pattern")
        return tuple(sorted(found))


Excitation = Annotated[
    Harmonic | Sweep | Noise | KanaiTajimi | CloughPenzien | Impulse | Recorded,
    Field(discriminator="kind"),
]
"""Any kind of excitation; `mm_gym.plant.excitation.KINDS` says how each compiles."""
