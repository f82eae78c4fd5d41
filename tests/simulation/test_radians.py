"""A model in degrees, as MuJoCo takes one that does not say, is the same robot as one in rad."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from twin_daemon.hand import load_hand
from twin_daemon.simulation.radians import in_radians
from twin_daemon.simulation.terms import EffectTerm, Terms
from twin_daemon.simulation.twin import TwinModel

_ANY = """
<mujoco>
  <compiler eulerseq="zyx"/>
  <default>
    <joint range="-30 60" limited="true" springref="12"/>
    <default class="turned"><geom euler="0 30 0"/></default>
  </default>
  <worldbody>
    <body euler="90 10 0">
      <frame euler="0 90 0">
        <geom size=".1" axisangle="0 0 1 90"/>
        <geom class="turned" type="capsule" size=".1 .2"/>
      </frame>
      <inertial mass="1" pos="0 0 0" euler="90 0 20" diaginertia="1 1 1.5"/>
      <joint name="j" ref="20" stiffness="1"/>
      <joint name="s" type="slide" axis="1 0 0" range="-.3 .2" ref=".1" springref=".05"/>
      <site euler="90 0 30"/>
      <camera euler="90 0 0"/>
      <body axisangle="0 1 0 45">
        <joint type="ball" name="ball" range="0 40" springref="0"/>
        <geom size=".1" mass="1"/>
      </body>
    </body>
  </worldbody>
  <actuator><position joint="j" kp="1" inheritrange="1"/></actuator>
  <tendon><fixed limited="true" range="-1 1"><joint joint="j" coef="1"/></fixed></tendon>
</mujoco>
"""

_ARM = """
<mujoco model="arm">
  <compiler angle="{0}"/>
  <worldbody>
    <body>
      <inertial mass="1" pos="0.1 0 0" diaginertia=".1 .1 .1"/>
      <joint name="j" axis="0 0 1" range="{1} {2}" limited="true" damping="1" springref="{3}" stiffness="3"/>
    </body>
  </worldbody>
  <actuator><position name="j" joint="j" kp="50"/></actuator>
</mujoco>
"""


def test_the_compiled_model_stays_what_it_was() -> None:
    spec = mujoco.MjSpec.from_string(_ANY)
    before = spec.compile()
    in_radians(spec)
    for after in (spec.compile(), mujoco.MjSpec.from_string(spec.to_xml()).compile()):
        for name in (
            "jnt_range",
            "qpos0",
            "qpos_spring",
            "body_quat",
            "body_iquat",
            "geom_quat",
            "site_quat",
            "cam_quat",
        ):
            np.testing.assert_allclose(getattr(after, name), getattr(before, name), atol=1e-5, err_msg=name)


@pytest.mark.parametrize(
    "terms",
    [
        Terms(parameters={"j.range_upper": 0.3, "j.springref": 0.2}),
        *(
            Terms(effects=(EffectTerm(effect=key, target="j", values=values),))
            for key, values in (
                ("joint_stop", {"upper": 0.8}),
                ("dead_zone", {"band": 0.03}),
                ("backlash", {"gap": 0.05}),
            )
        ),
    ],
    ids=lambda terms: "+".join((*terms.parameters, *(one.effect for one in terms.effects))),
)
def test_what_is_added_to_it_is_in_rad_as_well(tmp_path: Path, terms: Terms) -> None:
    moved = []
    for unit, turn in (("degree", 1.0), ("radian", np.pi / 180.0)):
        path = tmp_path / f"{unit}.xml"
        path.write_text(_ARM.format(unit, -60 * turn, 60 * turn, 10 * turn))
        twin = TwinModel.load(load_hand(model=path)).changed(terms)
        data = mujoco.MjData(twin.model)
        data.ctrl[:] = 0.9
        mujoco.mj_step(twin.model, data, 400)
        moved.append(data.qpos.copy())
    np.testing.assert_allclose(*moved, atol=1e-9)
