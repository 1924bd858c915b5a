"""Small MJCF files for tests."""

from __future__ import annotations

from pathlib import Path

from stewart_pin.model.description import Mechanism
from stewart_pin.model.formats.mjcf.reading import read_mjcf

BALL = '<inertial pos="0.02 -0.01 0.03" mass="1.3" diaginertia="0.02 0.03 0.04"/>'
"""An inertia that belongs to no shape."""
ARM = f'<body name="arm"><joint name="motor" axis="0 1 0"/>{BALL}%s</body>'
"""A body on a hinge; %s stands for what hangs on it."""
DRIVEN = '<actuator><motor name="drive" joint="motor"/></actuator>'

TIES = (
    '<connect name="c" body1="coupler" body2="platform" anchor="0.1 0.2 0.3"/>'
    '<weld name="off" site1="sole" site2="tool" active="false"/>'
    '<joint name="g" joint1="knee" joint2="hip" polycoef="0.1 0.7 -0.2 0.3 0.15"/>'
    '<tendon name="s" tendon1="sum"/>'
)
"""Closures of `WORKSHOP`: a ball, one that is off, a gear, a sum by a tendon."""


def mjcf(world: str, *rest: str, angle: str = "radian") -> str:
    """Wrap a world and further sections into a file."""
    return f'<mujoco model="small"><compiler angle="{angle}"/><worldbody>{world}</worldbody>{"".join(rest)}</mujoco>'


def write(folder: Path, text: str, name: str = "small.xml") -> Path:
    """Write a file and return its path."""
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def body(name: str, inside: str = "", **attributes: str) -> str:
    listed = "".join(f' {key}="{value}"' for key, value in attributes.items())
    return f'<body name="{name}"{listed}>{BALL}{inside}</body>'


def hinge(name: str, **attributes: str) -> str:
    listed = "".join(f' {key}="{value}"' for key, value in attributes.items())
    return f'<joint name="{name}"{listed}/>'


HAND = body("hand", hinge("wrist") + '<site name="palm" pos="0.1 0 0"/>', pos="0.5 0 0")
BOTH = ARM % HAND


def read(folder: Path, *sections: str) -> Mechanism:
    return read_mjcf(write(folder, mjcf(*sections)))


def equality(*elements: str) -> str:
    return f"<equality>{''.join(elements)}</equality>"


def actuator(*elements: str) -> str:
    return f"<actuator>{''.join(elements)}</actuator>"


def notes(mechanism: Mechanism) -> str:
    return "\n".join(f"{note.outcome} {note.subject} {note.text}" for note in mechanism.notes)


WORKSHOP = """
<mujoco model="workshop">
  <compiler angle="degree" eulerseq="zyx" inertiafromgeom="auto"/>
  <option gravity="1.3 -2.1 -9.81" density="1.2"/>
  <default>
    <joint damping="0.4"/>
    <default class="leg"><joint axis="0.6 0 0.8" range="-70 95" limited="true"/></default>
  </default>
  <asset>
    <mesh name="wedge" vertex="0 0 0  0.4 0 0  0 0.3 0  0 0 0.2"/>
    <mesh name="absent" file="nowhere.stl"/>
    <texture name="paint" type="2d" file="nowhere.png"/>
    <material name="paint" texture="paint"/>
  </asset>
  <worldbody>
    <light pos="0 0 3"/>
    <geom name="floor" type="plane" size="4 4 .1"/>
    <site name="anchor" pos="0.4 0.5 0.6" euler="10 20 30"/>
    <body name="plinth" pos="0.1 0.2 0.3" euler="30 -20 10">
      <geom type="box" size="0.2 0.2 0.1" material="paint"/>
      <body name="thigh" pos="0.3 0 0.2" quat="0.9 0.1 -0.2 0.4">
        <joint name="hip" class="leg" pos="0.05 -0.1 0.2" ref="25"/>
        <geom type="capsule" size="0.05" fromto="0 0 0 0.3 0.1 0" material="paint"/>
        <geom type="mesh" mesh="wedge" density="700"/>
        <body name="shin" pos="0.3 0.1 0" euler="5 15 25">
          <joint name="knee" type="slide" axis="0 1 1" pos="0.3 0.2 0.1" ref="0.12" range="-1 1"/>
          <joint name="twist" type="hinge" axis="1 1 0" pos="-0.1 0.2 0"/>
          <joint type="ball" name="ankle" pos="0.1 0.05 -0.2"/>
          <inertial pos="0.01 0.02 0.03" quat="0.8 0.1 0.3 -0.2" mass="2.5" diaginertia="0.03 0.04 0.05"/>
          <geom type="mesh" mesh="absent"/>
          <site name="sole" pos="0.1 0.2 -0.3" euler="40 50 60"/>
          <body pos="0.2 0.1 0.1"><geom size="0.04" mass="0.3"/></body>
        </body>
      </body>
      <body name="crank" pos="-0.3 0.1 0.2">
        <joint name="crank" axis="0 0 1" armature="0.05" stiffness="3" springref="20"/>
        <inertial pos="0.1 0 0" mass="1.5" fullinertia="0.02 0.03 0.035 0.001 0.002 -0.003"/>
        <body name="coupler" pos="0.2 0 0">
          <joint axis="0 0 1" frictionloss="0.2"/>
          <geom type="cylinder" size="0.03 0.2"/>
          <site name="tip" pos="0.1 0.3 0.2"/>
          <body name="block" pos="0.2 0.1 0" gravcomp="0.5">
            <joint name="slider" type="slide" axis="1 2 3" ref="-0.05"/>
            <geom size="0.07"/>
          </body>
        </body>
      </body>
    </body>
    <body name="platform" pos="0.5 0.4 1.1" euler="15 25 -35">
      <freejoint name="float"/>
      <geom type="ellipsoid" size="0.3 0.2 0.1" density="400"/>
      <site name="tool" pos="0.1 0.05 -0.2" euler="0 45 0"/>
    </body>
    <body name="hand" mocap="true" pos="0.3 -0.6 0.4" euler="1 2 3"><geom size="0.05"/></body>
    <body name="second" pos="1 0 0"><joint name="second" axis="0 1 0"/><geom size="0.1"/></body>
  </worldbody>
  <equality>
    %s
  </equality>
  <tendon>
    <spatial name="rod"><site site="anchor"/><site site="tip"/></spatial>
    <fixed name="sum"><joint joint="crank" coef="2"/><joint joint="second" coef="-0.5"/></fixed>
  </tendon>
  <actuator>
    <position name="servo" joint="second" kp="10"/>
    <motor name="push" joint="knee" gear="5" ctrlrange="-2 2"/>
    <motor name="turn" joint="hip" gear="-3" forcerange="-4 4"/>
    <motor name="pull" tendon="rod"/>
  </actuator>
  <sensor><gyro site="sole"/></sensor>
  <keyframe><key name="home" qpos="%s"/></keyframe>
</mujoco>
"""
"""Every joint, anchors off centre, references, degrees, inertias of all kinds; %s: equality constraints, home."""
QPOS = "0.2 0.3 -0.4 0.9 0.1 0.2 -0.3 0.5 -0.6 0.1 0.5 0.4 1.2 0.8 -0.1 0.3 0.5 0.7"
"""A configuration of it, in MuJoCo's order: hip, knee, twist, ankle, crank, coupler, slider, float, second."""
