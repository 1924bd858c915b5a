"""What is shown of a state."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

import stewart_pin as stp
from stewart_pin.viewer.page import as_python, readings_table
from stewart_pin.viewer.picture import motor_colours
from stewart_pin.viewer.readings import read_state


def test_efforts_and_strokes_are_those_of_the_verbs():
    chain = stp.load("stewart")
    closure = stp.inverse_kinematics(chain, [0.1, 0.0, 1.1, 0.0, 0.0, 0.0, 1.0])
    shown = read_state(closure.state)
    effort = stp.inverse_dynamics(chain, closure.q, np.zeros(chain.nv), np.zeros(chain.nv)).tau_motor
    np.testing.assert_allclose([motor.effort for motor in shown.motors], effort, rtol=1e-12)
    lengths = stp.motor_positions(chain, closure.q)
    np.testing.assert_allclose([motor.position for motor in shown.motors], lengths)
    left = np.minimum(lengths - 0.5, 1.8 - lengths) / 1.3
    np.testing.assert_allclose([motor.stroke_left for motor in shown.motors], left)
    assert shown.missing == ""
    assert shown.exceeded == ()
    assert shown.condition > 1


def test_without_motors_it_says_why_there_are_no_efforts():
    chain = stp.load("four_bar")
    shown = read_state(stp.with_motors(chain, []).home_state())
    assert "no motors" in shown.missing
    assert "no motors" in readings_table(shown)


def test_colours_tell_the_sign_of_an_effort_and_the_end_of_a_stroke():
    chain = stp.load("stewart")
    colours = motor_colours(read_state(chain.home_state()), "force")
    assert (colours[:, 0] > colours[:, 2]).all()  # all push: red
    upside_down = stp.load("stewart", gravity=(0.0, 0.0, 9.81))
    colours = motor_colours(read_state(upside_down.home_state()), "force")
    assert (colours[:, 2] > colours[:, 0]).all()  # all pull: blue
    near = stp.forward_kinematics(chain, [1.79, 1.7, 1.7, 1.7, 1.7, 1.7]).state
    left = motor_colours(read_state(near), "stroke left")
    assert left[0, 0] > left[1, 0]


def test_lines_of_python_give_the_state_back():
    chain = stp.load("stewart")
    state = stp.inverse_kinematics(chain, [0.1, 0.02, 1.1, 0.0, 0.0, 0.1, np.sqrt(0.99)]).state
    lines = as_python(chain, state).removeprefix("```python\n").removesuffix("\n```")
    told: dict = {}
    exec(lines, {}, told)
    np.testing.assert_array_equal(told["q"], state.q)
    np.testing.assert_allclose(stp.inverse_kinematics(chain, told["pose"]).q, state.q, atol=1e-9)
    np.testing.assert_allclose(told["q_motor"], stp.motor_positions(state))


def test_names_of_a_file_are_no_markup():
    chain = stp.load("stewart")
    shown = read_state(chain.home_state())
    from dataclasses import replace

    bad = replace(shown, motors=(replace(shown.motors[0], name="<script>alert(1)</script>"),))
    assert "<script>" not in readings_table(bad)


def test_a_weight_on_the_platform_is_a_payload():
    chain = stp.load("stewart")
    state = stp.inverse_kinematics(chain, [0.1, 0.0, 1.1, 0.0, 0.0, 0.0, 1.0]).state
    shown = read_state(state, load=np.array([0.0, 0.0, -5.0 * 9.81, 0.0, 0.0, 0.0]))
    gravity = stp.load("stewart", gravity=(0.0, 0.0, -9.81))
    point = pin.Inertia(5.0, np.zeros(3), np.zeros((3, 3)))
    carrying = stp.attach_payload(gravity, point)
    rest = np.zeros(chain.nv)
    bare = stp.inverse_dynamics(gravity, state.q, rest, rest).tau_motor
    more = stp.inverse_dynamics(carrying, state.q, rest, rest).tau_motor - bare
    unloaded = [motor.effort for motor in read_state(state).motors]
    np.testing.assert_allclose([m.effort for m in shown.motors], unloaded + more, rtol=1e-10)
