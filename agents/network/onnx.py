"""A graph as an ONNX file.

One table of operators serves networks and controllers alike, and needs onnx alone; torch's exporter
would need torch and onnxscript in addition, and reads modules of torch only.
"""

from typing import Any

import numpy as np

from agents.network.graph import (
    CHOICE,
    COMPARISONS,
    FUNCTIONS,
    TABLE,
    TURNED,
    Graph,
    Operation,
    Signal,
)
from mm_gym.arrays import Array
from mm_gym.extras import optional

OPSET, FORMAT = 17, 8  # versions of operators and file, of 2022: runtimes since read them


def onnx_bytes(graph: Graph, comment: str = "") -> bytes:
    """Return the content of a graph's ONNX file.

    The input "observation" and the output "action" are float (lanes, n), all others double; the
    arithmetic between them is in double precision, as NumPy's is. The comment is noted in the file.
    Raise `DependencyNotInstalled` if onnx is missing.
    """
    onnx = optional("onnx", "an ONNX file needs onnx: install the extra `onnx`")
    file = _File(onnx, graph)
    model = onnx.helper.make_model(
        file.whole(),
        opset_imports=[onnx.helper.make_opsetid("", OPSET)],
        ir_version=FORMAT,
        producer_name="mm_gym",
        doc_string=comment,
    )
    return model.SerializeToString()


class _File:
    """Operators, each named after its one output, and constants."""

    def __init__(self, onnx: Any, graph: Graph) -> None:  # noqa: ANN401 - onnx has no types
        self.onnx, self.graph = onnx, graph
        self.nodes: list[Any] = []
        self.constants: list[Any] = []
        self.names: dict[Operation, str] = {}

    def whole(self) -> Any:  # noqa: ANN401 - onnx has no types
        """Return the graph."""
        kinds, graph = self.onnx.TensorProto, self.graph
        inputs = {name: one for name, one in graph.inputs.items() if one.shape[1]}
        for name, one in inputs.items():
            cast = name if name != "observation" else self.add("Cast", name, to=kinds.DOUBLE)
            self.names[one.made_by] = cast
        for operation in graph.needed():
            self.names[operation] = self.operation(operation)
        outputs = {name: one for name, one in graph.outputs.items() if one.shape[1]}
        for name, one in outputs.items():
            made = self.names[one.made_by]
            made = self.add("Cast", made, to=kinds.FLOAT) if name == "action" else made
            self.nodes.append(self.onnx.helper.make_node("Identity", [made], [name]))
        told = [
            [
                self.onnx.helper.make_tensor_value_info(
                    name,
                    kinds.FLOAT if name in {"observation", "action"} else kinds.DOUBLE,
                    ["lanes", one.shape[1]],
                )
                for name, one in of.items()
            ]
            for of in (inputs, outputs)
        ]
        return self.onnx.helper.make_graph(self.nodes, "policy", *told, self.constants)

    def operation(self, one: Operation) -> str:
        """Append an operation; return its output."""
        given = [
            self.names[value.made_by] if isinstance(value, Signal) else value
            for value in one.inputs
        ]
        if one.name == "slice":
            return self.add("Gather", *given, np.arange(one.first, one.first + one.width), axis=1)
        if one.name == "concatenate":
            return self.add("Concat", *given, axis=1)
        if one.name == "product":
            return self.add("Gemm", *given, transB=1)
        if one.name == TURNED:
            shapes = [-1, one.width, one.inputs[1].shape[1]], [-1, one.inputs[1].shape[1], 1]
            both = [
                self.add("Reshape", *pair)
                for pair in zip(given, map(np.array, shapes), strict=True)
            ]
            return self.add("Reshape", self.add("MatMul", *both), np.array([-1, one.width]))
        return self.choice(one.name, given)

    def choice(self, name: str, given: list[Any]) -> str:
        """Append an operation by what numbers are: truth values, places in a table, or numbers."""
        kinds = self.onnx.TensorProto
        if name == CHOICE:
            return self.add("Where", self.add("Cast", given[0], to=kinds.BOOL), *given[1:])
        if name == TABLE:
            place = self.add("Cast", given[0], to=kinds.INT64)
            return self.add("Gather", given[1], self.add("Reshape", place, np.array([-1])), axis=0)
        if name == "arccos":  # runtimes have it in single precision alone
            return self.add(
                "Cast", self.add("Acos", self.add("Cast", *given, to=kinds.FLOAT)), to=kinds.DOUBLE
            )
        made = self.add(FUNCTIONS[name][1], *given)
        if name == "not_equal":
            made = self.add("Not", made)
        return self.add("Cast", made, to=kinds.DOUBLE) if name in COMPARISONS else made

    def add(self, operator: str, *inputs: str | Array, **attributes: object) -> str:
        """Append an operator; return its output. Inputs that are numbers become constants."""
        name = f"{operator}_{len(self.nodes)}"
        names = [text if isinstance(text, str) else self._constant(text) for text in inputs]
        self.nodes.append(self.onnx.helper.make_node(operator, names, [name], name, **attributes))
        return name

    def _constant(self, array: Array) -> str:
        name = f"constant_{len(self.constants)}"
        self.constants.append(self.onnx.numpy_helper.from_array(np.ascontiguousarray(array), name))
        return name
