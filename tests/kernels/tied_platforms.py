"""Platforms whose legs hold more than their motors and joints determine, and loops described in other ways."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin

import stewart_pin as stp
from stewart_pin.building.loading import build_chain
from stewart_pin.model.description import Joint, Link, Loop, Mechanism
from tests import mechanisms
from tests.closed_states import robot
from tests.kernels.platforms import delta, hanging, planar
from tests.mechanisms import FREE, ONE, P, R, S, X, Z, at, body
from tests.rewritten import recut

_ASKEW = pin.SE3(pin.exp3(np.array([0.4, -0.7, 0.5])), np.zeros(3))


def balls(chain: stp.ClosedChain) -> stp.ClosedChain:
    """Close all loops by balls."""
    old = chain.described()
    loops = tuple(replace(loop, kind=S) for loop in old.loops)
    return build_chain(replace(old, loops=loops), motors=chain.motors)


def swapped(chain: stp.ClosedChain) -> stp.ClosedChain:
    """Describe all loops from their other end."""
    old = chain.described()
    loops = tuple(
        replace(p, link1=p.link2, link2=p.link1, placement1=p.placement2, placement2=p.placement1)
        for p in old.loops
    )
    return build_chain(replace(old, loops=loops), motors=chain.motors)


def in_the_tree(chain: stp.ClosedChain) -> stp.ClosedChain:
    """Let one of the loops carry the platform."""
    other = recut(chain)
    assert other is not None
    return other


def askew() -> stp.ClosedChain:
    """Describe the rods of a 3-RRR in frames that lie in no plane: their unfelt force is no single coordinate."""
    chain = planar(R)
    old, back = chain.described(), _ASKEW.inverse()
    return build_chain(
        replace(
            old,
            links=tuple(
                replace(link, inertia=back.act(link.inertia)) if link.name.startswith("rod") else link
                for link in old.links
            ),
            joints=tuple(
                replace(j, placement=j.placement * _ASKEW, axis=_ASKEW.rotation.T @ j.axis)
                if j.name.startswith("hinge")
                else j
                for j in old.joints
            ),
            loops=tuple(replace(loop, placement2=back * loop.placement2) for loop in old.loops),
        ),
        motors=chain.motors,
    )


def planar_hanging() -> stp.ClosedChain:
    """Hang the legs of a 3-RPR on its platform and close them by hinges at the ground."""
    rng = np.random.default_rng(17)
    links = [Link("ground"), Link("platform", body(rng, 2.0))]
    joints, loops = [Joint("pose", FREE, "ground", "platform", ONE)], []
    home: dict[str, list[float]] = {"pose": [0, 0, 0, 0, 0, 0, 1]}
    for k in range(3):
        foot = pin.exp3(2 * np.pi * k / 3 * Z) @ [0.9, 0, 0]
        head = pin.exp3((2 * np.pi * k / 3 + 0.6) * Z) @ [0.25, 0, 0]
        links += [Link(f"tube{k}", body(rng, 0.4)), Link(f"rod{k}", body(rng, 0.3))]
        joints += [
            Joint(f"hinge{k}", R, "platform", f"tube{k}", pin.SE3(np.eye(3), head), Z),
            Joint(f"motor{k}", P, f"tube{k}", f"rod{k}", at(0.1), X, independent=True),
        ]
        aim = foot - head
        home |= {
            f"hinge{k}": [np.arctan2(aim[1], aim[0])],
            f"motor{k}": [float(np.linalg.norm(aim)) - 0.4],
        }
        loops.append(Loop(f"pin{k}", R, f"rod{k}", "ground", at(0.3), pin.SE3(np.eye(3), foot), Z))
    parts = tuple(links), tuple(joints), tuple(loops)
    motors = tuple(f"motor{k}" for k in range(3))
    return mechanisms._near(Mechanism("hanging", *parts, platform="platform"), home, motors)


def carts() -> stp.ClosedChain:
    """Build a plate that two carts shift in a plane, askew in space, on two parallel rods each."""
    rng = np.random.default_rng(19)
    plane = pin.SE3(pin.exp3(np.array([0.3, -0.5, 0.2])), np.array([0.1, 0.2, 0.3]))
    links = [Link("ground"), Link("platform", body(rng, 2.0))]
    joints, loops = [Joint("pose", FREE, "ground", "platform", plane)], []
    home: dict[str, list[float]] = {"pose": [0, 0, 0, 0, 0, 0, 1]}
    for k, angle in enumerate((0.3, 1.9)):
        along = pin.exp3(angle * Z)
        foot = pin.SE3(np.eye(3), along @ [-0.7, 0, 0])
        rail = pin.exp3((angle + 1.0) * Z) @ X
        links.append(Link(f"cart{k}", body(rng, 0.5)))
        joints.append(Joint(f"motor{k}", P, "ground", f"cart{k}", plane * foot, rail, independent=True))
        home[f"motor{k}"] = [0.0]
        for side, spot in (("a", along @ [0.1, 0.15, 0.0]), ("b", along @ [-0.1, 0.05, 0.0])):
            name, here = f"{k}{side}", pin.SE3(np.eye(3), spot)
            links.append(Link(f"rod{name}", body(rng, 0.3)))
            joints.append(
                Joint(f"hinge{name}", R, f"cart{k}", f"rod{name}", here * _ASKEW, _ASKEW.rotation.T @ Z)
            )
            home[f"hinge{name}"] = [angle]
            tip = _ASKEW.inverse() * at(0.7)
            loops.append(Loop(f"pin{name}", R, f"rod{name}", "platform", tip, here, Z))
    parts = tuple(links), tuple(joints), tuple(loops)
    return mechanisms._near(Mechanism("carts", *parts, platform="platform"), home, ("motor0", "motor1"))


TIED = {
    "stewart, loops from the other end": lambda: swapped(robot("stewart")),
    "legs on the platform, loops from the other end": lambda: swapped(hanging()),
    "3-RRR, loops from the other end": lambda: swapped(planar(R)),
    "3-RRR, balls": lambda: balls(planar(R)),
    "3-RRR, balls, one in the tree": lambda: in_the_tree(swapped(balls(planar(R)))),
    "3-RRR, rods askew": askew,
    "3-RRR, rods askew, hinge in the tree": lambda: in_the_tree(swapped(askew())),
    "3-RPR on the platform": planar_hanging,
    "3-RPR on the platform, loops from the other end": lambda: swapped(planar_hanging()),
    "delta, three rods a crank": lambda: delta(ball_elbows=False, shifts=(0.06, 0.01, -0.06)),
    "delta, ball in the tree": lambda: in_the_tree(swapped(delta(ball_elbows=False))),
    "carts": carts,
    "carts, balls": lambda: balls(carts()),
}
"""Chains whose reactions their legs determine."""
