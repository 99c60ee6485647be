"""A process of its own in which an FMU is played: what crashes or hangs there is not us.

`python -m schwung.simulators.player FOLDER` reads `request.json` and `jobs.npz` there and writes `answer.npz`, or
`failure.json`. It prints a line for each job that is done; a job that takes too long ends the process.

A forward FMU (torque in) follows the wanted motion: the torque that is expected, and what brings it back to the motion,
position and speed. So it stays near the recording however wrong it is, and what it took is the torque that it needs.
"""

from __future__ import annotations

import faulthandler
import json
import sys
import traceback
from pathlib import Path
from typing import Any

import numpy as np

from schwung.motion import Array

#: What a line on stdout begins with that is ours: an FMU may print, too.
MARK = "\x02schwung "
#: Exit code where the FMU does not come back.
LONGEST_JOB_S = 120.0
#: Before a run: to where it begins, and until what that has set swinging has died away (s).
_APPROACH_S, _SETTLE_S = 0.3, 0.05
#: Angle within which an FMU stands where the run begins (rad, m).
_THERE = 1e-6


class _Fmu:
    """An instance, in SI: initialised at a time and an angle, stepped, asked."""

    def __init__(
        self, folder: str, told: Any, request: dict[str, Any], begin: float, angle: float | None
    ) -> None:
        import fmpy
        from fmpy.simulation import apply_start_values

        self.request, self.is_3 = request, told.fmiVersion.startswith("3")
        self.exchange = request["interface"] == "model-exchange"
        self.told = told
        kind = "ModelExchange" if self.exchange else "CoSimulation"
        self.fmu = fmpy.instantiate_fmu(folder, told, fmi_type=kind, require_functions=False)
        left = apply_start_values(self.fmu, told, dict(request["parameters"]))
        if left:
            raise ValueError(f"the parameters {', '.join(left)} cannot be set")
        if request["start"] is not None and angle is not None:
            self.set("start", angle)
        if self.is_3:
            self.fmu.enterInitializationMode(startTime=begin)
        else:
            self.fmu.setupExperiment(startTime=begin)
            self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()
        if self.exchange:
            self._integrate(begin)

    def set(self, name: str, value: float) -> None:
        """Set one variable."""
        port = self.request[name]
        if port is not None:
            write = self.fmu.setFloat64 if self.is_3 else self.fmu.setReal
            write([port["reference"]], [value / port["factor"]])

    def get(self, name: str) -> float:
        """One variable."""
        port = self.request[name]
        read = self.fmu.getFloat64 if self.is_3 else self.fmu.getReal
        return float(port["factor"] * read([port["reference"]])[0])

    def step(self, time: float, duration: float) -> None:
        """So much further."""
        if self.exchange:
            self._advance(time, time + duration)
        elif self.is_3:
            done = self.fmu.doStep(currentCommunicationPoint=time, communicationStepSize=duration)
            if done[1]:
                raise ValueError("the FMU asks to end the simulation")
        else:
            self.fmu.doStep(currentCommunicationPoint=time, communicationStepSize=duration)

    def close(self) -> None:
        """End it."""
        self.fmu.terminate()
        self.fmu.freeInstance()

    # ── model exchange ───────────────────────────────────────────────────────────────────────────────────────────

    def _integrate(self, begin: float) -> None:
        from fmpy.sundials import CVodeSolver

        self.next_event = np.inf
        self._discrete()
        slope = self.fmu.getContinuousStateDerivatives if self.is_3 else self.fmu.getDerivatives

        class Held:
            """Inputs are held over a step."""

            def apply(self, time: float) -> None:
                """Nothing changes."""

        self.solver = CVodeSolver(
            nx=self.told.numberOfContinuousStates,
            nz=self.told.numberOfEventIndicators,
            get_x=self.fmu.getContinuousStates,
            set_x=self.fmu.setContinuousStates,
            get_dx=slope,
            get_z=self.fmu.getEventIndicators,
            get_nominals=self.fmu.getNominalsOfContinuousStates,
            set_time=self.fmu.setTime,
            input=Held(),
            startTime=begin,
            relativeTolerance=self.request["tolerance"],
            maxNumSteps=5000,
        )

    def _discrete(self) -> None:
        """The discrete states after an event, in event mode; then continuous time."""
        more = True
        while more:
            update = self.fmu.updateDiscreteStates if self.is_3 else self.fmu.newDiscreteStates
            more, ends, _, _, defined, at = update()
            if ends:
                raise ValueError("the FMU asks to end the simulation")
            self.next_event = at if defined else np.inf
        self.fmu.enterContinuousTimeMode()

    def _advance(self, time: float, until: float) -> None:
        self.fmu.setTime(time)
        self.solver.reset(time)
        tiny = 1e-12 * max(1.0, abs(until))
        while until - time > tiny:
            goal = min(until, self.next_event)
            if goal - time > tiny:
                happened, _, time = self.solver.step(time, goal)
                self.fmu.setTime(time)
            else:
                happened = True
            ends = False
            if self.told.modelExchange.needsCompletedIntegratorStep:
                asked, ends = self.fmu.completedIntegratorStep()[:2]
                happened = happened or asked
            if ends:
                raise ValueError("the FMU asks to end the simulation")
            if happened or self.next_event - time <= tiny:
                self.fmu.enterEventMode()
                self._discrete()
                self.solver.reset(time)


def _answered(fmu: _Fmu, job: dict[str, Array], begin: float, step: float) -> dict[str, Array]:
    """Angle and speed at every instant, and the torque over each step that follows."""
    if fmu.request["inverse"]:
        return _asked(fmu, job, begin, step)
    angle, speed, expected = job["angle"], job["speed"], job["torque"]
    stiff, damp = float(job["gains"][0]), float(job["gains"][1])
    n = expected.size
    at, fast, torque = np.empty(n + 1), np.empty(n + 1), np.empty(n)
    knows_speed = fmu.request["speed"] is not None
    before = fmu.get("position")
    for j in range(n + 1):
        at[j] = here = fmu.get("position")
        fast[j] = moving = fmu.get("speed") if knows_speed else (here - before) / step
        before = here
        if j == n:
            break
        torque[j] = expected[j] + stiff * (angle[j] - here) + damp * (speed[j] - moving)
        fmu.set("torque", float(torque[j]))
        fmu.step(begin + j * step, step)
    if not knows_speed:
        fast = np.gradient(at, step)
    return {"angle": at, "speed": fast, "torque": torque}


def _asked(fmu: _Fmu, job: dict[str, Array], begin: float, step: float) -> dict[str, Array]:
    """The same of an inverse FMU, to which the motion is prescribed: what it says of the middle of each step."""
    angle, speed, acceleration = job["angle"], job["speed"], job["acceleration"]
    torque = np.empty(angle.size - 1)
    for j in range(torque.size):
        middle = 0.5 * (angle[j] + angle[j + 1]) + step / 8 * (speed[j] - speed[j + 1])
        fmu.set("position", float(middle))
        fmu.set("speed", float(0.5 * (speed[j] + speed[j + 1])))
        fmu.set("acceleration", float(0.5 * (acceleration[j] + acceleration[j + 1])))
        if fmu.exchange:
            torque[j] = fmu.get("torque")
        fmu.step(begin + j * step, step)
        if not fmu.exchange:
            torque[j] = fmu.get("torque")
    return {"angle": angle, "speed": speed, "torque": torque}


def _led_in(job: dict[str, Array], step: float, from_angle: float) -> tuple[dict[str, Array], int]:
    """The job with the way to its beginning before it, and that way's steps."""
    first = float(job["angle"][0])
    far = abs(first - from_angle) > _THERE
    if not np.any(job["gains"]):  # the torque alone acts, wherever it stands
        return job, 0
    steps = round(((_APPROACH_S if far else 0.0) + _SETTLE_S) / step)
    moving = round(_APPROACH_S / step) if far else 0
    share = np.clip(np.arange(steps) / max(moving, 1), 0.0, 1.0)
    way = from_angle + (first - from_angle) * share**3 * (10 - 15 * share + 6 * share**2)
    fast = np.gradient(way, step) if steps > 1 else np.zeros(steps)
    lead = {
        "angle": way,
        "speed": fast,
        "acceleration": np.gradient(fast, step) if steps > 1 else fast,
        "torque": np.full(steps, job["torque"][0]),
    }
    whole = {name: np.concatenate([lead[name], job[name]]) for name in lead}
    return whole | {"gains": job["gains"]}, steps


def _play(folder: str, told: Any, request: dict[str, Any], job: dict[str, Array]) -> dict[str, Array]:
    begin, step = (float(x) for x in job["clock"])
    first = float(job["angle"][0])
    here = first
    if not request["inverse"]:
        look = _Fmu(folder, told, request, begin, first)
        here = look.get("position")
        look.close()
    whole, steps = _led_in(job, step, here)
    begin -= steps * step
    fmu = _Fmu(folder, told, request, begin, first)
    try:
        played = _answered(fmu, whole, begin, step)
    finally:
        fmu.close()
    return {name: values[steps:] for name, values in played.items()}


def main(folder: Path) -> None:
    """Play every job."""
    faulthandler.enable()
    request = json.loads((folder / "request.json").read_text(encoding="utf-8"))
    jobs = np.load(folder / "jobs.npz")
    answers: dict[str, Array] = {}
    try:
        import fmpy

        unpacked = fmpy.extract(request["fmu"], unzipdir=str(folder / "unpacked"))
        told = fmpy.read_model_description(unpacked, validate=False)
        for number in range(request["jobs"]):
            faulthandler.dump_traceback_later(LONGEST_JOB_S, exit=True)
            names = [name for name in jobs.files if name.startswith(f"{number}/")]
            job = {name.partition("/")[2]: jobs[name] for name in names}
            played = _play(unpacked, told, request, job)
            answers |= {f"{number}/{name}": values for name, values in played.items()}
            print(f"{MARK}{number + 1}", flush=True)
        faulthandler.cancel_dump_traceback_later()
    except Exception as error:  # whatever the FMU or FMPy raise is told by the parent
        said = {"what": f"{error}" or type(error).__name__, "trace": traceback.format_exc()}
        (folder / "failure.json").write_text(json.dumps(said), encoding="utf-8")
        return
    np.savez(folder / "answer.npz", allow_pickle=False, **answers)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
