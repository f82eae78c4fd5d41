"""A twin that goes to another process is the same there to the last bit."""

from __future__ import annotations

import pickle
from collections.abc import Callable

import mujoco
import numpy as np
import pytest

from twin_daemon.effects import LIBRARY
from twin_daemon.hand import load_hand
from twin_daemon.simulation.parameters import KINDS
from twin_daemon.simulation.submodel import submodel
from twin_daemon.simulation.terms import EffectTerm, Terms
from twin_daemon.simulation.twin import TwinModel

FINGER = ("rh_FFJ1", "rh_FFJ2", "rh_FFJ3", "rh_FFJ4")
SPRUNG = Terms(parameters={"rh_FFJ1.stiffness": 0.002, "rh_FFJ1.springref": -100.0, "rh_FFJ3.damping": np.pi / 30})
SPLIT = EffectTerm(effect="coupling", target="rh_FFJ0", values=LIBRARY["coupling"].complete({}))


def finger(twin: TwinModel) -> TwinModel:
    return submodel(twin, FINGER, np.linspace(-0.1, 0.3, len(twin.joints)))


@pytest.mark.parametrize(
    "made",
    [
        lambda twin: twin,
        finger,
        lambda twin: finger(twin).at_step(0.004),
        lambda twin: finger(twin.changed(SPRUNG)),
        lambda twin: finger(twin.changed(SPRUNG.with_effect(SPLIT))),
    ],
    ids=["hand", "finger", "another step", "parameters", "effects"],
)
def test_a_twin_that_was_pickled_has_the_same_model(made: Callable[[TwinModel], TwinModel]) -> None:
    twin = made(TwinModel.load(load_hand()))
    there = pickle.loads(pickle.dumps(twin))
    assert there.terms == twin.terms
    assert there.joints == twin.joints
    for one, other in ((twin.model, there.model), (twin.base_model, there.base_model)):
        for name, values in arrays(one).items():
            np.testing.assert_array_equal(values, getattr(other, name), err_msg=name)
    changed = [t.changed(Terms(parameters={"rh_FFJ3.damping": 0.02})).model for t in (twin, there)]
    np.testing.assert_array_equal(changed[0].dof_damping, changed[1].dof_damping)


def arrays(model: mujoco.MjModel) -> dict[str, np.ndarray]:
    """What a model has, but for its sites, which move nothing."""
    names = [name for name in dir(model) if not name.startswith(("_", "site_"))]
    return {name: value for name in names if isinstance(value := getattr(model, name), np.ndarray)}


def test_effects_and_kinds_are_themselves_in_another_process() -> None:
    for known in (*LIBRARY.values(), *KINDS.values()):
        assert pickle.loads(pickle.dumps(known)) is known
