"""A slider-crank as a multi-body model in MuJoCo: nobody types its inertia in, it follows from the masses.

    motor ─ rotor ─(coupling k, b)─ crank ─ pin ─ rod ─(loop closed by a constraint)─ slider

Plane motion; the shaft is vertical, so gravity does nothing, unless `gravity` lays it flat (x along the slide, y
up). At angle 0 the slider is at its outer dead centre.

Of MuJoCo's integrators Euler (semi-implicit) fits, with the coupling computed outside of it (`crank_kernel`): against
the Lagrangian equations its speed is right to 6e-5 at 62.5 µs, and the coupling is as stiff as asked for to 0.1 %. As
a tendon of MuJoCo's, damped half a step late, it was 1 % too stiff and the rotor 2.5 % too light. `implicitfast`
computes the constraint's force without the coupling's implicit damping and is off by 2 %.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from schwung_sim.errors import BenchError
from schwung_sim.plants.concealed import Concealed, Scale
from schwung_sim.plants.crank_kernel import CRANK, MOTOR, CrankKernel, one_tick
from schwung_sim.plants.effects import PARAMETERS, STATE
from schwung_sim.plants.engine import mujoco
from schwung_sim.plants.native import step_address
from schwung_sim.plants.profile import Array
from schwung_sim.plants.two_mass import TICK_S, TwoMassMachine

#: MuJoCo's steps per control tick; more where the coupling has play or hardens.
_STEPS, _STEPS_HARD = 2, 4
_ROD, _SLIDER, _THIRD = range(2, 5)  # further degrees of freedom
_DIVERGED_RAD_S = 1e5
_STANDARD_GRAVITY = 9.80665


@dataclass(frozen=True)
class SliderCrankMachine:
    """Lengths (m), masses (kg) and inertias about the centre of mass (kg·m²); drive train as Table 1.

    Chosen so that what the crank feels is about the paper's: 0.055 kg·m² at the dead centres, 0.16 between.
    """

    crank_m: float = 0.15
    rod_m: float = 0.6
    crank_inertia_kgm2: float = 0.046
    rod_kg: float = 1.2
    slider_kg: float = 3.9
    drive: TwoMassMachine = field(default_factory=TwoMassMachine)

    @property
    def rod_inertia_kgm2(self) -> float:
        """A slender rod."""
        return self.rod_kg * self.rod_m**2 / 12


def _mjcf(m: SliderCrankMachine, p: Any, gravity: bool) -> str:
    """The model; `p` is the PARAMETERS record with the concealed effects in it."""
    scale = float(p["inertia_scale"])
    crank = scale * m.crank_inertia_kgm2 + float(p["inertia_delta_kgm2"])
    if crank <= 0:
        raise BenchError("load_inertia", f"leaves the crank {crank:.4g} kg·m²", "Give a delta above -0.046.")
    step = float(p["substep_s"])
    third = tendon = ""
    if p["third_inertia_kgm2"] > 0:
        third = f"""
    <body name="third">
      <joint name="third" type="hinge" axis="0 0 1"/>
      <inertial pos="0 0 0" mass="1" diaginertia="{" ".join([f"{p['third_inertia_kgm2']:.17g}"] * 3)}"/>
    </body>"""
        tendon = f"""
  <tendon>
    <fixed name="behind" springlength="0"
           stiffness="{p["third_stiffness_nm_rad"]:.17g}" damping="{p["third_damping_nms"]:.17g}">
      <joint joint="crank" coef="1"/> <joint joint="third" coef="-1"/>
    </fixed>
  </tendon>"""
    rotor, rod = m.drive.rotor_inertia_kgm2, scale * m.rod_inertia_kgm2
    return f"""
<mujoco model="slider-crank">
  <compiler angle="radian" inertiafromgeom="false"/>
  <option timestep="{step:.17g}" integrator="Euler" solver="Newton" iterations="4" tolerance="1e-12"
          jacobian="dense" gravity="0 {-_STANDARD_GRAVITY if gravity else 0.0} 0">
    <flag contact="disable" island="disable" autoreset="disable"/>
  </option>
  <worldbody>
    <body name="rotor">
      <joint name="motor" type="hinge" axis="0 0 1"/>
      <inertial pos="0 0 0" mass="1" diaginertia="{rotor:.17g} {rotor:.17g} {rotor:.17g}"/>
    </body>
    <body name="crank">
      <joint name="crank" type="hinge" axis="0 0 1" damping="{m.drive.load_viscous_nms:.17g}"/>
      <inertial pos="0 0 0" mass="1" diaginertia="{crank:.17g} {crank:.17g} {crank:.17g}"/>
      <body name="rod" pos="{m.crank_m} 0 0">
        <joint name="pin" type="hinge" axis="0 0 1"/>
        <inertial pos="{m.rod_m / 2} 0 0" mass="{scale * m.rod_kg:.17g}"
                  diaginertia="{rod:.17g} {rod:.17g} {rod:.17g}"/>
      </body>
    </body>
    <body name="slider" pos="{m.crank_m + m.rod_m} 0 0">
      <joint name="slide" type="slide" axis="1 0 0"/>
      <inertial pos="0 0 0" mass="{scale * m.slider_kg:.17g}" diaginertia="0.01 0.01 0.01"/>
    </body>{third}
  </worldbody>
  <equality>
    <connect body1="rod" body2="slider" anchor="{m.rod_m} 0 0"
             solref="{2 * step:.17g} 1" solimp="0.9999 0.9999 0.001"/>
  </equality>{tendon}
</mujoco>"""


class SliderCrankPlant:
    """Motor, coupling and slider-crank; starts at rest at angle 0, the outer dead centre (unless shifted)."""

    name = "slider-crank"

    def __init__(
        self,
        machine: SliderCrankMachine | None = None,
        concealed: Concealed | None = None,
        seed: int = 0,
        gravity: bool = False,
    ) -> None:
        self.machine = machine or SliderCrankMachine()
        self.concealed = concealed or Concealed()
        drive = self.machine.drive
        self.parameters = np.zeros(1, PARAMETERS)
        self.state = np.zeros(1, STATE)
        self.state["motion_time_s"] = -1.0
        for name in ("rotor_viscous_nms", "stiffness_nm_rad", "damping_nms"):
            self.parameters[name] = getattr(drive, name)
        scale = Scale(drive.peak_torque_nm, drive.stiffness_nm_rad, drive.damping_nms, inertia_kgm2=0.11)
        load_torque = self.concealed.apply(self.parameters, scale, seed).samples
        self.sensor = self.concealed.sensor(scale)
        p = self.parameters[0]
        steps = _STEPS_HARD if p["gap_rad"] > 0 or p["cubic_nm_rad3"] > 0 else _STEPS
        p["substep_s"] = TICK_S / steps
        self.model = mujoco.MjModel.from_xml_string(_mjcf(self.machine, p, gravity))
        self.data = mujoco.MjData(self.model)
        self._shift = float(p["inertia_shift_rad"])
        self._place(self.data, self._shift)
        self.data.qpos[MOTOR] = self._shift
        if p["third_inertia_kgm2"] > 0:
            self.data.qpos[_THIRD] = self._shift
        self._kernel = CrankKernel(
            addresses=(step_address(), self.model._address, self.data._address),
            steps=steps,
            parameters=self.parameters,
            state=self.state,
            load_torque=load_torque,
            shift_rad=self._shift,
            angle=self.data.qpos,
            speed=self.data.qvel,
            torque=self.data.qfrc_applied,
            twist_speed=np.zeros(1),
        )

    def _place(self, data: Any, crank_rad: float) -> None:
        """Set crank, rod and slider so that the loop is closed."""
        m = self.machine
        across = m.crank_m * math.sin(crank_rad) / m.rod_m
        rod_rad = -math.asin(across)  # against the slide
        data.qpos[CRANK] = crank_rad
        data.qpos[_ROD] = rod_rad - crank_rad
        data.qpos[_SLIDER] = m.crank_m * (math.cos(crank_rad) - 1) + m.rod_m * (math.cos(rod_rad) - 1)

    @property
    def rotor_inertia_kgm2(self) -> float:
        """J_r."""
        return self.machine.drive.rotor_inertia_kgm2

    @property
    def motor_rad(self) -> float:
        """True motor angle."""
        return float(self.data.qpos[MOTOR]) - self._shift

    def begin_motion(self) -> None:
        """A motion starts now: events in it are timed from here, drift counts it."""
        self.state["motion_time_s"] = 0.0
        self.state["motions"] += 1.0

    @property
    def kernel(self) -> CrankKernel:
        """What compiled code needs to step this plant; valid as long as the plant lives."""
        return self._kernel

    def step(self, torque_nm: float) -> None:
        """One control tick (125 µs) with this torque commanded."""
        one_tick(self._kernel, torque_nm)
        self.check()

    def check(self) -> None:
        """Raise BenchError where the integration has diverged."""
        if not abs(self.data.qvel[MOTOR]) < _DIVERGED_RAD_S:
            raise BenchError(
                "plant slider-crank", "has diverged", "Conceal less: smaller torques, softer coupling."
            )

    def true_inertia(self, position_rad: Array) -> Array:
        """J_l (n,) at load angles (n,): vᵀ M v, v what the loop allows the bodies at 1 rad/s of the crank."""
        data = mujoco.MjData(self.model)
        values = []
        for angle in np.atleast_1d(np.asarray(position_rad, dtype=float)) + self._shift:
            self._place(data, float(angle))
            mujoco.mj_forward(self.model, data)
            unit = np.eye(self.model.nv)
            columns = np.zeros((self.model.nv, data.nefc))
            for dof in (CRANK, _ROD, _SLIDER):
                mujoco.mj_mulJacVec(self.model, data, columns[dof], unit[dof])
            follow = np.linalg.lstsq(columns[[_ROD, _SLIDER]].T, -columns[CRANK], rcond=None)[0]
            speed = unit[CRANK] + follow[0] * unit[_ROD] + follow[1] * unit[_SLIDER]
            momentum = np.zeros(self.model.nv)
            mujoco.mj_mulM(self.model, data, momentum, speed)
            values.append(float(speed @ momentum))
        return np.array(values)
