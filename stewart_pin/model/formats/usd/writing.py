"""OpenUSD written with the words of UsdPhysics, loops as joints that no articulation includes.

Links are rigid bodies that stand where home puts them, the ground is fixed to the world, motors are drives without
gains. The schema keeps frames of joints, masses and limits in single precision; the numbers themselves, and what the
schema has no word for, go along in attributes of our own.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from stewart_pin.errors import InputError, UnsupportedError
from stewart_pin.geometry.hexapod import STANDARD_GRAVITY
from stewart_pin.model.description import (
    BALL,
    Bounds,
    Coupling,
    Joint,
    JointKind,
    Link,
    Loop,
    Mechanism,
    Note,
    Outcome,
    loop_coordinates,
    unknown_kind,
)
from stewart_pin.model.formats.dialect import write_files
from stewart_pin.model.formats.usd.physics import engine_words, own_words
from stewart_pin.model.formats.usd.stage import (
    BOUNDS,
    DOFS,
    FREE_DOFS,
    OWN,
    PERPENDICULAR,
    TYPES,
    WITH_AXIS,
    Frames,
    matrix_of,
    schema_frames,
    usd,
)
from stewart_pin.model.joint_physics import JointPhysics
from stewart_pin.model.shapes import Shape, ShapeKind
from stewart_pin.model.tree import build_tree, link_frame
from stewart_pin.model.unfolding import fixed_to
from stewart_pin.model.validation import is_massless
from stewart_pin.typing import FloatArray

_TEXT = (".usda", ".usd")
_ENGINES = ("NewtonJointAPI", "PhysxJointAPI")
"""Schemas of engines that know rotors, damping and friction of joints."""


def write_usd(mechanism: Mechanism, path: Path) -> tuple[Note, ...]:
    """Write a mechanism as OpenUSD, in text.

    Parameters
    ----------
    mechanism
        What to write, its home complete.
    path
        File to create or overwrite, ``.usda`` or ``.usd``.

    Returns
    -------
    tuple of Note
        What the schema has no word for, and what was put in its place.

    Raises
    ------
    InputError
        If the suffix is another one.
    """
    if path.suffix.lower() not in _TEXT:
        raise InputError(
            f"path must end in {' or '.join(_TEXT)}, got {path.name!r}; usdcat makes the others of it"
        )
    writer = _UsdWriter(mechanism)
    write_files({path: writer.write()})
    return tuple(writer.notes)


class _UsdWriter:
    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism = mechanism
        self.usd = usd()
        self.stage = self.usd.Usd.Stage.CreateInMemory()
        self.notes: list[Note] = []
        self.names: dict[str, set[str]] = {}
        self.paths: dict[str, str] = {}
        self.joint_paths: dict[str, str] = {}
        self.lost = 0.0
        self.poses = _poses_at_home(mechanism)

    def write(self) -> str:
        geometry, physics, m = self.usd.UsdGeom, self.usd.UsdPhysics, self.mechanism
        for what, parts in (("joint", m.joints), ("loop", m.loops)):
            for part in parts:
                if part.kind not in TYPES and part.kind not in FREE_DOFS:
                    raise unknown_kind(f"{what} '{part.name}'", part.kind, "the writer of OpenUSD")
        geometry.SetStageUpAxis(self.stage, geometry.Tokens.z)
        geometry.SetStageMetersPerUnit(self.stage, 1.0)
        physics.SetStageKilogramsPerUnit(self.stage, 1.0)
        root = geometry.Xform.Define(self.stage, self._path("", m.name)).GetPrim()
        self.root = str(root.GetPath())
        self.stage.SetDefaultPrim(root)
        physics.ArticulationRootAPI.Apply(root)
        self._own(root, "robot", "String", m.name)
        if m.platform is not None:
            self._own(root, "platform", "String", m.platform)
        self._own(root, "assembled", "Bool", m.assembled)
        self._gravity(root)
        self._links()
        scope = str(geometry.Scope.Define(self.stage, self._path(self.root, "joints")).GetPath())
        self._hold_ground(scope)
        for joint in m.joints:
            if joint.name not in self.joint_paths:
                self._tree_joint(scope, joint)
        for loop in m.loops:
            self._loop(scope, loop)
        self._couplings()
        if self.lost > 0:
            text = (
                f"frames of joints and loops: single precision, off by {self.lost:.1g} m at most; the numbers "
                f"themselves stand beside them in words of our own, {OWN}..., which others pass over"
            )
            self.notes.append(Note("UsdPhysics", text, Outcome.CHANGED))
        return str(self.stage.GetRootLayer().ExportToString())

    # ------------------------------------------------------------------------------------------------
    # Names, and words of our own
    # ------------------------------------------------------------------------------------------------

    def _path(self, parent: str, name: str) -> str:
        """Find a prim's name that nobody has: identifiers know letters, digits and underscores only."""
        taken = self.names.setdefault(parent, set())
        stem = (
            self.usd.Tf.MakeValidIdentifier(name)
            if name.isascii()
            else self.usd.Tf.MakeValidIdentifier("part")
        )
        made, number = stem, 1
        while made in taken:
            number += 1
            made = f"{stem}_{number}"
        taken.add(made)
        return f"{parent}/{made}"

    def _own(self, prim: Any, name: str, type_name: str, value: Any) -> None:
        kind = getattr(self.usd.Sdf.ValueTypeNames, type_name)
        prim.CreateAttribute(OWN + name, kind, custom=True).Set(value)

    def _numbers(self, prim: Any, name: str, values: FloatArray) -> None:
        self._own(prim, name, "DoubleArray", [float(value) for value in np.ravel(values)])

    def _frame(self, prim: Any, name: str, placement: pin.SE3) -> None:
        self._own(prim, name, "Matrix4d", self.usd.Gf.Matrix4d(matrix_of(placement)))

    def _place(self, prim: Any, placement: pin.SE3, scale: FloatArray | None = None) -> None:
        gf, geometry = self.usd.Gf, self.usd.UsdGeom
        xform = geometry.Xformable(prim)
        double = geometry.XformOp.PrecisionDouble
        xform.AddTranslateOp(double).Set(gf.Vec3d(*map(float, placement.translation)))
        x, y, z, w = map(float, pin.Quaternion(placement.rotation).coeffs())
        xform.AddOrientOp(double).Set(gf.Quatd(w, x, y, z))
        if scale is not None:
            xform.AddScaleOp(double).Set(gf.Vec3d(*map(float, scale)))

    # ------------------------------------------------------------------------------------------------
    # Gravity and links
    # ------------------------------------------------------------------------------------------------

    def _gravity(self, root: Any) -> None:
        gf, gravity = self.usd.Gf, self.mechanism.gravity
        scene = self.usd.UsdPhysics.Scene.Define(self.stage, self._path(self.root, "physicsScene"))
        fall = np.array(STANDARD_GRAVITY if gravity is None else gravity)
        size = float(np.linalg.norm(fall))
        down = fall / size if size else np.array([0.0, 0.0, -1.0])
        scene.CreateGravityDirectionAttr().Set(gf.Vec3f(*map(float, down)))
        scene.CreateGravityMagnitudeAttr().Set(size)
        if gravity is not None:
            self._numbers(root, "gravity", fall)

    def _links(self) -> None:
        """Write bodies, and beneath them links without mass that are fixed to them: these are frames alone."""
        m = self.mechanism
        ends = {end for loop in m.loops for end in (loop.link1, loop.link2)} | {
            joint.parent for joint in m.joints
        }
        held = {
            joint.child: joint
            for joint in m.joints
            if joint.kind is JointKind.FIXED
            and is_massless(m.link(joint.child).inertia)
            and joint.child not in ends
        }
        for link in m.links:
            if link.name not in held:
                self._link(link)
        for link in m.links:
            if link.name in held:
                self._frame_link(link, held[link.name])

    def _link(self, link: Link) -> None:
        path = self._path(self.root, link.name)
        prim = self.usd.UsdGeom.Xform.Define(self.stage, path).GetPrim()
        self.paths[link.name] = path
        self._place(prim, self.poses[link.name])
        self.usd.UsdPhysics.RigidBodyAPI.Apply(prim)
        self._own(prim, "link", "String", link.name)
        self._inertia(prim, link)
        self._shapes(path, link)

    def _frame_link(self, link: Link, joint: Joint) -> None:
        path = self._path(self.paths[joint.parent], link.name)
        prim = self.usd.UsdGeom.Xform.Define(self.stage, path).GetPrim()
        self.paths[link.name], self.joint_paths[joint.name] = path, path
        self._place(prim, joint.placement)
        self._own(prim, "link", "String", link.name)
        self._own(prim, "joint", "String", joint.name)
        self._frame(prim, "frame0", joint.placement)
        if link.inertia is not None:
            self._numbers(prim, "inertia", np.zeros(10))
        self._shapes(path, link)

    def _inertia(self, prim: Any, link: Link) -> None:
        body = link.inertia
        if body is not None:
            matrix = body.inertia
            entries = matrix[np.triu_indices(3)]
            self._numbers(prim, "inertia", np.concatenate([[body.mass], body.lever, entries]))
        if link.name in self.mechanism.odd_inertias:
            self._own(prim, "odd_inertia", "Bool", True)
        if body is None or is_massless(body):
            if link.name != self.mechanism.root and is_massless(self._held_with(link.name)):
                self._own(prim, "massless", "Bool", True)
                text = (
                    f"a rigid body without mass: other readers take one from its shapes, or assume one; {OWN}massless "
                    "says that it has none"
                )
                self.notes.append(Note(f"link '{link.name}'", text, Outcome.CHANGED))
            return
        gf = self.usd.Gf
        moments, axes = np.linalg.eigh(body.inertia)
        axes[:, 2] = np.cross(axes[:, 0], axes[:, 1])
        if np.array_equal(body.inertia, np.diag(np.diag(body.inertia))):
            moments, axes = np.diag(body.inertia), np.eye(3)
        mass = self.usd.UsdPhysics.MassAPI.Apply(prim)
        mass.CreateMassAttr().Set(float(body.mass))
        mass.CreateCenterOfMassAttr().Set(gf.Vec3f(*map(float, body.lever)))
        mass.CreateDiagonalInertiaAttr().Set(gf.Vec3f(*map(float, moments)))
        x, y, z, w = map(float, pin.Quaternion(axes).coeffs())
        mass.CreatePrincipalAxesAttr().Set(gf.Quatf(w, x, y, z))
        least = np.finfo(np.float32).tiny
        if min(float(body.mass), float(np.abs(moments).max())) < least:
            text = f"its mass or moments are below {least:.2g}, and zero in single precision"
            self.notes.append(Note(f"link '{link.name}'", text, Outcome.CHANGED))

    def _held_with(self, name: str) -> pin.Inertia:
        """Sum the inertias of what is fixed to a link."""
        total = pin.Inertia.Zero()
        for link, placement in fixed_to(self.mechanism, name).items():
            inertia = self.mechanism.link(link).inertia
            if inertia is not None and inertia.mass > 0:
                total += placement.act(inertia)
        return total

    # ------------------------------------------------------------------------------------------------
    # Shapes
    # ------------------------------------------------------------------------------------------------

    def _shapes(self, parent: str, link: Link) -> None:
        for what, shapes in (("visual", link.visuals), ("collision", link.collisions)):
            for shape in shapes:
                self._shape(parent, what, shape, f"link '{link.name}'")

    def _shape(self, parent: str, what: str, shape: Shape, owner: str) -> None:
        geometry, sizes = self.usd.UsdGeom, [float(size) for size in shape.sizes]
        if shape.kind is ShapeKind.MESH:
            self.notes.append(
                Note(owner, f"{what}: the mesh {shape.mesh!r} is left out, no part of OpenUSD reads it")
            )
            return
        path = self._path(parent, shape.name or what)
        scale = None
        match shape.kind:
            case ShapeKind.BOX:
                made, scale = geometry.Cube.Define(self.stage, path), np.array(sizes)
                made.CreateSizeAttr().Set(1.0)
            case ShapeKind.SPHERE:
                made = geometry.Sphere.Define(self.stage, path)
                made.CreateRadiusAttr().Set(sizes[0])
            case ShapeKind.ELLIPSOID:
                made, scale = geometry.Sphere.Define(self.stage, path), np.array(sizes)
                made.CreateRadiusAttr().Set(1.0)
            case _:
                round_ = geometry.Cylinder if shape.kind is ShapeKind.CYLINDER else geometry.Capsule
                made = round_.Define(self.stage, path)
                made.CreateAxisAttr().Set("Z")
                made.CreateRadiusAttr().Set(sizes[0])
                made.CreateHeightAttr().Set(sizes[1])
        prim = made.GetPrim()
        self._place(prim, shape.placement, scale)
        if shape.name:
            self._own(prim, "shape", "String", shape.name)
        if what == "collision":
            self.usd.UsdPhysics.CollisionAPI.Apply(prim)
            made.CreatePurposeAttr().Set(geometry.Tokens.guide)
        if shape.material is None:
            return
        if shape.material.rgba is not None:
            *colour, opacity = map(float, shape.material.rgba)
            made.CreateDisplayColorAttr().Set([self.usd.Gf.Vec3f(*colour)])
            made.CreateDisplayOpacityAttr().Set([opacity])
        if shape.material.texture:
            self.notes.append(Note(owner, f"{what}: its texture {shape.material.texture!r} is left out"))

    # ------------------------------------------------------------------------------------------------
    # Joints and loops
    # ------------------------------------------------------------------------------------------------

    def _hold_ground(self, scope: str) -> None:
        joint = self.usd.UsdPhysics.FixedJoint.Define(self.stage, self._path(scope, "ground_in_world"))
        joint.CreateBody1Rel().SetTargets([self.paths[self.mechanism.root]])

    def _joint(
        self,
        scope: str,
        name: str,
        kind: JointKind,
        links: tuple[str, str],
        frames: tuple[pin.SE3, pin.SE3],
        axes: Any,
    ) -> Any:
        """Write what joints of the tree and of loops have in common."""
        path = self._path(scope, name)
        prim = self.stage.DefinePrim(path, TYPES.get(kind, "PhysicsJoint"))
        self.joint_paths[name] = path
        joint = self.usd.UsdPhysics.Joint(prim)
        joint.CreateBody0Rel().SetTargets([self.paths[links[0]]])
        joint.CreateBody1Rel().SetTargets([self.paths[links[1]]])
        turned = schema_frames(kind, *frames, *axes)
        self._schema_frames(joint, turned)
        self._own(prim, "joint", "String", name)
        self._own(prim, "kind", "Token", str(kind))
        for number, frame in enumerate(frames):
            self._frame(prim, f"frame{number}", frame)
        if kind not in (JointKind.FIXED, JointKind.FLOATING, JointKind.DISTANCE):
            self._numbers(prim, "axis", axes[0])
        if kind is JointKind.UNIVERSAL:
            self._numbers(prim, "axis2", axes[1])
        if kind in WITH_AXIS:
            prim.GetAttribute("physics:axis").Set(turned.token)
        for dof in DOFS if kind in FREE_DOFS else ():
            if dof not in FREE_DOFS[kind]:
                self._limit(prim, dof, 1.0, -1.0)
        return prim

    def _schema_frames(self, joint: Any, turned: Frames) -> None:
        gf = self.usd.Gf
        ends = (
            (turned.frame0, joint.CreateLocalPos0Attr(), joint.CreateLocalRot0Attr()),
            (turned.frame1, joint.CreateLocalPos1Attr(), joint.CreateLocalRot1Attr()),
        )
        for frame, position, rotation in ends:
            shift = np.array(frame.translation)
            self.lost = max(self.lost, float(np.abs(shift - shift.astype(np.float32)).max()))
            position.Set(gf.Vec3f(*map(float, shift)))
            x, y, z, w = map(float, pin.Quaternion(frame.rotation).coeffs())
            rotation.Set(gf.Quatf(w, x, y, z))

    def _limit(self, prim: Any, dof: str, low: float, high: float) -> None:
        limit = self.usd.UsdPhysics.LimitAPI.Apply(prim, dof)
        limit.CreateLowAttr().Set(low)
        limit.CreateHighAttr().Set(high)

    def _tree_joint(self, scope: str, joint: Joint) -> None:
        one = pin.SE3.Identity()
        axes = (joint.axis, np.array([0.0, 1.0, 0.0]))
        prim = self._joint(
            scope, joint.name, joint.kind, (joint.parent, joint.child), (joint.placement, one), axes
        )
        if joint.kind is JointKind.FLOATING:
            # It holds nothing; within an articulation it would count as a joint of six freedoms.
            prim.GetAttribute("physics:excludeFromArticulation").Set(True)
        if joint.name in self.mechanism.home:
            self._numbers(prim, "home", self.mechanism.home[joint.name])
        self._physics(prim, f"joint '{joint.name}'", joint.kind, (joint.physics,) if joint.physics else ())
        if joint.kind is JointKind.SPHERICAL:
            self._bounds(prim, joint.kind, _ball_bounds(joint))
        if joint.has_axis:
            self._bounds(prim, joint.kind, (joint.bounds,))
            if joint.independent:
                self._motor(prim, joint)

    def _motor(self, prim: Any, joint: Joint) -> None:
        drive = self.usd.UsdPhysics.DriveAPI.Apply(
            prim, "angular" if joint.kind is JointKind.REVOLUTE else "linear"
        )
        drive.CreateTypeAttr().Set("force")
        least, most = joint.bounds.effort
        if np.isfinite(max(-least, most)):
            drive.CreateMaxForceAttr().Set(max(-least, most))
        self._own(prim, "motor", "Bool", True)

    def _loop(self, scope: str, loop: Loop) -> None:
        prim = self._joint(
            scope,
            loop.name,
            loop.kind,
            (loop.link1, loop.link2),
            (loop.placement1, loop.placement2),
            (loop.axis, loop.axis2),
        )
        prim.GetAttribute("physics:excludeFromArticulation").Set(True)
        if loop.kind is JointKind.DISTANCE:
            for name in ("physics:minDistance", "physics:maxDistance"):
                prim.GetAttribute(name).Set(loop.length)
            self._numbers(prim, "length", np.array([loop.length]))
        self._physics(prim, f"loop '{loop.name}'", loop.kind, loop.physics)
        leaning = loop.kind is JointKind.UNIVERSAL and abs(loop.axis @ loop.axis2) >= PERPENDICULAR
        self._bounds(prim, loop.kind, loop.bounds, in_schema=not leaning)

    def _bounds(
        self, prim: Any, kind: JointKind, bounds: tuple[Bounds, ...], *, in_schema: bool = True
    ) -> None:
        if all(bound == Bounds() for bound in bounds):
            return
        numbers = [span for bound in bounds for key in BOUNDS for span in getattr(bound, key)]
        self._numbers(prim, "bounds", np.array(numbers))
        if kind is JointKind.SPHERICAL:
            swing = bounds[0].position[1]
            if np.isfinite(swing):
                for name in ("physics:coneAngle0Limit", "physics:coneAngle1Limit"):
                    prim.GetAttribute(name).Set(float(np.degrees(swing)))
            return
        names = ("angle",) if kind is JointKind.REVOLUTE else loop_coordinates(kind)
        for number, (name, bound) in enumerate(zip(names, bounds, strict=True)):
            angular = name.startswith("angle")
            low, high = np.degrees(bound.position) if angular else bound.position
            if kind in WITH_AXIS:
                prim.GetAttribute("physics:lowerLimit").Set(float(low))
                prim.GetAttribute("physics:upperLimit").Set(float(high))
                self._speed(prim, bound, angular=angular)
            elif in_schema and np.isfinite([low, high]).any():
                self._limit(prim, FREE_DOFS[kind][number], float(low), float(high))

    def _physics(self, prim: Any, owner: str, kind: JointKind, physics: tuple[JointPhysics, ...]) -> None:
        for word, numbers in own_words(physics).items():
            self._numbers(prim, word, numbers)
        alone = [str(own) for own in physics if own]
        if len(physics) == 1 and kind is not JointKind.FLOATING:
            for schema, words in zip(_ENGINES, engine_words(kind, physics[0]), strict=True):
                if words:
                    prim.AddAppliedSchema(schema)
                for word, value in words.items():
                    prim.CreateAttribute(word, self.usd.Sdf.ValueTypeNames.Float, custom=False).Set(value)
            own = replace(physics[0], armature=0.0, damping=0.0, friction=0.0)
            alone = [str(own)] if own else []
        if alone:
            text = f"{'; '.join(alone)}: in words of our own alone, as engines have no others for it"
            self.notes.append(Note(owner, text))

    def _speed(self, prim: Any, bound: Bounds, *, angular: bool) -> None:
        """Write a limit of speed as PhysX has it, in degrees per second."""
        speed = max(-bound.velocity[0], bound.velocity[1])
        if np.isfinite(speed):
            prim.AddAppliedSchema("PhysxJointAPI")
            value = float(np.degrees(speed)) if angular else speed
            kind = self.usd.Sdf.ValueTypeNames.Float
            prim.CreateAttribute("physxJoint:maxJointVelocity", kind, custom=False).Set(value)

    # ------------------------------------------------------------------------------------------------
    # Couplings: two schemas of engines have a word for those that are linear
    # ------------------------------------------------------------------------------------------------

    def _couplings(self) -> None:
        if not self.mechanism.couplings:
            return
        scope = str(self.usd.UsdGeom.Scope.Define(self.stage, self._path(self.root, "couplings")).GetPath())
        followers: set[str] = set()
        for coupling in self.mechanism.couplings:
            if coupling.others:
                raise UnsupportedError(
                    f"coupling '{coupling.name}' follows a sum of joints, which format 'usd' has no word for; write "
                    "URDF+ or MJCF"
                )
            prim = self.usd.UsdGeom.Scope.Define(self.stage, self._path(scope, coupling.name)).GetPrim()
            self._own(prim, "coupling", "String", coupling.name)
            self._own(prim, "joint1", "String", coupling.joint1)
            if coupling.joint2 is not None:
                self._own(prim, "joint2", "String", coupling.joint2)
            self._numbers(prim, "polynomial", np.array(coupling.polynomial))
            if coupling.joint2 is None or np.any(coupling.polynomial[2:]) or coupling.joint1 in followers:
                text = f"in words of our own alone: no other couples joints so ({OWN}polynomial)"
                self.notes.append(Note(f"coupling '{coupling.name}'", text))
            else:
                followers.add(coupling.joint1)
                self._mimic(coupling, coupling.joint2)

    def _mimic(self, coupling: Coupling, leader: str) -> None:
        prim = self.stage.GetPrimAtPath(self.joint_paths[coupling.joint1])
        units = [
            np.degrees(1.0) if self.mechanism.joint(name).kind is JointKind.REVOLUTE else 1.0
            for name in (coupling.joint1, leader)
        ]
        offset, factor = (*coupling.polynomial, 0.0)[:2]
        types = self.usd.Sdf.ValueTypeNames
        prim.AddAppliedSchema("NewtonMimicAPI")
        prim.CreateAttribute("newton:mimicEnabled", types.Bool, custom=False).Set(True)
        prim.CreateRelationship("newton:mimicJoint", custom=False).SetTargets([self.joint_paths[leader]])
        prim.CreateAttribute("newton:mimicCoef0", types.Float, custom=False).Set(float(offset * units[0]))
        prim.CreateAttribute("newton:mimicCoef1", types.Float, custom=False).Set(
            float(factor * units[0] / units[1])
        )


def _ball_bounds(joint: Joint) -> tuple[Bounds, ...]:
    limits = (joint.swing, joint.turn)
    return tuple(Bounds(position=(-np.inf, limit)) for _, limit in zip(BALL, limits, strict=True))


def _poses_at_home(mechanism: Mechanism) -> dict[str, pin.SE3]:
    """Place all links in the world."""
    model = build_tree(mechanism, np.zeros(3))
    q = pin.neutral(model)
    for name, values in mechanism.home.items():
        entry = model.joints[model.getJointId(name)]
        q[entry.idx_q : entry.idx_q + entry.nq] = values
    data = pin.Data(model)
    pin.framesForwardKinematics(model, data, q)
    return {link.name: data.oMf[link_frame(model, link.name)] for link in mechanism.links}
