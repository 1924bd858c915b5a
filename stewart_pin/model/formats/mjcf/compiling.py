"""MJCF through MuJoCo's own compiler (extra ``mjcf``), guarded: what could hang it or fill the memory is refused.

Defaults, includes, angles in degrees, inertia from shapes and everything else of the format mean what MuJoCo makes of
them. Meshes, height fields and textures that no inertia depends on are not opened, so they may be absent.
Names of parts, and what the file says besides the compiled model, are told here as well.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from lxml import etree

from stewart_pin.errors import FileFormatError, MissingExtraError
from stewart_pin.model.description import Span
from stewart_pin.model.formats.xml import UNLIMITED, ElementReader, read_xml, shown_tag
from stewart_pin.typing import FloatArray

# ----------------------------------------------------------------------------------------------------
# Names for the parts of MuJoCo's compiled model, also for those that the file leaves without one
# ----------------------------------------------------------------------------------------------------


class Names:
    """Hands out names of one kind that no other part bears.

    Attributes
    ----------
    taken
        Names that are in use.
    """

    def __init__(self, taken: Iterable[str]) -> None:
        self.taken = {name for name in taken if name}

    def fresh(self, wanted: str) -> str:
        """Invent a name.

        Parameters
        ----------
        wanted
            The name, unless it is in use; then a number is added.

        Returns
        -------
        str
            A name that is in use from now on.
        """
        name, number = wanted, 2
        while name in self.taken:
            name, number = f"{wanted}_{number}", number + 1
        self.taken.add(name)
        return name


def given_names(model: Any, part: str, count: int) -> list[str]:
    """List the names that a file gives to its bodies, joints or other parts.

    Parameters
    ----------
    model
        ``mujoco.MjModel``.
    part
        ``body``, ``joint``, ``site``, ``equality``, ``actuator``, ``tendon`` or ``key``.
    count
        How many there are.

    Returns
    -------
    list of str
        In MuJoCo's order; empty where the file gives none.
    """
    access = getattr(model, part)
    return [str(access(k).name) for k in range(count)]


# ----------------------------------------------------------------------------------------------------
# What an MJCF says besides MuJoCo's own model: shapes as they look, and words of ours in ``<custom>``
# ----------------------------------------------------------------------------------------------------

PLATFORM = "platform"
"""Name of the ``<text>`` that names the platform, and of the platform where there is none."""
HOME, ASSEMBLED = "home", "assembled"
"""Name and data of the ``<text>`` that lets home stay where the keyframe has it."""
SPEED = "velocity:"
"""Begins the names of the ``<numeric>`` that hold speed limits, for which MuJoCo has no word."""
SPRING = "spring:"
"""The same for what MuJoCo cannot say of a spring: rest, constant force, coefficients of stiffness by powers."""
_GREY = (0.5, 0.5, 0.5, 1.0)


@dataclass(frozen=True)
class GeomSource:
    """What a compiled geom does not tell: the mesh that it stands for, and what it looks like.

    Attributes
    ----------
    mesh
        File of the mesh as the MJCF names it; empty: none.
    scale
        Scale of the mesh (dimensionless).
    folder
        Folder from which the paths of mesh and texture start.
    material
        Name of its material.
    rgba
        Its colour (dimensionless); None: MuJoCo's grey.
    texture
        Picture on it.
    left_out
        Why it is no shape of ours; empty: it is one.
    """

    mesh: str = ""
    scale: tuple[float, float, float] = (1.0, 1.0, 1.0)
    folder: str = ""
    material: str = ""
    rgba: tuple[float, float, float, float] | None = None
    texture: str = ""
    left_out: str = ""


@dataclass(frozen=True)
class Asides:
    """What a file says besides MuJoCo's own model.

    Attributes
    ----------
    geoms
        Source of every geom, by MuJoCo's number.
    platform
        Body or site that ``<text name="platform">`` names, else ``platform``.
    speeds
        Speed limits of joints, from ``<numeric name="velocity:JOINT">``, one number for both sides [m/s or rad/s].
    assembled
        Whether ``<text name="home" data="assembled">`` lets home stay where it is, whatever the limits say.
    strangers
        Names of texts and numbers that are none of these.
    springs
        Springs of joints besides MuJoCo's, from ``<numeric name="spring:JOINT">``: rest, constant force, stiffness by
        powers of the displacement [m or rad, N or N m, and so on].
    deformable
        Names of deformable bodies on the ground, which are taken away: they meet the mechanism by contacts alone.
    """

    geoms: Mapping[int, GeomSource]
    platform: str
    speeds: Mapping[str, float | Span]
    assembled: bool = False
    strangers: tuple[str, ...] = ()
    springs: Mapping[str, FloatArray] = field(default_factory=dict)
    deformable: tuple[str, ...] = ()


class AsideReader:
    """Keeps what the specification of a file says before it is stripped and compiled.

    Parameters
    ----------
    mujoco
        The package.
    spec
        ``mujoco.MjSpec``, not stripped yet.
    """

    def __init__(self, mujoco: Any, spec: Any) -> None:
        self.sources = [(geom, _geom_source(mujoco, spec, geom)) for geom in spec.geoms]
        self.texts = {text.name: str(text.data) for text in spec.texts}
        self.speeds = {
            number.name.removeprefix(SPEED): _speed(number.data)
            for number in spec.numerics
            if number.name.startswith(SPEED) and number.size in (1, 2)
        }
        self.springs = {
            number.name.removeprefix(SPRING): np.array(number.data, dtype=float)
            for number in spec.numerics
            if number.name.startswith(SPRING) and number.size >= 2
        }
        known = {*(SPEED + name for name in self.speeds), *(SPRING + name for name in self.springs)}
        self.others = [number.name for number in spec.numerics if number.name not in known]

    def read(self) -> Asides:
        """Say what was kept, once the specification is compiled and its geoms are numbered.

        Returns
        -------
        Asides
            What the file says besides.
        """
        geoms = {int(geom.id): source for geom, source in self.sources}
        assembled = self.texts.get(HOME) == ASSEMBLED
        strangers = [*(name for name in self.texts if name not in (PLATFORM, HOME)), *self.others]
        return Asides(
            geoms,
            self.texts.get(PLATFORM, PLATFORM),
            self.speeds,
            assembled,
            strangers=tuple(strangers),
            springs=self.springs,
        )


def _geom_source(mujoco: Any, spec: Any, geom: Any) -> GeomSource:
    """Keep what a geom loses before it is compiled.

    Parameters
    ----------
    mujoco
        The package.
    spec
        ``mujoco.MjSpec``, not stripped yet.
    geom
        One of its geoms.

    Returns
    -------
    GeomSource
        Mesh, material and colour.
    """
    told = tuple(float(value) for value in geom.rgba)
    red, green, blue, opacity = told
    rgba = None if np.allclose(told, _GREY, rtol=0, atol=1e-6) else (red, green, blue, opacity)
    look = GeomSource(rgba=rgba)
    material = spec.material(geom.material) if geom.material else None
    if material is not None and rgba is None:
        red, green, blue, opacity = (float(value) for value in material.rgba)
        picture = next((name for name in material.textures if name), "")
        texture = spec.texture(picture) if picture else None
        look = GeomSource(
            material=material.name,
            rgba=(red, green, blue, opacity),
            texture="" if texture is None else texture.file,
            folder=str(_asset_folder(spec, spec.texturedir)),
        )
    if geom.hfieldname:
        return replace(look, left_out="a height field is no shape of ours: left out")
    if not geom.meshname:
        return look
    mesh = spec.mesh(geom.meshname)
    if geom.type != mujoco.mjtGeom.mjGEOM_MESH or mesh is None or not mesh.file:
        return replace(look, left_out="fitted to a mesh, or a mesh of numbers or formulas: left out")
    x, y, z = (float(value) for value in mesh.scale)
    return replace(look, mesh=mesh.file, scale=(x, y, z), folder=str(_asset_folder(spec, spec.meshdir)))


def _asset_folder(spec: Any, folder: str) -> Path:
    return (Path(spec.modelfiledir) / folder).resolve()


def _speed(data: Any) -> float | Span:
    """Read the largest speed to both sides, or the least and the greatest, beyond what no joint reaches none."""
    ends = [float(value) if abs(value) < UNLIMITED else float(np.copysign(np.inf, value)) for value in data]
    return ends[0] if len(ends) == 1 else (ends[0], ends[1])


# ----------------------------------------------------------------------------------------------------

_MOST_ELEMENTS = 20_000
"""Elements of a file, with its includes and replicas: more than any robot, and compiled in seconds."""
_MOST_CELLS = 4_000_000
"""Cells of a height field, which the compiler fills while it reads."""
_MOST_FACETS = 200
"""Resolution of a mesh made from a formula; the time to compile one grows with its cube."""
_NAMES = frozenset(
    {
        "name", "model", "class", "childclass", "prefix", "file", "body", "body1", "body2", "target", "joint", "joint1",
        "joint2", "jointinparent", "site", "site1", "site2", "cranksite", "slidersite", "refsite", "sidesite", "geom",
        "geom1", "geom2", "tendon", "tendon1", "tendon2", "actuator", "mesh", "hfield", "material", "texture",
        "objname", "refname", "plugin", "instance",
    }
)  # fmt: skip
"""Attributes of MJCF that hold names, in which ``nan`` is a word."""
_DEFORMABLE = ("flex", "flexcomp")
_UNUSED = (
    "sensors", "numerics", "texts", "tuples", "pairs", "excludes", "skins", "hfields", "textures", "materials",
    "cameras", "lights",
)  # fmt: skip
"""Parts of MuJoCo's specification that no mechanism needs, after those that refer to them."""


def import_mujoco() -> Any:
    """Import MuJoCo.

    Returns
    -------
    module
        The package ``mujoco``.

    Raises
    ------
    MissingExtraError
        If it is not installed.
    """
    try:
        import mujoco  # noqa: PLC0415
    except ImportError:
        raise MissingExtraError("mujoco", "mjcf") from None
    return mujoco


def compile_mjcf(path: Path) -> tuple[Any, Asides, tuple[str, ...]]:
    """Compile a file to MuJoCo's model.

    Parameters
    ----------
    path
        File to read; what it includes is found as MuJoCo does, beside it.

    Returns
    -------
    model : mujoco.MjModel
        The model, without sensors, textures and other parts that are no mechanism.
    asides : Asides
        What the file says besides.
    warnings : tuple of str
        What MuJoCo warns of.

    Raises
    ------
    MissingExtraError
        If MuJoCo is not installed.
    FileFormatError
        If MuJoCo refuses the file, or the file asks for more than a mechanism needs.
    """
    mujoco = import_mujoco()
    _Guard(path).run()
    try:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            spec = mujoco.MjSpec.from_file(str(path))
            deformable = _take_deformable(spec)
            asides = AsideReader(mujoco, spec)
            _strip(mujoco, spec)
            model = spec.compile()
        told = replace(asides.read(), deformable=deformable)
        return model, told, tuple(" ".join(str(warning.message).split()) for warning in caught)
    # Its exceptions have no base of their own: ValueError for what a file says, RuntimeError for what befell it.
    except (ValueError, RuntimeError, mujoco.FatalError, mujoco.UnexpectedError) as error:
        said = " ".join(str(error).replace("Element name '', ", "").split())
        raise FileFormatError(
            f"MuJoCo refuses the file: {said or type(error).__name__}{_remedy(said)}",
            path=str(path),
            culprit="<mujoco>",
        ) from None


def _remedy(said: str) -> str:
    if "opening file" not in said and "resource" not in said:
        return ""
    return (
        "; put the file where the model looks for it (meshes are opened only where a body takes its inertia from "
        "them: give it an <inertial>)"
    )


def _take_deformable(spec: Any) -> tuple[str, ...]:
    """Take away deformable bodies, with the bodies that MuJoCo made for their nodes; `_Guard` saw what they hang on."""
    names: list[str] = []
    for flex in list(spec.flexes):
        names.append(flex.name)
        nodes = sorted({*flex.vertbody, *flex.nodebody})
        for equality in list(spec.equalities):
            if "FLEX" in str(equality.type) and equality.name1 == flex.name:
                spec.delete(equality)
        spec.delete(flex)  # before its bodies: MuJoCo crashes in the other order
        for node in nodes:
            spec.delete(spec.body(node))
    return tuple(names)


def _strip(mujoco: Any, spec: Any) -> None:
    """Take away what is no mechanism, before the compiler opens files for it or sets memory aside."""
    for geom in spec.geoms:
        geom.material = ""
        if (geom.meshname or geom.hfieldname) and not _weighs(mujoco, geom):
            geom.type = mujoco.mjtGeom.mjGEOM_SPHERE
            geom.size = [1.0, 1.0, 1.0]
            geom.meshname = geom.hfieldname = ""
    for owner in [*spec.sites, *spec.tendons]:
        owner.material = ""
    needed = {geom.meshname for geom in spec.geoms}
    surplus = [mesh for mesh in spec.meshes if mesh.name not in needed]
    for part in _UNUSED:
        surplus += getattr(spec, part)
    for element in surplus:
        spec.delete(element)
    spec.nkey = spec.nuserdata = 0
    for user in ("body", "jnt", "geom", "site", "cam", "tendon", "actuator", "sensor"):
        setattr(spec, f"nuser_{user}", -1)
    spec.memory = -1


def _weighs(mujoco: Any, geom: Any) -> bool:
    """Tell whether a body takes part of its inertia from a shape."""
    body, compiler = geom.parent, geom.compiler
    if (
        body.name == "world"
        or geom.hfieldname
        or geom.mass == 0
        or (geom.mass != geom.mass and geom.density == 0)
    ):
        return False
    wanted = compiler.inertiafromgeom
    if wanted == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE:
        return False
    if wanted == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_AUTO and body.explicitinertial:
        return False
    first, last = compiler.inertiagrouprange
    return first <= geom.group <= last


class _Guard(ElementReader):
    """Reads a file and what it includes before MuJoCo does, and refuses what its compiler would not survive."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self.folder = path.parent
        self.elements = 0
        self.attached = 0  # models within which the reader is; their bodies may be hung on any link

    def run(self) -> None:
        root = read_xml(Path(self.path))
        if root.tag != "mujoco":
            raise self.error(
                f"the root element is <{shown_tag(root)}>, an MJCF file has <mujoco>", "<mujoco>"
            )
        self._file(root, 1, (Path(self.path).resolve(),))

    def _file(self, root: etree._Element, copies: int, inside: tuple[Path, ...]) -> None:
        for element, count in self._elements(root, copies):
            self._element(element)
            if element.tag in ("include", "model") and element.get("file"):
                self._included(element, count, inside)

    def _included(self, element: etree._Element, count: int, inside: tuple[Path, ...]) -> None:
        for folder in dict.fromkeys((self.folder, inside[-1].parent)):
            path = (folder / element.get("file", "")).resolve()
            # MuJoCo names missing files itself, and files that include themselves.
            if path.is_file() and path not in inside:
                self.attached += element.tag == "model"
                self._file(read_xml(path), count, (*inside, path))
                self.attached -= element.tag == "model"

    def _elements(self, root: etree._Element, copies: int) -> Iterator[tuple[etree._Element, int]]:
        stack = [(root, copies)]
        while stack:
            element, count = stack.pop()
            self.elements += count
            if self.elements > _MOST_ELEMENTS:
                raise self.error(
                    f"the file has more than {_MOST_ELEMENTS} elements, with what <{shown_tag(element)}> (line "
                    f"{element.sourceline}) and others repeat; no robot needs so many",
                    f"<{shown_tag(element)}>",
                )
            yield element, count
            if element.tag == "replicate":
                # What is no number MuJoCo names; a sign or a point may hide a large one.
                count *= max(1, int(min(_magnitude(element.get("count", "1")), _MOST_ELEMENTS + 1)))
            stack += [(child, count) for child in element.iterchildren(etree.Element)]

    def _element(self, element: etree._Element) -> None:
        tag, line = shown_tag(element), element.sourceline
        if tag in _DEFORMABLE:
            if tag == "flex" or self.attached or not _stands_on_the_ground(element):
                raise self.error(
                    f"<{tag}> (line {line}): deformable bodies are no links; remove it, or use a rigid body (a "
                    "<flexcomp> of few points that hangs on no link is left out)",
                    f"<{tag}>",
                )
            self.elements += _points(element)
        for name, value in element.attrib.items():
            is_name = name in _NAMES or (tag, name) == ("text", "data")
            if not is_name and "nan" in value.lower().replace("+", "").replace("-", "").split():
                raise self.error(
                    f"{name} of <{tag}> (line {line}) holds 'nan', which is no number", f"<{tag}>"
                )
        sizes = [_magnitude(element.get(name, "1")) for name in ("nrow", "ncol")]
        if tag == "hfield" and sizes[0] * sizes[1] > _MOST_CELLS:
            raise self.error(
                f"<hfield> (line {line}) has more than {_MOST_CELLS} cells; remove it", "<hfield>"
            )
        if tag == "mesh" and element.get("builtin"):
            finest = max((_magnitude(word) for word in element.get("params", "").split()), default=0.0)
            if finest > _MOST_FACETS:
                raise self.error(
                    f"<mesh builtin> (line {line}) has a resolution above {_MOST_FACETS}; make it coarser",
                    "<mesh>",
                )


def _stands_on_the_ground(element: etree._Element) -> bool:
    """Tell whether a deformable body hangs on no body that moves, all of its points are its own, and are few."""
    kind, pinned = element.get("type", "grid"), element.find("pin")
    above = list(element.iterancestors("body"))
    moving = {
        next(each.iterancestors("body"), None)
        for tag in ("joint", "freejoint")
        for body in above
        for each in body.iter(tag)
    }
    return (
        next(element.iterancestors("worldbody"), None) is not None
        and kind in ("grid", "box", "cylinder", "ellipsoid")
        and element.get("dof", "full") != "rigid"
        and element.get("rigid", "false") != "true"
        and pinned is None
        and not moving.intersection(above)
        and _points(element) < _MOST_ELEMENTS
    )


def _points(element: etree._Element) -> int:
    counts = (_magnitude(word) for word in element.get("count", "").split())
    return int(min(np.prod([max(1.0, count) for count in counts]), _MOST_ELEMENTS))


def _magnitude(text: str) -> float:
    try:
        return abs(float(text))
    except ValueError:
        return 0.0
