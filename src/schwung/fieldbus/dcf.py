"""Device configuration files (DCF, CiA 306): parameter values on paper, for tools that load them into drives."""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from pathlib import Path

import canopen
from canopen.objectdictionary.eds import export_dcf

from schwung.errors import InputError
from schwung.fieldbus.drive import Parameter, ParameterValue
from schwung.fieldbus.eds import find_parameter, load_dictionary
from schwung.files import replace_file


def dictionary_lookup(eds_path: Path, node_id: int) -> Callable[[int, int], Parameter]:
    """Look parameters up in an EDS, without a drive. Raises InputError where the EDS lacks one."""
    dictionary = load_dictionary(eds_path, node_id)

    def lookup(index: int, subindex: int) -> Parameter:
        found = find_parameter(dictionary, index, subindex)
        if found is None:
            raise InputError(
                str(eds_path),
                f"has no object 0x{index:04X}:{subindex:02X}",
                "Correct the profile or take another EDS.",
            )
        return found

    return lookup


def write_dcf(eds_path: Path, node_id: int, values: Sequence[ParameterValue], path: Path) -> None:
    """Write the EDS's dictionary as a DCF in which these parameters carry a ParameterValue.

    Raises InputError where the EDS lacks a parameter or the file cannot be written.
    """
    dictionary = load_dictionary(eds_path, node_id)
    dictionary.node_id = node_id
    for value in values:
        variable = _variable(dictionary, value.parameter, eds_path)
        variable.value = value.raw
        variable.value_raw = None
    text = io.StringIO()
    export_dcf(dictionary, text, {"FileName": path.name})
    replace_file(path, text.getvalue())


def _variable(
    dictionary: canopen.ObjectDictionary, parameter: Parameter, eds_path: Path
) -> canopen.objectdictionary.ODVariable:
    if find_parameter(dictionary, parameter.index, parameter.subindex) is None:
        raise InputError(str(eds_path), f"has no object {parameter.label}", "Take the EDS of this drive.")
    entry = dictionary.indices[parameter.index]
    return entry[parameter.subindex] if hasattr(entry, "subindices") else entry
