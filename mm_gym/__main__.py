"""The command line: `python -m mm_gym`."""

# ruff: noqa: T201 - a command line prints

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Callable, Sequence
from importlib.metadata import version
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

from gymnasium.error import DependencyNotInstalled

from mm_gym.errors import ERRORS, CompileError, DesignError, SceneError, check_name, refuse
from mm_gym.files import check_outputs
from mm_gym.plant.compile import compile_findings, compile_scene
from mm_gym.plant.rigs import over_rigs
from mm_gym.records import ACCELERATION_UNITS, FORCE_UNITS, read_record
from mm_gym.scene.excitation import Recorded
from mm_gym.scene.scene import Scene
from mm_gym.scene.schema import scene_schema
from mm_gym.scene.toml_file import check_scene, load_scene, toml_of
from mm_gym.simulation.simulate import simulate
from mm_gym.tasks import ids, is_id, path_of, task_or_scene

if TYPE_CHECKING:
    from mm_gym.analysis import ResponseSpectrum
    from mm_gym.simulation.trajectory import Trajectory

FAILED = 2  # exit status after an error, that of argparse too


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit status; an error is one message on standard error."""
    options = _parser().parse_args(arguments)
    try:
        if "scene" in options:
            options.scene = _named(options.scene)
        options.run(options)
    except (*ERRORS, DependencyNotInstalled) as error:
        print(f"error: {error}", file=sys.stderr)
        return FAILED
    return 0


def _named(given: str | list[str]) -> str | list[str]:
    """Return scene files as they are, and the ids of tasks, whose names may be short."""
    if isinstance(given, list):
        return [text if Path(text).exists() else task_or_scene(text) for text in given]
    return given if Path(given).exists() else task_or_scene(given)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m mm_gym", description="Vibration control by a moving mass."
    )
    parser.add_argument("--version", action="version", version=f"mm-gym {version('mm-gym')}")
    commands = parser.add_subparsers(required=True, metavar="command")
    for name, run, text in (
        ("validate", _validate, "check scene files, and print every finding"),
        ("explain", _explain, "say which model a scene compiles to, and why"),
        ("rigs", _rigs, "print a scene file whose episodes draw the uncertain parameters of a rig"),
        ("simulate", _simulate, "simulate one episode without an agent, and print how it ends"),
        ("tune", _tune, "find the stretch and damping that suit a scene best"),
        ("render", _render, "draw one episode without an agent as PNG, or as video (.mp4)"),
        ("work-precision", _work_precision, "measure error against time, and recommend settings"),
    ):
        command = commands.add_parser(name, help=text, description=text)
        many = "+" if name == "validate" else None
        command.add_argument("scene", metavar="TASK or SCENE.toml", nargs=many)
        command.set_defaults(run=run)
        if name == "simulate":
            _add_options(command)
        if name == "tune":
            _add_tuning(command)
        if name == "render":
            command.add_argument("--out", metavar="FILE", required=True)
            command.add_argument("--seed", type=_seed, default=0, metavar="N")
            command.add_argument("--steps", type=_count, metavar="N", help="control steps")
        if name == "work-precision":
            command.add_argument("--out", metavar="DIR", help="write CSV table and PNG figure")
            command.add_argument("--seed", type=_seed, default=0, metavar="N")
            lanes = "lanes stepped side by side where costs are measured; by default 1"
            command.add_argument("--lanes", type=int, default=1, metavar="N", help=lanes)
    text = "compile what scenes need, all tasks by default, and keep it for later processes"
    command = commands.add_parser("warm", help=text, description=text)
    command.add_argument("scene", metavar="TASK or SCENE.toml", nargs="*")
    command.set_defaults(run=_warm)
    text = "print the response spectrum of a recorded ground acceleration"
    command = commands.add_parser("spectrum", help=text, description=text)
    _add_spectrum(command)
    text = "print the JSON schema of scene files, for editors"
    command = commands.add_parser("schema", help=text, description=text)
    command.set_defaults(run=_schema)
    text = "draw the paper's figures, and one of a bistable carriage; compare the paper's numbers"
    command = commands.add_parser("paper", help=text, description=text)
    command.add_argument("--figure", metavar="NAME", help="one figure only, such as fig10")
    command.add_argument("--out", metavar="DIR", required=True)
    command.set_defaults(run=_paper)
    return parser


def _add_options(simulate: argparse.ArgumentParser) -> None:
    text = "duration of the simulation [s]; by default an episode"
    simulate.add_argument("--duration", type=float, metavar="SECONDS", help=text)
    text = "seed of the scene's draws; by default 0"
    simulate.add_argument("--seed", type=_seed, default=0, metavar="N", help=text)
    simulate.add_argument("--csv", metavar="FILE", help="write the trajectory")
    simulate.add_argument("--plot", metavar="FILE", help="draw it as PNG; needs the extra `plot`")


def _add_tuning(tune: argparse.ArgumentParser) -> None:
    text = "force or ground; by default what the scene's excitation moves"
    tune.add_argument("--excitation", metavar="NAME", help=text)
    text = "what is kept small; by default carriage_displacement"
    tune.add_argument("--channel", metavar="NAME", default="carriage_displacement", help=text)
    text = "h_infinity (the default), h2 or stability"
    tune.add_argument("--criterion", metavar="NAME", default="h_infinity", help=text)
    text = "of the harmonic [N, or m/s^2], for dry friction; by default that of the scene's own"
    tune.add_argument("--amplitude", type=float, metavar="A", help=text)
    text = "write the tuned scene, and its frequency response as PNG; needs the extra `plot`"
    tune.add_argument("--out", metavar="DIR", help=text)


def _add_spectrum(spectrum: argparse.ArgumentParser) -> None:
    spectrum.add_argument(
        "file", metavar="FILE", help="of PEER, text in columns, .mat, .npy or .npz"
    )
    text = "of the samples, such as g or m/s^2; by default g for PEER's format"
    spectrum.add_argument("--unit", metavar="UNIT", help=text)
    text = "between the samples, if no column has times"
    spectrum.add_argument("--time-step", type=float, metavar="SECONDS", help=text)
    spectrum.add_argument("--column", metavar="N or NAME", help="with the samples, from 1")
    spectrum.add_argument("--skip", type=int, default=0, metavar="N", help="lines at the beginning")
    spectrum.add_argument("--variable", metavar="NAME", help="of a .mat or .npz file")
    text = "natural periods; by default 241 from 0.01 to 10 s"
    spectrum.add_argument("--periods", type=float, nargs="+", metavar="SECONDS", help=text)
    text = "damping ratios; by default 0.05"
    spectrum.add_argument(
        "--damping", type=float, nargs="+", default=[0.05], metavar="Z", help=text
    )
    spectrum.add_argument("--csv", metavar="FILE", help="write all numbers")
    spectrum.add_argument("--plot", metavar="FILE", help="draw it as PNG; needs the extra `plot`")
    spectrum.set_defaults(run=_spectrum)


def _integer(name: str, least: int) -> Callable[[str], int]:
    """Return what reads an integer, with its name in argparse's message: invalid seed value."""

    def read(text: str) -> int:
        if int(text) < least:
            raise ValueError
        return int(text)

    read.__name__ = name
    return read


_seed, _count = _integer("seed", 0), _integer("count", 1)


def _validate(options: argparse.Namespace) -> None:
    problems: list[str] = []
    for scene in options.scene:
        try:
            compile_scene(check_scene(scene, compile_findings))
            print(f"{scene}: valid")
        except SceneError as error:
            problems.append(str(error))
        except CompileError as error:
            problems.append(f"{scene}: {error}")
    if problems:
        raise SceneError("\n".join(problems))


def _schema(options: argparse.Namespace) -> None:  # noqa: ARG001 - all commands take options
    print(scene_schema(), end="")


def _explain(options: argparse.Namespace) -> None:
    print(compile_scene(load_scene(options.scene)).explain())


def _rigs(options: argparse.Namespace) -> None:
    print(toml_of(over_rigs(load_scene(options.scene)), Path.cwd()), end="")


def _simulate(options: argparse.Namespace) -> None:
    scene = load_scene(options.scene)
    _check_files(options, _inputs(options.scene, scene))
    trajectory = simulate(scene, duration=options.duration, seed=options.seed)
    work = trajectory.work
    rows = [
        ("time", trajectory.time[-1], "s"),
        *zip(("x1", "x2", "v1", "v2"), trajectory.state[-1], ("m", "m", "m/s", "m/s"), strict=True),
        ("energy", trajectory.energy[-1], "J"),
        *((name, getattr(work, name)[-1], "J") for name in ("disturbance", "dissipated")),
    ]
    print("\n".join(f"{name:12}{value: .9e} {unit}" for name, value, unit in rows))
    for name, file in trajectory.records.items():
        print(f"{name}: {file}")
    _write_files(options, trajectory)


def _spectrum(options: argparse.Namespace) -> None:
    from mm_gym.analysis import response_spectrum  # noqa: PLC0415 - other commands do not need it

    _check_files(options, [options.file])
    column = options.column
    record = read_record(
        options.file,
        unit=options.unit,
        time_step=options.time_step,
        column=int(column) if column is not None and re.fullmatch("[0-9]{1,9}", column) else column,
        skip=options.skip,
        variable=options.variable,
    )
    if options.unit in FORCE_UNITS:
        refuse("--unit", f"{options.unit!r}", ", ".join(ACCELERATION_UNITS))
    spectrum = response_spectrum(record, options.periods, options.damping)
    print(spectrum.table())
    _write_files(options, spectrum)


def _warm(options: argparse.Namespace) -> None:
    from mm_gym.simulation.simulate import warm  # noqa: PLC0415 - other commands do not need it

    names: list[str] = options.scene or ids()
    scenes = [(name, load_scene(name)) for name in names]
    total = 0.0
    for count, (name, scene) in enumerate(scenes, 1):
        print(f"{count}/{len(scenes)} {name}: ", end="", flush=True)
        seconds = warm(scene)
        print(f"{seconds:.1f} s", flush=True)
        total += seconds
    print(f"compiled, {total:.1f} s in total")


def _tune(options: argparse.Namespace) -> None:
    from mm_gym.tuning import friction_absorber, tune  # noqa: PLC0415 - it imports SciPy's optimisers

    scene = load_scene(options.scene)
    outputs = _checked_outputs(options, scene, ["tuned.toml", "response.png"])
    path = {"excitation": options.excitation, "channel": options.channel}
    if scene.interface.kind == "dry_friction":
        if options.criterion != "h_infinity":
            msg = f"--criterion: got {options.criterion!r}; allowed for dry friction: 'h_infinity'"
            raise DesignError(msg)
        found = friction_absorber(scene, amplitude=options.amplitude, **path)
    elif options.amplitude is not None:
        msg = "--amplitude: no effect, because the optimum depends on it under dry friction only"
        raise DesignError(msg)
    else:
        found = tune(scene, criterion=options.criterion, **path)
    print(found.table())
    if outputs:
        found.plot(outputs[1])
        found.to_toml(outputs[0])


def _render(options: argparse.Namespace) -> None:
    from mm_gym.rendering.episode import draw_episode  # noqa: PLC0415 - nothing else needs it

    scene = load_scene(options.scene)
    check_outputs([options.out], _inputs(options.scene, scene))
    draw_episode(scene, options.out, seed=options.seed, steps=options.steps)


def _work_precision(options: argparse.Namespace) -> None:
    from mm_gym.precision import work_precision  # noqa: PLC0415 - it imports SciPy's integrators

    scene = load_scene(options.scene)
    outputs = _checked_outputs(options, scene, ["work_precision.csv", "work_precision.png"])
    result = work_precision(scene, seed=options.seed, lanes=options.lanes)
    print(f"{result.table()}\n\n{result.recommendations()}")
    if outputs:
        result.to_csv(outputs[0])
        result.plot(outputs[1])


def _paper(options: argparse.Namespace) -> None:
    from mm_gym.paper.figures import FIGURES, draw  # noqa: PLC0415 - the slowest import
    from mm_gym.paper.table import printed, rows, write_table  # noqa: PLC0415

    if options.figure is not None:
        check_name("--figure", options.figure, FIGURES)
    names = list(FIGURES) if options.figure is None else [options.figure]
    *figures, table = _in_folder(options.out, [*(f"{name}.png" for name in names), "numbers.csv"])
    check_outputs([*figures, table])
    for name, figure in zip(names, figures, strict=True):
        draw(name, figure)
        print(figure)
    if options.figure is None:
        numbers = rows()
        write_table(table, numbers)
        print(table)
        print(printed(numbers))


def _check_files(options: argparse.Namespace, inputs: Sequence[str | Path]) -> None:
    check_outputs([path for path in (options.csv, options.plot) if path is not None], inputs)
    if options.plot is not None and Path(options.plot).suffix.lower() != ".png":
        refuse("--plot", repr(options.plot), "a file whose name ends in .png")


def _write_files(options: argparse.Namespace, result: Trajectory | ResponseSpectrum) -> None:
    if options.csv is not None:
        result.to_csv(options.csv)
    if options.plot is not None:
        result.plot(options.plot)


def _inputs(path: str, scene: Scene) -> list[str | Path]:
    """Return the files that a command reads: a scene's own, and its records'."""
    records = [source.paths for source in scene.excitation if isinstance(source, Recorded)]
    return [path_of(path) if is_id(path) else path, *chain.from_iterable(records)]


def _checked_outputs(options: argparse.Namespace, scene: Scene, names: Sequence[str]) -> list[Path]:
    """Return the files to write to ``--out``, none without it; refuse what cannot be written."""
    if options.out is None:
        return []
    outputs = _in_folder(options.out, names)
    check_outputs(outputs, _inputs(options.scene, scene))
    return outputs


def _in_folder(folder: str, names: Sequence[str]) -> list[Path]:
    if not folder:
        refuse("--out", "''", "the path of a folder")
    return [Path(folder) / name for name in names]


if __name__ == "__main__":
    sys.exit(main())
