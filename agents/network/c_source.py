"""A graph as C99 that allocates nothing and needs no library but, for some functions, libm."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from agents.network.graph import Graph, Operation, Signal, Values
from agents.network.interface import Interface

FUNCTIONS = {
    "tanh": "hyperbolic({})",
    "negative": "-{}",
    "absolute": "(REAL)fabs((double){})",
    "sqrt": "(REAL)sqrt((double){})",
    "add": "{} + {}",
    "subtract": "{} - {}",
    "multiply": "{} * {}",
    "divide": "{} / {}",
    "minimum": "least({}, {})",
    "maximum": "most({}, {})",
}
"""Of numbers, those of `agents.network.graph.UNARY` and `BINARY`."""

HELPERS = {
    "hyperbolic(": """static REAL hyperbolic(REAL x) {
    if (sizeof(REAL) == sizeof(float)) return (REAL)tanhf((float)x);
    return (REAL)tanh((double)x);
}""",
    "least(": "static REAL least(REAL x, REAL y) {\n    return x < y ? x : y;\n}",
    "most(": "static REAL most(REAL x, REAL y) {\n    return x > y ? x : y;\n}",
    "add_products(": """static void add_products(
    const REAL *weight, const REAL *input, REAL *sum, int outputs, int inputs) {
    for (int i = 0; i < outputs; i++)
        for (int j = 0; j < inputs; j++) sum[i] += weight[i * inputs + j] * input[j];
}""",
}
"""By how they are called."""


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

    def table(self, values: Values) -> str:
        """Return the name of a table of constants."""
        numbers = tuple(_literal(value) for value in np.ravel(values))
        return self.tables.setdefault(numbers, f"constants_{len(self.tables)}")

    def operand(self, one: Signal | Values) -> str:
        """Return the i-th number of a signal or of a constant."""
        if isinstance(one, Signal):
            return self.element(self.places[one.made_by], one.shape[1])
        if len(np.unique(one)) == 1:
            return _literal(one[0])
        return f"{self.table(one)}[i]"

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
        elif one.name == "product":
            signal, weight, *bias = one.inputs
            begin = self.operand(bias[0]) if bias else "0"
            self.statements.append(f"{loop}{self.element(place, one.width)} = {begin};")
            given, made = (f"{a} + {i}" for a, i in (self.places[signal.made_by], place))
            sizes = f"{one.width}, {weight.shape[1]}"
            self.statements.append(f"add_products({self.table(weight)}, {given}, {made}, {sizes});")
            self.products += weight.size
        else:
            value = FUNCTIONS[one.name].format(*map(self.operand, one.inputs))
            self.statements.append(f"{loop}{self.element(place, one.width)} = {value};")


def _table(numbers: tuple[str, ...], name: str) -> str:
    rows = ",\n    ".join(", ".join(numbers[i : i + 6]) for i in range(0, len(numbers), 6))
    return f"static const REAL {name}[{len(numbers)}] = {{\n    {rows}\n}};"


def _loop(width: int) -> str:
    return "" if width == 1 else f"for (int i = 0; i < {width}; i++) "


def _literal(value: float) -> str:
    return f"(REAL){float(value)!r}" if value >= 0.0 else f"(-(REAL){-float(value)!r})"


def c_source(graph: Graph, interface: Interface | None = None, comment: str = "") -> Source:
    """Return the source of a graph from "observation" and "memory" to "action" and "next_memory".

    It has `policy_begin`, `policy_act` and, with an interface, `policy_act_si`.

    Parameters
    ----------
    comment
        What is said at its head in addition.
    """
    writer = _written(graph)
    observed, remembered = (graph.inputs[name].shape[1] for name in ("observation", "memory"))
    frames = interface.observed if interface else 0
    state = [f"REAL memory[{max(remembered, 1)}];"]
    state += [f"REAL frames[{frames}];"] if interface else []
    act = [
        "void policy_act(policy_state *state, const REAL *observation, REAL *action) {",
        f"    REAL work[{writer.working}];" if writer.working else "",
        "" if remembered else "    (void)state;",
        *(f"    {line}" for line in writer.statements),
        "}",
    ]
    body = "\n".join(line for line in act if line)
    helpers = [text for call, text in HELPERS.items() if call in body]
    k = graph.outputs["action"].shape[1]
    parts = [
        _head(observed, k, interface, comment),
        *(_table(numbers, name) for numbers, name in writer.tables.items()),
        f"typedef struct {{ {' '.join(state)} }} policy_state;",
        *helpers,
        "void policy_begin(policy_state *state) {",
        f"    for (int i = 0; i < {max(remembered, 1)}; i++) state->memory[i] = 0;",
        f"    for (int i = 0; i < {frames}; i++) state->frames[i] = 0;" if interface else "",
        "}",
        body,
        _act_si(interface) if interface else "",
    ]
    return Source(
        "\n".join(part for part in parts if part) + "\n",
        sum(map(len, writer.tables)),
        max(remembered, 1) + frames,
        writer.working,
        writer.products,
    )


def seconds_of(source: Source, observed: int, actions: int) -> float | None:
    """Return the time of a step on this machine [s], or None without a C compiler."""
    compiler = shutil.which("cc")
    if compiler is None:
        return None
    with tempfile.TemporaryDirectory() as folder:
        file, program = Path(folder) / "policy.c", Path(folder) / "policy"
        file.write_text(source.text + _MAIN.format(observed=observed, k=actions, calls=CALLS))
        command = [compiler, "-O2", "-std=c99", str(file), "-o", str(program), "-lm"]
        subprocess.run(command, check=True, capture_output=True)  # noqa: S603 - our own source
        done = subprocess.run([program], check=True, capture_output=True, text=True)  # noqa: S603
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


def _head(observed: int, k: int, interface: Interface | None, comment: str) -> str:
    told = [
        f"A policy of mm_gym: {observed} observed numbers to {k} actions in [-1, 1].",
        "",
        "policy_begin(&state) at an episode's start, policy_act(&state, observation, action) in",
        "each control step. REAL is float unless the compiler is told otherwise: -DREAL=double.",
    ]
    if interface:
        told += [
            "",
            "policy_act_si(&state, measured, t, command) has SI units; t [s] is the time since the",
            "episode's start, and at 0 the episode begins.",
            *interface.told,
        ]
    told += ["", comment] if comment else []
    lines = "\n   ".join(told).replace("\n   \n", "\n\n")
    return f"""/* {lines} */
#include <math.h>
#ifndef REAL
#define REAL float
#endif
"""


def _act_si(interface: Interface) -> str:
    channels, k = len(interface.channels), len(interface.commands)
    older = interface.observed - channels
    moved = f"state->frames[i] = state->frames[i + {channels}];"
    scaled = [
        f"    frame[{i}] = (measured[{i}] - {_literal(c.zero)}) * {_literal(c.factor)};"
        for i, c in enumerate(interface.channels)
    ]
    commands = [
        f"    command[{i}] = {_literal(0.5 * (c.high + c.low))} + "
        f"{_literal(0.5 * (c.high - c.low))} * action[{i}];"
        for i, c in enumerate(interface.commands)
    ]
    lines = [
        "void policy_act_si(policy_state *state, const REAL *measured, REAL t, REAL *command) {",
        f"    REAL frame[{channels}], action[{k}];",
        *scaled,
        f"    if (t < {_literal(0.5 * interface.time_step)}) {{",
        "        policy_begin(state);",
        f"        for (int i = 0; i < {interface.observed}; i++)",
        f"            state->frames[i] = frame[i % {channels}];",
        "    }",
        f"    for (int i = 0; i < {older}; i++) {moved}" if older else "",
        f"    for (int i = 0; i < {channels}; i++) state->frames[{older} + i] = frame[i];",
        "    policy_act(state, state->frames, action);",
        *commands,
        "}",
    ]
    return "\n".join(line for line in lines if line)
