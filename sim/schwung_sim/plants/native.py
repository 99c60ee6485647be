"""MuJoCo's own step, called by address from compiled code: its Python binding costs more than half a step."""

from __future__ import annotations

import ctypes
from pathlib import Path
from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from schwung_sim.errors import BenchError
from schwung_sim.plants.engine import mujoco

_LIBRARIES = ("libmujoco*.so*", "libmujoco*.dylib", "mujoco.dll")


def step_address() -> int:
    """Where mj_step(model, data) begins, in the very library that MuJoCo's Python binding has loaded.

    Raises BenchError where a MuJoCo package hides it elsewhere than those from PyPI do.
    """
    folders = [Path(folder) for folder in mujoco.__path__]
    for library in (file for folder in folders for name in _LIBRARIES for file in sorted(folder.glob(name))):
        address = ctypes.cast(ctypes.CDLL(str(library)).mj_step, ctypes.c_void_p).value
        if address:
            return address
    raise BenchError("plant slider-crank", f"finds no MuJoCo library in {folders[0]}", "pip install mujoco.")


@intrinsic
def call_step(context: Any, step: Any, model: Any, data: Any) -> Any:
    """Compiled: step(model, data), all three addresses."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        word = arguments[0].type
        function = ir.FunctionType(ir.VoidType(), [word, word])  # a pointer is passed as a word of its size
        builder.call(builder.inttoptr(arguments[0], function.as_pointer()), arguments[1:])
        return context.get_dummy_value()

    return types.void(types.intp, types.intp, types.intp), generate
