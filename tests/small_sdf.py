"""Small robots in SDFormat: pieces of text, and one file for every way of placing links, joints and axes."""

from __future__ import annotations

from pathlib import Path

BODY = (
    "<inertial><pose>0.1 -0.2 0.3 0.2 -0.1 0.4</pose><mass>2</mass><inertia><ixx>0.5</ixx><iyy>0.6</iyy>"
    "<izz>0.7</izz><ixy>0.01</ixy><ixz>-0.02</ixz><iyz>0.03</iyz></inertia></inertial>"
)


def sdf(*parts: str, version: str = "1.9", attributes: str = "") -> str:
    """Write a file of one model."""
    return f'<sdf version="{version}"><model name="small" {attributes}>{"".join(parts)}</model></sdf>'


def link(name: str, pose: str = "", content: str = BODY, *, relative_to: str = "") -> str:
    return f'<link name="{name}">{at(pose, relative_to)}{content}</link>'


def joint(
    name: str,
    parent: str,
    child: str,
    kind: str = "revolute",
    *,
    pose: str = "",
    relative_to: str = "",
    xyz: str = "0 0 1",
    expressed_in: str = "",
    axis: str = "",
    content: str = "",
) -> str:
    """Write a joint; `axis` is what stands in its <axis> beside the direction."""
    frame = f' expressed_in="{expressed_in}"' if expressed_in else ""
    about = f"<axis><xyz{frame}>{xyz}</xyz>{axis}</axis>" if xyz else ""
    return (
        f'<joint name="{name}" type="{kind}">{at(pose, relative_to)}<parent>{parent}</parent>'
        f"<child>{child}</child>{about}{content}</joint>"
    )


def frame(name: str, pose: str = "", *, attached_to: str = "", relative_to: str = "") -> str:
    attribute = f' attached_to="{attached_to}"' if attached_to else ""
    return f'<frame name="{name}"{attribute}>{at(pose, relative_to)}</frame>'


def at(pose: str, relative_to: str = "") -> str:
    attribute = f' relative_to="{relative_to}"' if relative_to else ""
    return f"<pose{attribute}>{pose}</pose>" if pose or relative_to else ""


def axis2(xyz: str, content: str = "") -> str:
    return f"<axis2><xyz>{xyz}</xyz>{content}</axis2>"


def write(folder: Path, text: str, name: str = "small.sdf") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


TWO = (link("a", "1 2 3 0.1 0.2 0.3"), link("b", "0.5 -1 2 -0.4 0.3 1.1"))
HOLD = joint("hold", "world", "a", "fixed", xyz="")
TURNED = "0.2 0.3 -0.1 0.5 -0.4 0.3"

TREES = {
    "the joint stands in its child link": sdf(*TWO, HOLD, joint("j", "a", "b")),
    "a joint with a pose in its child link": sdf(*TWO, HOLD, joint("j", "a", "b", pose=TURNED)),
    "a slide with a pose": sdf(*TWO, HOLD, joint("j", "a", "b", "prismatic", pose=TURNED, xyz="1 2 0")),
    "a joint turned, not moved": sdf(*TWO, HOLD, joint("j", "a", "b", pose="0 0 0 1 0.5 0.2", xyz="1 0 1")),
    "a joint moved along its axis": sdf(*TWO, HOLD, joint("j", "a", "b", pose="0 0 0.7 0 0 0")),
    "an axis in the model frame": sdf(
        *TWO, HOLD, joint("j", "a", "b", pose=TURNED, xyz="0 1 0.5", expressed_in="__model__")
    ),
    "an axis in a link frame": sdf(
        *TWO, HOLD, joint("j", "a", "b", pose=TURNED, xyz="0 1 0.5", expressed_in="a")
    ),
    "axes of 1.4 are in the model frame": sdf(
        *TWO, HOLD, joint("j", "a", "b", pose=TURNED, xyz="0 1 0.5"), version="1.4"
    ),
    "axes of 1.5 are in the joint frame": sdf(
        *TWO, HOLD, joint("j", "a", "b", pose=TURNED, xyz="0 1 0.5"), version="1.5"
    ),
    "axes of 1.6 in the model frame, by a flag": sdf(
        *TWO,
        HOLD,
        joint(
            "j",
            "a",
            "b",
            pose=TURNED,
            xyz="0 1 0.5",
            axis="<use_parent_model_frame>1</use_parent_model_frame>",
        ),
        version="1.6",
    ),
    "poses relative to links, joints and frames": sdf(
        link("a", "1 2 3 0.1 0.2 0.3"),
        HOLD,
        frame("f", TURNED, attached_to="a"),
        frame("g", "0 0 1 0 0.3 0", attached_to="a", relative_to="f"),
        link("b", "0.1 0.2 0.3 0.3 0 0", relative_to="g"),
        joint("j", "a", "b", pose="0.4 0 0 0 0 0.2", relative_to="f"),
        link("c", "0 0.5 0 0 0 0", relative_to="j"),
        joint("k", "b", "c", pose="0 0.1 0 0 0 0", relative_to="hold", xyz="0 1 0"),
    ),
    "joints between frames on links": sdf(
        *TWO,
        HOLD,
        frame("f", TURNED, attached_to="b"),
        frame("g", "0 0 0.3 0 0 0", attached_to="f"),
        joint("j", "a", "g", xyz="0 1 0"),
    ),
    "quaternions and degrees": sdf(
        '<link name="a"><pose rotation_format="quat_xyzw">1 2 3 0.1 0.2 0.3 0.9</pose>' + BODY + "</link>",
        '<link name="b"><pose degrees="true">0.5 -1 2 30 -45 60</pose>' + BODY + "</link>",
        HOLD,
        joint("j", "a", "b"),
    ),
    "a model that stands elsewhere": sdf(
        "<pose>3 2 1 0.3 0.2 0.1</pose>",
        *TWO,
        HOLD,
        joint("j", "a", "b"),
        joint("k", "world", "b2"),
        link("b2", "0 0 1 0 0 0"),
    ),
    "a frame that places the model": sdf(
        "<pose>3 2 1 0.3 0.2 0.1</pose>", *TWO, HOLD, joint("j", "a", "b"), attributes='placement_frame="b"'
    ),
    "two free links": sdf(*TWO, link("c", "0 0 2 0 0 0"), joint("j", "a", "b", pose=TURNED)),
    "a ball": sdf(*TWO, HOLD, joint("j", "a", "b", "ball", pose=TURNED, xyz="")),
    "a universal joint": sdf(
        *TWO, HOLD, joint("j", "a", "b", "universal", pose=TURNED, xyz="1 0 0", content=axis2("0 1 0"))
    ),
    "a screw": sdf(
        *TWO,
        HOLD,
        joint("j", "a", "b", "screw", pose=TURNED, content="<screw_thread_pitch>0.3</screw_thread_pitch>"),
        version="1.11",
    ),
    "an old screw": sdf(
        *TWO, HOLD, joint("j", "a", "b", "screw", pose=TURNED, content="<thread_pitch>20</thread_pitch>")
    ),
    "Drake's planar joint": sdf(
        *TWO,
        HOLD,
        '<drake:joint name="j" type="planar"><drake:parent>a</drake:parent><drake:child>b</drake:child>'
        "<drake:damping>0 0 0</drake:damping></drake:joint>",
        attributes='xmlns:drake="http://drake.mit.edu"',
    ),
    "links without inertia of their own": sdf(
        link("a", "1 0 0 0 0 0", ""),
        HOLD,
        link("b", "0 1 0 0 0 0", "<inertial><mass>3</mass></inertial>"),
        joint("j", "a", "b"),
    ),
    "a world that holds its robot": '<sdf version="1.10"><world name="w">'
    + frame("table", "0.1 0.2 1 0.3 0 0")
    + '<model name="small"><pose relative_to="table">0.5 0 0 0 0.2 0</pose>'
    + "".join(TWO)
    + joint("j", "a", "b", pose=TURNED)
    + "</model>"
    + joint("hold", "table", "small::a", "fixed", xyz="")
    + "</world></sdf>",
    "nested models": sdf(
        *TWO,
        HOLD,
        joint("j", "a", "b"),
        '<model name="inner" placement_frame="tip"><pose relative_to="b">0 0 1 0 0.3 0</pose>',
        frame("tip", "0.2 0 0 0 0 0.5"),
        link("c", "0.1 0 0 0 0 0"),
        link("d", "0.3 0.1 0 0 0 0"),
        joint("k", "c", "d", xyz="0 1 1", expressed_in="__model__"),
        "</model>",
        joint("l", "b", "inner::c", pose="0.1 0 0 0 0 0"),
        link("e", "0 0 0.2 0 0 0", relative_to="inner::d"),
        joint("m", "inner::tip", "e", xyz="1 0 0", expressed_in="inner::tip"),
    ),
}
"""Files without loops, for every convention; links a, b, ... have the same body."""
