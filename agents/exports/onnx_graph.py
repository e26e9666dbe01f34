"""A policy as an ONNX graph, built operator by operator from its arrays.

One builder serves evolved policies and those of every algorithm, and needs onnx alone. Exporting
the modules of torch would need torch and onnxscript besides, and know nothing of correlation units.

Inputs are ``observation`` (lanes, n), float, and, of a policy with memory, ``state``, double, as
`Policy.begin` returns it; outputs ``action`` (lanes, k), float, and ``next_state``. The arithmetic
between them is in double precision, as NumPy's is.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium.error import DependencyNotInstalled

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from agents.policies import Policy

OPSET, FORMAT = 17, 8
"""Versions of operators and file, of 2022: runtimes since read them."""

BOUND = 3.0
"""From where on the rational activation is 1."""


def onnx_bytes(policy: Policy, comment: str = "") -> bytes:
    """Return the content of a policy's ONNX file.

    Parameters
    ----------
    comment
        What is noted in the file.

    Raises
    ------
    DependencyNotInstalled
        If onnx is missing.
    """
    try:
        import onnx  # noqa: PLC0415 - an extra
    except ImportError as error:
        msg = 'an ONNX file needs onnx, run `pip install "mm-gym[onnx]"`'
        raise DependencyNotInstalled(msg) from error
    graph = _Graph(onnx, policy)
    graph.write()
    model = onnx.helper.make_model(
        graph.whole(),
        opset_imports=[onnx.helper.make_opsetid("", OPSET)],
        ir_version=FORMAT,
        producer_name="mm_gym",
        doc_string=comment,
    )
    return model.SerializeToString()


class _Graph:
    """Operators, each named after its one output, and constants."""

    def __init__(self, onnx: Any, policy: Policy) -> None:  # noqa: ANN401 - onnx has no types
        self.onnx, self.policy = onnx, policy
        self.nodes: list[Any] = []
        self.constants: list[Any] = []

    def add(self, operator: str, *inputs: str | NDArray[Any] | float, **attributes: object) -> str:
        """Append an operator; return its output. Inputs that are numbers become constants."""
        name = f"{operator}_{len(self.nodes)}"
        names = [text if isinstance(text, str) else self._constant(text) for text in inputs]
        self.nodes.append(self.onnx.helper.make_node(operator, names, [name], name, **attributes))
        return name

    def _constant(self, values: NDArray[Any] | float) -> str:
        array = np.asarray(values)
        if array.dtype != np.int64:
            array = array.astype(np.float64)
        name = f"constant_{len(self.constants)}"
        self.constants.append(self.onnx.numpy_helper.from_array(array, name))
        return name

    def rename(self, old: str, new: str) -> None:
        """Make an operator's output an output of the graph."""
        self.nodes.append(self.onnx.helper.make_node("Identity", [old], [new]))

    def write(self) -> None:
        """Append all operators, from the observation to the action."""
        policy, double = self.policy, self.onnx.TensorProto.DOUBLE
        inputs = self.add("Cast", "observation", to=double)
        proposed = None
        if policy.base.size:
            proposed = self.dense(inputs, policy.base[:, :-1], policy.base[:, -1])
            proposed = self.clip(proposed, -1.0, 1.0)
            inputs = self.add("Concat", inputs, proposed, axis=1)
        if policy.units.size or policy.keep.size:
            inputs = self.remembered(inputs)
        if policy.cell:
            inputs = self.recurred(inputs)
        action = self.layers(inputs)
        if proposed is not None:
            added = self.add("Mul", action, policy.authority)
            action = self.clip(self.add("Add", proposed, added), -1.0, 1.0)
        self.rename(self.add("Cast", action, to=self.onnx.TensorProto.FLOAT), "action")

    def dense(self, values: str, weight: NDArray[Any], bias: NDArray[Any]) -> str:
        """Return weight @ values + bias."""
        return self.add("Gemm", values, weight, bias, transB=1)

    def clip(self, values: str, low: NDArray[Any] | float, high: NDArray[Any] | float) -> str:
        """Return values within bounds, which may differ from number to number."""
        return self.add("Min", self.add("Max", values, low), high)

    def layers(self, inputs: str) -> str:
        """Return the clipped output of the layers."""
        policy, values = self.policy, inputs
        for layer, (weight, bias) in enumerate(zip(policy.weights, policy.biases, strict=True)):
            values = self.dense(self.activated(values) if layer else values, weight, bias)
        if policy.direct.size:
            values = self.add("Add", values, self.add("MatMul", inputs, policy.direct.T))
        if policy.squashed:
            values = self.add("Tanh", values)
        return self.clip(values, policy.low, policy.high)

    def activated(self, values: str) -> str:
        """Return what follows a hidden layer."""
        if self.policy.activation != "rational":
            return self.add({"tanh": "Tanh", "relu": "Relu"}[self.policy.activation], values)
        values = self.clip(values, -BOUND, BOUND)
        square = self.add("Mul", values, values)
        over = self.add("Mul", values, self.add("Add", square, 27.0))
        return self.add("Div", over, self.add("Add", self.add("Mul", square, 9.0), 27.0))

    def remembered(self, inputs: str) -> str:
        """Return inputs, linear memory and correlation units, and move the state on."""
        policy, moved = self.policy, list[str]()
        m, rows = len(policy.keep), 2 * len(policy.units)
        if m:
            memory = self.add("Gather", "state", np.arange(rows, rows + m), axis=0)
            entered = self.add("MatMul", policy.enter, self.add("Transpose", inputs, perm=[1, 0]))
            moved.append(self.add("Add", self.add("MatMul", policy.keep, memory), entered))
            told = self.add("Transpose", moved[0], perm=[1, 0])
            inputs = self.add("Concat", inputs, told, axis=1)
        if rows:
            own = self.add("Gather", "state", np.arange(rows), axis=0)
            units, sums = self.correlations(inputs, own)
            inputs, moved = self.add("Concat", inputs, units, axis=1), [sums, *moved]
        self.rename(self.add("Concat", *moved, axis=0), "next_state")
        return inputs

    def correlations(self, inputs: str, sums: str) -> tuple[str, str]:
        """Return the correlation units (lanes, r), and their sums (2 r, lanes) moved on."""
        memory, floor, offset, scale = self.policy.units.T
        a, b = (self.add("MatMul", inputs, self.policy.pairs[:, side].T) for side in (0, 1))
        product = self.add("Mul", self.add("Mul", a, b), 2.0)
        square = self.add("Add", self.add("Mul", a, a), self.add("Mul", b, b))
        r = len(self.policy.units)
        by_unit = self.add("Reshape", sums, np.array([r, 2, -1]))
        old = self.add("Transpose", by_unit, perm=[1, 2, 0])
        kept = self.add("Mul", old, memory)
        products, squares = (
            self.add("Add", self.add("Gather", kept, np.int64(side), axis=0), new)
            for side, new in enumerate((product, square))
        )
        part = self.add("Div", products, self.add("Add", squares, floor))
        units = self.add("Mul", self.add("Sub", part, offset), scale)
        moved = self.stacked(products, squares, perm=[2, 0, 1])
        return units, self.add("Reshape", moved, np.array([2 * r, -1]))

    def recurred(self, inputs: str) -> str:
        """Return the output of the LSTM cell, and move the state (2, lanes, h) on."""
        entering, recurrent, bias = self.policy.cell
        state, output = (self.add("Gather", "state", np.int64(i), axis=0) for i in (0, 1))
        gates = self.add(
            "Add", self.dense(inputs, entering, bias), self.add("MatMul", output, recurrent.T)
        )
        h = recurrent.shape[1]
        enter, keep, new, leave = (
            self.add("Gather", gates, np.arange(i * h, (i + 1) * h), axis=1) for i in range(4)
        )
        kept = self.add("Mul", self.add("Sigmoid", keep), state)
        entered = self.add("Mul", self.add("Sigmoid", enter), self.add("Tanh", new))
        state = self.add("Add", kept, entered)
        output = self.add("Mul", self.add("Sigmoid", leave), self.add("Tanh", state))
        self.rename(self.stacked(state, output, perm=[0, 1, 2]), "next_state")
        return output

    def stacked(self, first: str, second: str, perm: list[int]) -> str:
        """Return two arrays (lanes, r) as one (2, lanes, r), with its axes in another order."""
        axis = np.zeros(1, np.int64)
        pair = [self.add("Unsqueeze", values, axis) for values in (first, second)]
        return self.add("Transpose", self.add("Concat", *pair, axis=0), perm=perm)

    def whole(self) -> Any:  # noqa: ANN401 - onnx has no types
        """Return the graph."""
        policy, kind = self.policy, self.onnx.TensorProto
        value = self.onnx.helper.make_tensor_value_info
        observed, *_, k = policy.sizes
        inputs = [value("observation", kind.FLOAT, ["lanes", observed])]
        outputs = [value("action", kind.FLOAT, ["lanes", k])]
        if policy.units.size or policy.keep.size or policy.cell:
            rows = 2 * len(policy.units) + len(policy.keep)
            shape = [2, "lanes", policy.cell[1].shape[1]] if policy.cell else [rows, "lanes"]
            inputs.append(value("state", kind.DOUBLE, shape))
            outputs.append(value("next_state", kind.DOUBLE, shape))
        return self.onnx.helper.make_graph(self.nodes, "policy", inputs, outputs, self.constants)
