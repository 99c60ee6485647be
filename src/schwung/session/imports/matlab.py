"""MATLAB files: version 5 to 7.2 through scipy, 7.3 (which is HDF5) through h5py; structs are flattened by dots."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from schwung.errors import InputError
from schwung.session.imports.table import Column, Table

_MAX_SIGNALS = 4096  # of one matrix; more are data of another kind


def read_matlab(path: Path) -> Table:
    """Read every numeric variable of a MAT file. Vectors become columns, matrices `name[:,k]` (`name[k,:]` where
    signals are rows), scalars numbers.

    Raises InputError where it is not a MAT file or holds no numbers.
    """
    try:
        variables = dict(_version_73(path) if h5py.is_hdf5(path) else _version_5(path))
    except InputError:
        raise
    except Exception as error:  # scipy and h5py raise nearly anything for damaged files
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(str(path), f"is not a readable MAT file ({reason})", "Save it again.") from error
    columns: list[Column] = []
    numbers: dict[str, float] = {}
    for name, value in variables.items():
        if value.size == 1:
            numbers[name] = float(value.ravel()[0])
        elif value.ndim == 1 or min(value.shape) == 1:
            columns.append(Column(name, value.ravel().astype(np.float64)))
        elif value.ndim == 2 and value.shape[1] <= value.shape[0]:
            columns += [Column(f"{name}[:,{k}]", each.astype(np.float64)) for k, each in enumerate(value.T)]
        elif value.ndim == 2 and value.shape[0] <= _MAX_SIGNALS:
            columns += [Column(f"{name}[{k},:]", each.astype(np.float64)) for k, each in enumerate(value)]
    if not columns:
        raise InputError(
            str(path), "holds no vectors or matrices of numbers", "Give the file with the samples."
        )
    return Table(path, tuple(columns), numbers, described="MAT")


def _version_5(path: Path) -> Iterator[tuple[str, Any]]:
    from scipy.io import loadmat  # noqa: PLC0415  (slow to import, and most imports are text)

    for name, value in loadmat(path, struct_as_record=True, squeeze_me=False).items():
        if not name.startswith("__"):
            yield from _flatten(name, value)


def _flatten(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    """Numeric arrays of a variable, structs (record arrays) and cells included."""
    if not isinstance(value, np.ndarray) or value.size == 0:
        return
    if value.dtype.names:
        for index, record in enumerate(value.ravel()):
            where = name if value.size == 1 else f"{name}[{index}]"
            for key in value.dtype.names:
                yield from _flatten(f"{where}.{key}", record[key])
    elif value.dtype == object:
        for index, item in enumerate(value.ravel()):
            yield from _flatten(name if value.size == 1 else f"{name}[{index}]", item)
    elif value.dtype.kind in "fiub":
        yield name, value


def _text(value: Any) -> str:
    return value.decode() if isinstance(value, bytes) else str(value)


def _version_73(path: Path) -> Iterator[tuple[str, Any]]:
    found: dict[str, Any] = {}

    def visit(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and item.dtype.kind in "fiub" and item.size and "#" not in name:
            if item.attrs.get("MATLAB_class", b"") in (b"char", "char", b"cell", "cell"):
                return
            found[name.replace("/", ".")] = item[()].T  # MATLAB stores by columns

    with h5py.File(path, "r") as file:
        if "format" in file.attrs:
            raise InputError(str(path), f"is a {_text(file.attrs['format'])} already", "Use it as it is.")
        file.visititems(visit)
    yield from found.items()
