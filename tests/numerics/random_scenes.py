"""Random scenes of all elements, excitations and drawn parameters, one for each seed."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from mm_gym import CompileError, Scene, SceneError, compile_scene

if TYPE_CHECKING:
    from pathlib import Path

    from mm_gym.plant.plant import Plant

    Values = dict[str, Any]

STEPS = 3
MOST_INTERVALS = 40  # sample intervals of a control step that the excitation asks for, about

DRAWN = "exact", "switched", "series", "splitting", "taylor"
METHODS = *DRAWN, "runge_kutta", "devices"
GENERAL = 1_000_000
"""The first seed of scenes for the general method; those before are for a method that is drawn."""

PARAMETRIC = 2_000_000  # the first seed of scenes for the splitting with drawn parameters
DEVICES = 3_000_000  # the first seed of scenes with devices: see `_device`

SERIES = 4_000_000
"""The first seed of scenes for the series with drawn parameters and all excitation."""

VALUED = "stribeck", "bouc_wen", "magnetorheological"  # kinds of interface in value form

FINITE = 5_000_000
"""The first seed of scenes for the splitting with springs of finite stretch, with all of these."""

EXCITATIONS = (
    *("harmonic", "sweep", "noise", "kanai_tajimi", "clough_penzien", "impulse", "record"),
)
NOISES = "noise", "kanai_tajimi", "clough_penzien"
TRIES = 50


def random_plant(seed: int, folder: Path) -> tuple[Scene, Plant]:
    """Return a random scene and its plant; records are written to a folder.

    Half of the scenes for a method ask for it, the others for what `auto` takes.
    """
    rng, method = np.random.default_rng(seed), method_of(seed)
    if DEVICES <= seed < SERIES:
        return _with_device(rng, folder / f"{seed}.csv")
    own = (method,) if seed >= GENERAL else DRAWN
    if seed < GENERAL:
        rng.choice(DRAWN)
    for _ in range(TRIES):
        try:
            kind = {"parametric": seed >= PARAMETRIC, "finite": seed >= FINITE}
            scene = _scene(rng, method, folder / f"{seed}.csv", **kind)
            plant = compile_scene(scene)
            if _is_swapped(scene, plant.method.name, method):
                scene = scene.replace(**{"solver.method": method})
                plant = compile_scene(scene)
        except (SceneError, CompileError):
            continue
        if plant.method.name in own:
            return scene, plant
    msg = f"seed {seed}: no scene for {method!r} in {TRIES} tries"
    raise RuntimeError(msg)


def _is_swapped(scene: Scene, chosen: str, method: str) -> bool:
    """Tell whether `auto` took one of two methods where the other one applies too."""
    if chosen == "splitting":
        is_finite = scene.springs.kind == "finite_stretch"
        return method == "runge_kutta" and bool(
            scene.randomization or scene.excitation or is_finite
        )
    return chosen == "runge_kutta" != method


def method_of(seed: int) -> str:
    """Return the method for which the scene of a seed is made."""
    if seed >= SERIES:
        return "series" if seed < FINITE else "splitting"
    if seed >= DEVICES:
        return "devices"
    if seed >= GENERAL:
        return "splitting" if seed >= PARAMETRIC else "runge_kutta"
    return str(np.random.default_rng(seed).choice(DRAWN))


def _near(rng: np.random.Generator, middle: float, decades: float = 1.0) -> float:
    return float(middle * 10.0 ** rng.uniform(-decades, decades))


def _sign(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def _scene(
    rng: np.random.Generator, method: str, file: Path, *, parametric: bool, finite: bool
) -> Scene:
    """Return a random scene to which a method may apply, for some methods parametric or not."""
    fixed, is_plain = (
        method == "splitting" and not parametric,
        method == "series" and not parametric,
    )
    x1, offset = _near(rng, 0.01) * _sign(rng), _near(rng, 0.01) * _sign(rng)
    m1, m2, k1 = _near(rng, 0.1), _near(rng, 0.04), _near(rng, 400.0)
    springs = _springs(rng, method, offset, is_plain=is_plain, finite=finite)
    beta, alpha = _coefficients(rng, method, x1)
    if finite and rng.random() < 0.4:
        beta, alpha = 0.0, 1.0
    k2 = 6.0 * springs.get("stiffness", 0.0)
    hardening = max(0.0, 1.0 + 3.0 * beta * x1**2)
    rate = float(np.sqrt((k1 * hardening + k2) / m1 + k2 / m2))
    radians = {"splitting": 0.7}.get(method, 1.0 + float(rng.random() < 0.1))
    radians = 0.3 if is_plain else radians
    step = float(10.0 ** rng.uniform(-2.0, radians) / rate)
    data: Values = {
        "carriage": {
            "mass": m1,
            "stiffness": k1,
            "linear_coefficient": alpha,
            "cubic_coefficient": beta,
            "damping": float(rng.random() < 0.7) * _near(rng, 0.1 * m1 * rate),
        },
        "sphere": {"mass": m2},
        "springs": springs,
        "interface": _interface(rng, method),
        "initial": {
            "carriage_displacement": x1,
            "sphere_offset": offset,
            "carriage_velocity": float(rng.random() < 0.5) * rate * x1 * float(rng.uniform(-1, 1)),
        },
        "control": {"time_step": step, "steps": 1_000_000},
        "actuation": _actuation(rng, springs, k1 * abs(x1), step, is_plain=is_plain),
    }
    if not fixed:
        size = _Size(m1, k1, abs(x1), rate, step)
        data["excitation"] = _excitations(rng, size, file, is_plain=is_plain)
    lowest = {"series": -12.0, "splitting": -12.0, "runge_kutta": -12.0}.get(method, -14.0)
    data["solver"] = {"tolerance": float(10.0 ** rng.uniform(lowest, -1.0))}
    if method == "taylor" or rng.random() < 0.5:
        data["solver"]["method"] = method
    data["randomization"] = {} if fixed else _drawn(rng, data)
    return Scene(**data)


def _coefficients(rng: np.random.Generator, method: str, x1: float) -> tuple[float, float]:
    """Return beta, up to a thousand times the linear spring, and alpha."""
    if method in ("exact", "switched", "series"):
        return 0.0, 1.0
    beta = _near(rng, x1**-2, 3.0)
    if method == "splitting":
        return beta, float(rng.choice([1.0, 1.0, 0.0]))
    kind = rng.random()
    if kind < 0.2:
        return 0.0, 1.0
    if kind < 0.35:
        return -min(beta, 0.3 * x1**-2), 1.0  # within the barrier
    return beta, float(rng.choice([1.0, 1.0, 0.0, -1.0]))


def _springs(
    rng: np.random.Generator, method: str, offset: float, *, is_plain: bool, finite: bool
) -> Values:
    kinds = ["none", "small_on_large"]
    if is_plain:
        kinds = ["small_on_large"]
    if method in ("taylor", "runge_kutta"):
        kinds += ["finite_stretch"]
    if finite:
        kinds = ["finite_stretch"]
    kind = str(rng.choice(kinds))
    if kind == "none":
        return {"kind": kind}
    springs = {
        "kind": kind,
        "stiffness": _near(rng, 35.0),
        "stretch": float(rng.uniform(1.0, 3.0)),
    }
    if kind == "finite_stretch":
        nearest = 1.05 / springs["stretch"] if finite else 1.5
        springs["rest_length"] = abs(offset) * float(rng.uniform(nearest, 10.0))
    return springs


def _interface(rng: np.random.Generator, method: str) -> Values:
    kinds = ["none", "viscous", "viscous"]
    if method in ("taylor", "runge_kutta"):
        kinds += ["dry_friction", "dry_friction"]
    kind = "dry_friction" if method == "switched" else str(rng.choice(kinds))
    if kind != "dry_friction":
        return {"kind": kind} | ({"damping": _near(rng, 0.3, 2.0)} if kind == "viscous" else {})
    static = _near(rng, 0.5)
    return {
        "kind": kind,
        "static_coefficient": static,
        "kinetic_coefficient": static * float(rng.uniform(0.1, 1.0)),
        "reference_velocity": _near(rng, 0.2),
        "slip_damping": float(rng.random() < 0.5) * _near(rng, 0.1),
        "normal_force": _near(rng, 0.4),
    }


def _actuation(
    rng: np.random.Generator, springs: Values, force: float, step: float, *, is_plain: bool
) -> Values:
    """Return actuators; a stretch begins within its limits."""
    actuation: Values = {}
    if rng.random() < 0.5:
        actuation["force"] = {"limit": force} | _slow(rng, force, step)
    if springs["kind"] != "none" and (is_plain or rng.random() < 0.4):
        low, high = springs["stretch"], springs["stretch"] + float(rng.uniform(0.1, 2.0))
        actuation["stretch"] = {"minimum": low, "maximum": high} | _slow(rng, high - low, step)
    return actuation


def _slow(rng: np.random.Generator, reach: float, step: float) -> Values:
    """Return rate limit and lag of an actuator, if any."""
    slow: Values = {}
    if rng.random() < 0.5:
        slow["rate_limit"] = _near(rng, reach / step)
    if rng.random() < 0.5:
        slow["lag"] = _near(rng, step)
    return slow


class _Size(NamedTuple):
    """What excitations are to match: a scene's mass, stiffness, displacement, rate and step."""

    m1: float
    k1: float
    x1: float
    rate: float
    step: float

    @property
    def fastest(self) -> float:
        """The highest frequency [rad/s] that control steps are divided for."""
        return 0.25 * MOST_INTERVALS / self.step


def _excitations(
    rng: np.random.Generator, size: _Size, file: Path, *, is_plain: bool = False
) -> list[Values]:
    """Return no excitation, one, some, or all kinds at once, of the springs' size or less."""
    if is_plain:
        kinds = [kind for kind in ("harmonic", "impulse") if rng.random() < 0.6]
    else:
        mode = rng.random()
        share = 0.0 if mode < 0.1 else 1.0 if mode > 0.6 else float(rng.choice([0.15, 0.4]))
        kinds = [kind for kind in EXCITATIONS if rng.random() < share]
    parts: list[Values] = []
    for kind in kinds:
        target = "force" if is_plain else str(rng.choice(["force", "ground"]))
        unit = size.k1 if target == "force" else size.k1 / size.m1
        amplitude = unit * size.x1 * float(10.0 ** rng.uniform(-2.0, 0.0))
        part = {"kind": kind, "target": target}
        parts.append(part | _part(rng, kind, amplitude, size, file))
    return parts


def _part(rng: np.random.Generator, kind: str, amplitude: float, size: _Size, file: Path) -> Values:
    """Return the numbers of an excitation."""
    if kind == "harmonic":
        frequency, phase = _near(rng, size.rate), float(rng.uniform(0.0, 6.0))
        return {"amplitude": amplitude, "frequency": frequency, "phase": phase}
    if kind == "sweep":
        return _sweep(rng, amplitude, size)
    if kind == "impulse":
        return _impulse(rng, amplitude / size.rate, size.step)
    if kind == "record":
        return _record(rng, amplitude, size.step, file)
    return _noise(rng, kind, amplitude, size)


def _impulse(rng: np.random.Generator, jump: float, step: float) -> Values:
    part: Values = {"size": jump, "rate": float(rng.integers(0, 2)) * _near(rng, 0.3 / step)}
    if part["rate"] == 0.0 or rng.random() < 0.5:
        part["time"] = step * STEPS * float(rng.uniform(0.0, 1.0))
    if rng.random() < 0.5:
        part["size"] = (-jump, jump)
    return part


def _sweep(rng: np.random.Generator, amplitude: float, size: _Size) -> Values:
    """Return a slow or fast sweep, up or down."""
    first = min(_near(rng, size.rate, 1.5), 2.0 * size.fastest)
    last = min(_near(rng, size.rate, 1.5), 2.0 * size.fastest)
    if rng.random() < 0.2:
        last = first * (1.0 + _near(rng, 1e-6, 5.0))
    return {
        "amplitude": amplitude,
        "start_frequency": first,
        "end_frequency": last,
        "duration": size.step * float(10.0 ** rng.uniform(-2.0, 4.0)),
        "spacing": str(rng.choice(["linear", "logarithmic"])),
        "phase": float(rng.uniform(0.0, 6.0)),
    }


def _noise(rng: np.random.Generator, kind: str, rms: float, size: _Size) -> Values:
    frequency, step = min(_near(rng, size.rate), size.fastest), size.step
    part: Values = {"rms": rms}
    if kind == "noise":
        low = float(rng.random() < 0.5) * frequency * float(rng.uniform(0.01, 0.9))
        part |= {"high_frequency": frequency, "low_frequency": low}
    else:
        part |= {"ground_frequency": frequency, "ground_damping": float(rng.uniform(0.1, 0.9))}
    if kind == "clough_penzien":
        low = frequency * float(10.0 ** rng.uniform(-2.0, 0.0))
        part |= {"filter_frequency": low, "filter_damping": float(rng.uniform(0.1, 0.9))}
    if rng.random() < 0.5:
        part |= {
            "rise": _near(rng, step),
            "plateau": _near(rng, step),
            "decay": _near(rng, 1 / step),
        }
    if rng.random() < 0.7:  # else as fine as the noise asks for
        part["sample_time"] = step / float(rng.integers(1, MOST_INTERVALS))
    return part


def _record(rng: np.random.Generator, size: float, step: float, file: Path) -> Values:
    """Write a record of some control steps, of even spacing or not; return the part."""
    count = int(rng.integers(3, 60))
    times = np.arange(count) * float(10.0 ** rng.uniform(-1.5, 0.5)) * step
    if rng.random() < 0.5:
        times[1:] += 0.4 * times[1] * rng.uniform(-1.0, 1.0, count - 1)
    values = size * rng.standard_normal(count)
    file.write_text(
        "".join(f"{t!r},{x!r}\n" for t, x in zip(times.tolist(), values.tolist(), strict=True))
    )
    part: Values = {"file": str(file), "scale": float(rng.uniform(-1.0, 1.0))}
    if rng.random() < 0.5:
        part |= {
            "time_scale": _near(rng, 1.0, 0.5),
            "start": float(rng.uniform(0.0, 0.5) * times[-1]),
        }
    return part


def _with_device(rng: np.random.Generator, file: Path) -> tuple[Scene, Plant]:
    """Return a random scene with a device, and its plant."""
    for _ in range(TRIES):
        try:
            scene = _device(rng, file)
            plant = compile_scene(scene)
        except (SceneError, CompileError):
            continue
        return scene, plant
    msg = f"no scene with a device in {TRIES} tries"
    raise RuntimeError(msg)


def _device(rng: np.random.Generator, file: Path) -> Scene:
    """Return a scene with one or more devices.

    They are plain springs, with a cubic term or without; a force between the masses; a damping
    under control, of the interface or of the carriage; and interfaces in value form, of which the
    magnetorheological one may be driven by a voltage.
    """
    x, rate, m1 = _near(rng, 0.01), _near(rng, 60.0), _near(rng, 0.1)
    m2, k1, pull = m1 * float(10.0 ** rng.uniform(-1.5, 0.3)), m1 * rate**2, m1 * rate**2 * x
    step = float(10.0 ** rng.uniform(-2.0, 0.7) / rate)
    is_linear = rng.random() < 0.4
    springs = _device_springs(rng, x, k1, is_linear=is_linear)
    interface = _device_interface(rng, x, rate, pull, is_linear=is_linear)
    data: Values = {
        "carriage": {
            "mass": m1,
            "stiffness": k1,
            "damping": float(rng.random() < 0.7) * _near(rng, 0.05 * m1 * rate),
            "linear_coefficient": float(rng.choice([1.0, 1.0, 1.0, 0.0])),
            "cubic_coefficient": float(not is_linear) * rng.integers(2) * _near(rng, x**-2),
        },
        "sphere": {"mass": m2},
        "springs": springs,
        "interface": interface,
        "initial": {
            "carriage_displacement": [-x, x],
            "sphere_offset": [-x, x],
            "carriage_velocity": [-x * rate, x * rate],
            "sphere_velocity": [-x * rate, x * rate],
        },
        "control": {"time_step": step, "steps": 1_000_000},
        "solver": {"tolerance": float(10.0 ** rng.uniform(-11.0, -1.0))},
    }
    if rng.random() < 0.2:
        data["initial"] = {}  # from rest
    data["actuation"] = _device_actuation(rng, data, pull, step)
    data["excitation"] = _excitations(rng, _Size(m1, k1, x, rate, step), file)
    data["randomization"] = _drawn(rng, data)
    has_device = springs["kind"] == "linear" or interface["kind"] in VALUED
    if not (has_device or {"damping", "voltage"} & set(data["actuation"])) and (
        data["actuation"].get("force", {}).get("between") != "masses"
    ):
        return _device(rng, file)
    return Scene(**data)


def _device_springs(rng: np.random.Generator, x: float, k1: float, *, is_linear: bool) -> Values:
    kinds = ["none", "linear", "linear", "small_on_large", "finite_stretch"]
    kind = str(rng.choice(kinds[:-1] if is_linear else kinds))
    if kind == "none":
        return {"kind": kind}
    springs: Values = {"kind": kind, "stiffness": _near(rng, 0.1 * k1)}
    if kind == "linear":
        hardens = float(not is_linear) * rng.integers(2)
        return springs | {"cubic_coefficient": hardens * _near(rng, x**-2)}
    springs["stretch"] = float(rng.uniform(1.0, 3.0))
    if kind == "finite_stretch":
        springs["rest_length"] = x * float(rng.uniform(3.0, 20.0))
    return springs


def _device_interface(
    rng: np.random.Generator, x: float, rate: float, pull: float, *, is_linear: bool
) -> Values:
    """Return an interface whose force is of the carriage spring's size."""
    kinds = ["none", "viscous", "viscous", "dry_friction", *VALUED, VALUED[-1]]
    kind = str(rng.choice(kinds[:4] if is_linear else kinds))
    v, load = x * rate, pull * float(10.0 ** rng.uniform(-1.5, 0.3))
    if kind == "none":
        return {"kind": kind}
    if kind == "viscous":
        return {"kind": kind, "damping": load / v}
    if kind == "bouc_wen":
        yielding = x * float(10.0 ** rng.uniform(-1.5, 0.5))
        return {
            "kind": kind,
            "stiffness": load / yielding,
            "yield_displacement": yielding,
            "stiffness_ratio": float(rng.uniform(0.0, 1.0)),
            "exponent": float(rng.choice([1.0, 2.0, rng.uniform(1.0, 4.0)])),
            "shape": float(rng.uniform(0.5, 1.2)),
            "damping": float(rng.random() < 0.5) * load / v,
        }
    if kind == "magnetorheological":
        return {"kind": kind} | _damper(rng, x, v, load)
    friction = {
        "kind": kind,
        "static_coefficient": 0.3,
        "kinetic_coefficient": 0.3 * float(rng.uniform(0.3, 1.0)),
        "reference_velocity": v * float(10.0 ** rng.uniform(-1.5, 0.0)),
        "slip_damping": float(rng.random() < 0.5) * 0.1 * load / v,
        "normal_force": load,
    }
    if kind == "stribeck":
        friction["stribeck_velocity"] = v * float(10.0 ** rng.uniform(-1.5, 0.5))
    return friction


def _damper(rng: np.random.Generator, x: float, v: float, load: float) -> Values:
    """Return the numbers of a magnetorheological damper: its yield force, and what it is at."""
    gain, largest = _near(rng, 50.0), x * float(10.0 ** rng.uniform(-1.0, 0.5))
    gamma = gain / largest**2
    share, series = float(rng.uniform(0.0, 0.9)), _near(rng, load / v)
    return {
        "voltage": float(rng.uniform(0.0, 1.0)),
        "damping": 0.3 * series * float(rng.uniform(0.0, 1.0)),
        "damping_per_volt": 0.1 * series * float(rng.uniform(0.0, 1.0)),
        "series_damping": series,
        "series_damping_per_volt": series * float(rng.uniform(0.0, 1.0)),
        "hysteresis": (1.0 - share) * load / largest,
        "hysteresis_per_volt": share * load / largest,
        "stiffness": load / x * float(10.0 ** rng.uniform(-2.0, 0.0)),
        "accumulator_stiffness": load / x * float(10.0 ** rng.uniform(-3.0, -1.0)),
        "accumulator_offset": x * float(rng.choice([0.0, 1.0])),
        "gain": gain,
        "gamma": gamma,
        "beta": gamma * float(rng.uniform(-0.9, 0.9)),
    }


def _device_actuation(rng: np.random.Generator, data: Values, pull: float, step: float) -> Values:
    actuation: Values = {}
    if rng.random() < 0.5:
        between = str(rng.choice(["ground", "masses", "masses"]))
        actuation["force"] = {"limit": pull, "between": between} | _slow(rng, pull, step)
    if "stretch" in data["springs"] and rng.random() < 0.4:
        low, high = data["springs"]["stretch"], data["springs"]["stretch"] + 1.0
        actuation["stretch"] = {"minimum": low, "maximum": high} | _slow(rng, 1.0, step)
    kind, mode = data["interface"]["kind"], rng.random()
    if kind == "magnetorheological" and mode < 0.7:
        actuation["voltage"] = {"lag": 0.0, "maximum": 2.25} | _slow(rng, 1.0, step)
    elif mode < 0.5:
        of = "carriage" if kind != "viscous" or rng.random() < 0.5 else "interface"
        now = data[of]["damping"]
        most = 2.0 * now + 1e-3 * pull
        limits = {"of": of, "minimum": now * float(rng.choice([0.0, 0.5])), "maximum": most}
        actuation["damping"] = limits | _slow(rng, most, step)
    return actuation


def _drawn(rng: np.random.Generator, data: Values) -> Values:
    """Return ranges of some of the scene's numbers."""
    if rng.random() < 0.4:
        return {}
    names = [
        f"{part}.{field}"
        for part in ("carriage", "sphere", "interface", "springs")
        for field, value in data[part].items()
        if isinstance(value, float) and value > 0.0
    ]
    if "stretch" in data["actuation"]:
        names.remove("springs.stretch")
    names = [name for name in names if name != "interface.kinetic_coefficient"]
    names += [
        f"excitation.{k}.{field}"
        for k, part in enumerate(data.get("excitation", []))
        for field, value in part.items()
        if isinstance(value, float)
        and value > 0.0
        and field not in ("sample_time", "low_frequency")
    ]
    count = min(len(names), int(rng.choice([1, 1, 2, 4, 8])))
    values = {name: _number(data, name) for name in rng.choice(names, count, replace=False)}
    spread = float(10.0 ** rng.uniform(-3.0, -0.3))
    return {str(name): (value, value * (1.0 + spread)) for name, value in values.items()}


def _number(data: Any, name: str) -> float:
    for key in name.split("."):
        data = data[int(key)] if key.isdigit() else data[key]
    return float(data)
