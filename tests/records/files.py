"""Record files that the tests write and read."""

import io

import h5py
import numpy as np
from scipy.io import savemat

from mm_gym.records import read_record

TITLE = ["PEER NGA STRONG MOTION DATABASE RECORD", "El Centro 5/19/1940, ARRAY #9, 270"]
QUANTITY = "ACCELERATION TIME SERIES IN UNITS OF G"
COUNTS = [
    "NPTS={n:7d}, DT={dt} SEC",
    "NPTS=  {n}, DT=   {dt} SEC,",
    "NPTS={n},DT={dt}SEC",
    "npts = {n} , dt = {dt} sec",
    "DT= {dt} SEC, NPTS= {n}",
    "NPTS= {n}, DT= {dt}",
    "  {n}   {dt}  NPTS, DT",
    "{n}, {dt}, NPTS,DT",
]


def peer(values, *, counts=COUNTS[0], dt=".0050", columns=5, form="{:15.7E}", newline="\n"):
    """Return an AT2 file as PEER writes it."""
    cells = [form.format(value) for value in values]
    rows = ["".join(cells[i : i + columns]) for i in range(0, len(cells), columns)]
    head = [*TITLE, QUANTITY, counts.format(n=len(cells), dt=dt)]
    return newline.join([*head, *rows]) + newline


def read(folder, content, name="motion.at2", unit="g", **options):
    file = folder / name
    file.write_bytes(content if isinstance(content, bytes) else content.encode())
    return read_record(file, unit=unit, **options)


SAMPLES = [0.001, -0.0234567, 0.5, -1.25, 3e-7, 0.0, -0.1]
GOOD = peer(SAMPLES)


def numpy_archive(arrays, *, compressed=False):
    """Return an .npz file."""
    stream = io.BytesIO()
    (np.savez_compressed if compressed else np.savez)(stream, **arrays)
    return stream.getvalue()


def matlab(arrays, *, compressed=False):
    """Return a MATLAB file of version 5, as SciPy writes it."""
    stream = io.BytesIO()
    savemat(stream, arrays, do_compression=compressed)
    return stream.getvalue()


def numpy_array(arrays):
    """Return an .npy file of the only array."""
    (array,) = arrays.values()
    stream = io.BytesIO()
    np.save(stream, array)
    return stream.getvalue()


def matlab73(arrays, *, compressed=False, classes=()):
    """Return a MATLAB file of version 7.3 as MATLAB writes it: HDF5 behind 512 bytes of text.

    Structs, which are dictionaries, are groups.
    """
    stream = io.BytesIO()
    options = {"chunks": True, "compression": "gzip", "shuffle": True} if compressed else {}

    def write(group, arrays):
        for name, array in arrays.items():
            if isinstance(array, dict):
                one = group.create_group(name)
                one.attrs["MATLAB_class"] = np.bytes_("struct")
                write(one, array)
            else:
                one = group.create_dataset(name, data=np.atleast_2d(array).T, **options)
                one.attrs["MATLAB_class"] = np.bytes_(dict(classes).get(name, "double"))

    with h5py.File(stream, "w", userblock_size=512) as file:
        write(file, arrays)
    return b"MATLAB 7.3 MAT-file".ljust(512) + stream.getvalue()[512:]
