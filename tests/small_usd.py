"""Small OpenUSD files, in text."""

from __future__ import annotations

from pathlib import Path

BAR = """
    def Xform "{name}" (prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsMassAPI"])
    {{
        float physics:mass = {mass}
        point3f physics:centerOfMass = (5, 0, 0)
        float3 physics:diagonalInertia = (0.1, 8, 8)
        quatf physics:principalAxes = (1, 0, 0, 0)
        double3 xformOp:translate = {at}
        float xformOp:rotateZ = {turn}
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateZ"]
    }}
"""


def stage(*parts: str, metre: str = "0.01", up: str = "Y") -> str:
    """Centimetres, kilograms, y upwards, as many exporters have it."""
    units = f'(\n    defaultPrim = "robot"\n    metersPerUnit = {metre}\n    upAxis = "{up}"\n)\n'
    return f'#usda 1.0\n{units}\ndef Xform "robot"\n{{\n{"".join(parts)}\n}}\n'


def bar(name: str, at: str = "(0, 0, 0)", turn: float = 0.0, mass: float = 1.0) -> str:
    return BAR.format(name=name, at=at, turn=turn, mass=mass)


def joint(name: str, text: str, kind: str = "PhysicsRevoluteJoint", schemas: str = "") -> str:
    applied = f"(prepend apiSchemas = [{schemas}])" if schemas else ""
    return f'\n    def {kind} "{name}" {applied}\n    {{\n{text}\n    }}\n'


def ends(body0: str, body1: str, at0: str = "(0, 0, 0)", at1: str = "(0, 0, 0)") -> str:
    """Two bodies, the world where there is no name, and where the joint is in them."""
    bodies = ((0, body0), (1, body1))
    rels = "".join(f"        rel physics:body{k} = </robot/{body}>\n" for k, body in bodies if body)
    return f"{rels}        point3f physics:localPos0 = {at0}\n        point3f physics:localPos1 = {at1}\n"


def write(folder: Path, text: str, name: str = "small.usda") -> Path:
    path = folder / name
    path.write_text(text)
    return path


def as_others_see_it(path: Path) -> Path:
    """Take our own words out of a file, but for the one that links have no mass."""
    lines = path.read_text().splitlines(keepends=True)
    other = path.with_name(f"{path.stem}_others.usda")
    other.write_text("".join(x for x in lines if "stewart_pin:" not in x or "massless" in x))
    return other
