"""A graph as C99 that allocates nothing and needs no library but, for some functions, libm."""

import shutil
import subprocess
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined

from agents.network.graph import CHOICE, FUNCTIONS, TABLE, TURNED, Graph, Operation, Signal
from agents.network.interface import Interface, counted
from mm_gym.arrays import Array

CHOSEN = "{} != 0 ? {} : {}"

HELPERS = {
    "hyperbolic(": """static REAL hyperbolic(REAL x) {
    if (sizeof(REAL) == sizeof(float)) return (REAL)tanhf((float)x);
    return (REAL)tanh((double)x);
}""",
    # Of NaN these are NaN, as NumPy's.
    "sign(": "static REAL sign(REAL x) {\n    return x > 0 ? 1 : x < 0 ? -1 : x;\n}",
    "least(": "static REAL least(REAL x, REAL y) {\n    return x < y || x != x ? x : y;\n}",
    "most(": "static REAL most(REAL x, REAL y) {\n    return x > y || x != x ? x : y;\n}",
    "add_products(": """static void add_products(
    const REAL *weight, const REAL *input, REAL *sum, int outputs, int inputs) {
    for (int i = 0; i < outputs; i++)
        for (int j = 0; j < inputs; j++) sum[i] += weight[i * inputs + j] * input[j];
}""",
}
"""By how they are called."""

TEMPLATE = Environment(  # noqa: S701 - it is no HTML
    loader=FileSystemLoader(Path(__file__).parent),
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    keep_trailing_newline=True,
).get_template("policy.c.jinja")

LEAST, LARGEST = float(np.finfo(np.float32).tiny), float(np.finfo(np.float32).max)
"""Positive numbers in single precision."""

CALLS = 200_000  # of a measurement

_MAIN = """
#include <stdio.h>
#include <time.h>
int main(void) {{
    policy_state state;
    REAL observation[{observed}], action[{k}], sum = 0;
    policy_begin(&state);
    const clock_t begun = clock();
    for (int call = 0; call < {calls}; call++) {{
        for (int i = 0; i < {observed}; i++) observation[i] = (REAL)((call + 7 * i) % 13 - 6) / 6;
        policy_act(&state, observation, action);
        sum += action[0];
    }}
    printf("%g %g", (double)(clock() - begun) / CLOCKS_PER_SEC / {calls}, (double)sum);
    return 0;
}}
"""


@dataclass(frozen=True)
class Source:
    """C source, and what it needs."""

    text: str  # the source
    # constants, remembered, working: numbers of each kind: read only, kept from step to step, and
    # on the stack
    constants: int
    remembered: int
    working: int
    products: int  # multiplications with weights in a step


@dataclass
class _Writer:
    """Statements, and the numbers that they work on."""

    statements: list[str] = field(default_factory=list)
    # Names of the tables of constants, by their numbers.
    tables: dict[tuple[str, ...], str] = field(default_factory=dict)
    products: int = 0
    # By operation: the array that its numbers are in, and where they begin there.
    places: dict[Operation, tuple[str, int]] = field(default_factory=dict)
    # Beginning and length of the pieces of working memory that are read again.
    used: dict[Operation, tuple[int, int]] = field(default_factory=dict)
    working: int = 0

    def table(self, values: Array) -> str:
        """Return the name of a table of constants."""
        numbers = tuple(_literal(value) for value in np.ravel(values))
        return self.tables.setdefault(numbers, f"constants_{len(self.tables)}")

    def operand(self, one: Signal | Array) -> str:
        """Return the i-th number of a signal or of a constant."""
        if isinstance(one, Signal):
            return self.element(self.places[one.made_by], one.shape[1])
        if len(np.unique(one)) == 1:
            return _literal(one[0])
        return f"{self.table(one)}[i]"

    def begin(self, signal: Signal) -> str:
        """Return where the numbers of a signal begin."""
        array, first = self.places[signal.made_by]
        return f"{array} + {first}"

    @staticmethod
    def element(place: tuple[str, int], width: int) -> str:
        """Return the i-th of numbers, or the only one."""
        array, begin = place
        return f"{array}[{begin}]" if width == 1 else f"{array}[{f'{begin} + ' if begin else ''}i]"

    def allot(self, operation: Operation) -> None:
        """Give an operation the first piece of working memory that is free and long enough."""
        begin = 0
        for first, length in sorted(self.used.values()):
            if begin + operation.width <= first:
                break
            begin = max(begin, first + length)
        self.used[operation] = begin, operation.width
        self.working = max(self.working, begin + operation.width)
        self.places[operation] = "work", begin

    def write(self, one: Operation) -> None:
        """Append the statements of an operation, whose numbers have a place."""
        place, loop = self.places[one], _loop(one.width)
        if one.name == "concatenate":
            first = 0
            for signal in one.inputs:
                width = signal.shape[1]
                target = self.element((place[0], place[1] + first), width)
                value = self.element(self.places[signal.made_by], width)
                self.statements.append(f"{_loop(width)}{target} = {value};")
                first += width
        elif one.name in {"product", TURNED}:
            signal, weight, *bias = one.inputs if one.name == "product" else one.inputs[::-1]
            begin = self.operand(bias[0]) if bias else "0"
            self.statements.append(f"{loop}{self.element(place, one.width)} = {begin};")
            turns = self.begin(weight) if isinstance(weight, Signal) else self.table(weight)
            made, columns = f"{place[0]} + {place[1]}", signal.shape[1]
            given = f"{turns}, {self.begin(signal)}, {made}, {one.width}, {columns}"
            self.statements.append(f"add_products({given});")
            self.products += one.width * columns
        elif one.name == TABLE:
            index, rows = one.inputs
            row = f"(int){self.operand(index)} * {one.width}"
            value = f"{self.table(rows)}[{row}{'' if one.width == 1 else ' + i'}]"
            self.statements.append(f"{loop}{self.element(place, one.width)} = {value};")
        else:
            form = CHOSEN if one.name == CHOICE else FUNCTIONS[one.name][0]
            value = form.format(*map(self.operand, one.inputs))
            self.statements.append(f"{loop}{self.element(place, one.width)} = {value};")


def _loop(width: int) -> str:
    return "" if width == 1 else f"for (int i = 0; i < {width}; i++) "


def _literal(value: float) -> str:
    size = abs(float(value))
    text = f"(REAL){size!r}"
    near = min(max(size, LEAST), LARGEST)
    if size not in (0.0, near):  # what keeps numbers from 0, or limits nothing
        text = f"(sizeof(REAL) == sizeof(float) ? (REAL){near!r} : {text})"
    return text if value >= 0.0 else f"(-{text})"


def c_source(graph: Graph, interface: Interface | None = None, comment: str = "") -> Source:
    """Return the source of a graph from "observation" and "memory" to "action" and "next_memory".

    It has `policy_begin`, `policy_act` and, with an interface, `policy_act_si`. A comment goes to
    its head.
    """
    writer = _written(graph)
    observed, remembered = (graph.inputs[name].shape[1] for name in ("observation", "memory"))
    kept = max(remembered, 1) + (interface.observed if interface else 0)
    text = TEMPLATE.render(
        observed=observed,
        actions=graph.outputs["action"].shape[1],
        remembered=remembered,
        writer=writer,
        helpers=[text for call, text in HELPERS.items() if call in "".join(writer.statements)],
        interface=interface,
        comment=comment,
        counted=counted,
        literal=_literal,
    )
    return Source(text, sum(map(len, writer.tables)), kept, writer.working, writer.products)


def seconds_of(source: Source, observed: int, actions: int) -> float | None:
    """Return the time of a step on this machine [s], or None without a C compiler that works."""
    compiler = shutil.which("cc")
    if compiler is None:
        return None
    with tempfile.TemporaryDirectory() as folder:
        file, program = Path(folder) / "policy.c", Path(folder) / "policy"
        file.write_text(source.text + _MAIN.format(observed=observed, k=actions, calls=CALLS))
        command = [compiler, "-O2", "-std=c99", str(file), "-o", str(program), "-lm"]
        try:
            subprocess.run(command, check=True, capture_output=True)  # noqa: S603 - our own source
            done = subprocess.run([program], check=True, capture_output=True, text=True)  # noqa: S603
        except (OSError, subprocess.CalledProcessError):  # as of a folder where nothing may be run
            return None
    return float(done.stdout.split()[0])


def _written(graph: Graph) -> _Writer:
    """Return the statements of a graph; working memory is used again once it was read."""
    writer, operations = _Writer(), graph.needed()
    writer.places[graph.inputs["observation"].made_by] = "observation", 0
    writer.places[graph.inputs["memory"].made_by] = "state->memory", 0
    last = {one: len(operations) for one in _sources(graph.outputs.values())}
    for step, operation in reversed(list(enumerate(operations))):
        for one in _sources(operation.inputs):
            last.setdefault(one, step)
    for step, operation in enumerate(operations):
        if operation.name == "slice":
            array, begin = writer.places[operation.inputs[0].made_by]
            writer.places[operation] = array, begin + operation.first
            continue
        writer.allot(operation)
        writer.write(operation)
        writer.used = {one: piece for one, piece in writer.used.items() if last.get(one, 0) > step}
    for name, array in (("action", "action"), ("next_memory", "state->memory")):
        made, width = graph.outputs[name].made_by, graph.outputs[name].shape[1]
        if width:
            value = writer.element(writer.places[made], width)
            line = f"{writer.element((array, 0), width)} = {value};"
            writer.statements.append(_loop(width) + line)
    return writer


def _sources(signals: object) -> list[Operation]:
    """Return the operations whose numbers signals show, also where they show a slice."""
    found = [one.made_by for one in signals if isinstance(one, Signal)]
    for k, operation in enumerate(found):
        while operation.name == "slice":
            operation = operation.inputs[0].made_by  # noqa: PLW2901 - a slice of a slice
        found[k] = operation
    return found
