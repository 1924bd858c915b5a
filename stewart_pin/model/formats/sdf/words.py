"""Which words SDFormat has, element by element, for the readers and for WORDS.md."""

from __future__ import annotations

from stewart_pin.model.formats.dynamics import DYNAMICS
from stewart_pin.model.formats.sdf.elements import OWN_DYNAMICS, OWN_LIMIT, SPANS, own
from stewart_pin.model.formats.words import Strange, Words
from stewart_pin.model.formats.xml import INERTIA_ENTRIES, MIRRORED

SHAPE_TAGS = ("visual", "collision")
"""Children of a ``<link>`` that are shapes."""
DRAKE_ROTOR = ("drake:rotor_inertia", "drake:gear_ratio")
"""Drake's words for the rotor of a motor."""
_BALL = "drake:ball_constraint"
_IN_JOINT = (
    "parent", "child", "pose", "axis", "axis2", "physics", "thread_pitch", "screw_thread_pitch", "gearbox_ratio",
    "gearbox_reference_body", "drake:mimic", *DRAKE_ROTOR, OWN_LIMIT, OWN_DYNAMICS,
)  # fmt: skip
_OF_JOINT = ("name", "independent", "position", "axis", "part1", "part2", "between")
_SOFT = Strange.NOTED

WORDS = {
    "world": Words(
        ("name",), ("model", "include", "frame", "gravity", "physics", "joint", "plugin"), strange=_SOFT
    ),
    "model": Words(
        ("name", "canonical_link", "placement_frame", "namespace", *own("platform")),
        (
            "pose", "static", "link", "joint", "frame", "model", "include",
            "drake:joint", _BALL, "drake:linear_bushing_rpy", "drake:tendon_constraint",
        ),
        strange=_SOFT,
    ),
    "include": Words(("merge",), ("uri", "name", "pose", "static", "placement_frame"), strange=_SOFT),
    "frame": Words(("name", "attached_to", *own("joint")), ("pose",), strange=_SOFT),
    "pose": Words(("relative_to", "frame", "rotation_format", "degrees"), text=True),
    "link": Words(
        ("name", *own("body", "joint", "position")),
        ("pose", "inertial", "gravity", "kinematic", "must_be_base_link", OWN_DYNAMICS, *SHAPE_TAGS),
        strange=_SOFT,
    ),
    "inertial": Words(("auto",), ("mass", "pose", "inertia"), strange=_SOFT),
    "inertia": Words((), (*INERTIA_ENTRIES, *MIRRORED), strange=_SOFT),
    "joint": Words(("name", "type", *own(*_OF_JOINT)), _IN_JOINT, strange=_SOFT),
    "joint of type gearbox": Words(("name", "type"), _IN_JOINT, strange=_SOFT),
    "axis": Words((), ("xyz", "limit", "dynamics", "use_parent_model_frame", "mimic"), strange=_SOFT),
    "axis of a gearbox": Words(
        (), ("xyz", "use_parent_model_frame"), {"dynamics": "that of the two joints counts"}, strange=_SOFT
    ),
    "axis of a ball": Words((), ("dynamics",), {"xyz": "a ball has none"}, strange=_SOFT),
    "axis/dynamics": Words(
        own("armature", "stiffness", "rest", "force"),
        ("damping", "friction", "spring_reference", "spring_stiffness"),
        strange=_SOFT,
    ),
    "dynamics of a ball": Words((), ("damping",), strange=_SOFT),
    OWN_DYNAMICS: Words(("coordinate", *DYNAMICS)),
    "axis/xyz": Words(("expressed_in",), text=True),
    "axis/limit": Words(
        own(*SPANS),
        ("lower", "upper", "effort", "velocity", "stiffness", "dissipation", "drake:acceleration"),
        strange=_SOFT,
    ),
    "axis/mimic": Words(("joint", "axis", *own("name")), ("multiplier", "offset", "reference")),
    "drake:mimic": Words(("joint", "multiplier", "offset")),
    "drake:joint": Words(("name", "type"), ("drake:parent", "drake:child", "drake:damping"), strange=_SOFT),
    _BALL: Words((), tuple(f"{_BALL}_{part}" for part in ("body_A", "body_B", "p_AP", "p_BQ")), strange=_SOFT),
    "drake:linear_bushing_rpy": Words(
        (), tuple(f"drake:bushing_{part}" for part in ("frameA", "frameC", "force_stiffness", "torque_stiffness")),
        {f"drake:bushing_{what}_damping": "told with the bushing"
         for what in ("force", "torque")},
    ),
}  # fmt: skip
"""Words of each element; an ``<axis2>`` has those of an ``<axis>``."""
