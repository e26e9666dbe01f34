"""Files of policies, read and written without the code under test."""

import json

import numpy as np
from safetensors import safe_open
from safetensors.numpy import load_file, save_file


def read(path):
    """Return the arrays of a file, and its description as one of them, as the archives have it."""
    if path.read_bytes().startswith(b"PK"):
        with np.load(path) as archive:
            return dict(archive)
    with safe_open(path, "numpy") as file:
        return load_file(path) | {"description": np.array(file.metadata()["description"])}


def write(path, arrays):
    """Write arrays in the format of the file that is there; text only NumPy's archives can hold."""
    own = {name: array for name, array in arrays.items() if name != "description"}
    holds_text = any(array.dtype.kind not in "fi" for array in own.values())
    if path.read_bytes().startswith(b"PK") or holds_text:
        with path.open("wb") as file:  # np.savez would add an ending
            np.savez(file, **arrays)
        return
    own = {name: np.array(array, order="C") for name, array in own.items()}
    save_file(own, path, {"description": str(arrays["description"])})


def change(path, **changes):
    """Change entries of a file's description."""
    arrays = read(path)
    description = json.loads(str(arrays["description"])) | changes
    write(path, arrays | {"description": np.array(json.dumps(description))})
