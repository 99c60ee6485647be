"""Kernels: compiled when first called, anew with any file that they take code from, and plain without numba."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path
from types import FunctionType
from typing import Any, cast

import pytest

from schwung import compiled
from schwung.drivetrain import kernel, learned, physics
from schwung.estimation.rivals import augmented, ekf


@compiled.compiled
def double(x: float) -> float:
    return 2 * x


@compiled.compiled
def four_times(x: float) -> float:
    return double(double(x))


def _of(function: Any) -> set[str]:
    return compiled.files_of(cast(FunctionType, function.py_func))


def test_a_kernel_may_call_another() -> None:
    assert four_times(1.5) == 6.0
    made = cast(Any, four_times).dispatcher
    assert len(made.signatures) == 1
    assert compiled.stamp(cast(Any, four_times).py_func) in made._cache._cache_file._source_stamp


def test_the_stamp_covers_what_a_kernel_calls() -> None:
    files = {str(Path(cast(str, room.__file__))) for room in (kernel, learned, physics)}
    assert files <= _of(learned.run_learned)
    assert _of(kernel.run) == {kernel.__file__}
    assert _of(ekf._filter) == {ekf.__file__, augmented.__file__}


def test_nothing_is_imported_before_a_kernel_is_called() -> None:
    told = "import sys, schwung; schwung.estimate; schwung.commission; sys.exit('numba' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", told], check=False).returncode == 0


@pytest.mark.skipif(not compiled.IS_FAST, reason="nothing is compiled")
def test_compiling_is_no_part_of_the_time_that_a_computation_takes() -> None:
    import numba  # noqa: PLC0415  (not there where nothing is compiled)

    double(1.0)  # from now on it is heeded
    began, taken = time.thread_time(), compiled.computing_s()
    numba.njit(lambda x: x + 1.0)(1.0)  # no cache has it
    whole, computed = time.thread_time() - began, compiled.computing_s() - taken
    assert computed < whole / 2
