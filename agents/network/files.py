"""Files of policies: arrays and a JSON text in safetensors' format. Reading one runs no code."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
import safetensors.numpy
from numpy.typing import NDArray
from safetensors import SafetensorError

from agents.network.arrays import arrays_in, described
from mm_gym.files import parse_json

Arrays = dict[str, NDArray[Any]]

LARGEST = 64 * 2**20
"""Size of a file [bytes], and of what it unpacks to; a policy of two layers of 64 has 40 kB."""

ENDINGS = (".safetensors", ".npz")
"""Of files of policies; those with the second are of earlier versions, NumPy's archives."""

ARCHIVE = b"PK"  # what NumPy's archives begin with


class PolicyError(RuntimeError):
    """A policy cannot be read, or does not suit the scene."""


def content_of(description: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> bytes:
    """Return the content of a file of a description and arrays."""
    # In the order of their names, so that the same policy is the same file.
    ordered = {name: np.ascontiguousarray(arrays[name]) for name in sorted(arrays)}
    return safetensors.numpy.save(ordered, {"description": json.dumps(description)})


def read_content(content: bytes) -> tuple[dict[str, Any], Arrays]:
    """Return the description and the arrays in the content of a file.

    Raise `ValueError` if it is damaged, or holds anything but a description and arrays.
    """
    if content.startswith(ARCHIVE):
        arrays = arrays_in(content, most=LARGEST)
        return described(arrays), arrays
    try:
        arrays = safetensors.numpy.load(content)
    except (SafetensorError, KeyError, ValueError, TypeError) as error:
        msg = f"not in safetensors' format: {error}"
        raise ValueError(msg) from None
    header = parse_json(content[8 : 8 + int.from_bytes(content[:8], "little")].decode())
    told = header.get("__metadata__", {}) if isinstance(header, dict) else {}
    return described({"description": np.array(told.get("description", ""))}), arrays
