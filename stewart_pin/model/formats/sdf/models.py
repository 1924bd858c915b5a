"""Which model an SDFormat file is about, with the models nested in it and the files that it includes."""

from __future__ import annotations

from collections.abc import Iterable
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from lxml import etree

from stewart_pin.errors import FileFormatError, StewartPinError, UnsupportedError
from stewart_pin.model.description import Note, Outcome
from stewart_pin.model.formats.sdf.elements import SdfReader, held_model, title, why_ignored
from stewart_pin.model.formats.sdf.frames import MODEL, Scope, check_names
from stewart_pin.model.formats.sdf.words import WORDS
from stewart_pin.model.formats.xml import ElementReader, read_xml, shown_tag

# ----------------------------------------------------------------------------------------------------
# Which file an ``<include>`` means: one in the folder of the file that was opened, and no other
# ----------------------------------------------------------------------------------------------------


_BY_NAME = "model://"


class IncludedFiles:
    """The folder of a file, in which what it includes is looked up.

    ``model://arm`` is the folder ``arm`` there, as a simulator finds it whose model path is that folder; where a
    ``model.config`` beside the file makes the folder itself a model, it may also be the folder ``arm`` next to it. A
    relative path starts beside the file that includes.

    Parameters
    ----------
    folder
        Folder of the file that was opened.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def find(self, reader: ElementReader, uri: str, owner: str) -> Path:
        """Find an included file.

        Parameters
        ----------
        reader
            Reader of the file that includes it.
        uri
            What stands in ``<uri>``.
        owner
            Named in the message.

        Returns
        -------
        pathlib.Path
            The file, which need not exist.

        Raises
        ------
        FileFormatError
            If a folder's model.config names no file.
        UnsupportedError
            If it would lie elsewhere.
        """
        by_name = uri.startswith(_BY_NAME)
        plain = uri.removeprefix(_BY_NAME).removeprefix("file://")
        start = self.folder if by_name else Path(reader.path).parent
        is_neighbour = by_name and self._is_neighbour(plain)
        if is_neighbour:
            start = self.folder.resolve().parent
        elif "://" in plain or self._leads_away(start, plain, self.folder):
            raise UnsupportedError(
                f"{reader.path}: {owner}: '{uri}' may lie anywhere, and only files within {self.folder} are opened; "
                "give the path of the file relative to this one, or put its <model> here"
            )
        if by_name and not (start / plain).exists():
            raise UnsupportedError(
                f"{reader.path}: {owner}: '{uri}' would be looked up in a simulator's model path; give the path of the "
                f"file relative to this one, or put its <model> here, or its folder as '{plain}' into {self.folder}"
            )
        path = start / plain
        if not path.is_dir():
            return path
        # A folder says in model.config which file holds the model; the newest format comes last.
        files: Iterable[etree._Element] = read_xml(path / "model.config").findall("sdf")

        def age(element: etree._Element) -> list[int]:
            return [int(part) if part.isdecimal() else 0 for part in element.get("version", "").split(".")]

        newest = max(files, key=age, default=None)
        name = "" if newest is None else (newest.text or "").strip()
        if not name or self._leads_away(path, name, path if is_neighbour else self.folder):
            raise reader.error(f"{owner}: {path / 'model.config'} names no <sdf> file beside it", uri)
        return path / name

    def _is_neighbour(self, name: str) -> bool:
        """Tell whether a model of that name stands next to the folder, both in one collection of models."""
        here, beside = self.folder.resolve(), self.folder.resolve().parent / name
        config = "model.config"
        return (
            PurePosixPath(name).name == name
            and not (here / name).exists()
            and (here / config).is_file()
            and (beside / config).is_file()
            and beside.resolve() == beside
        )

    def _leads_away(self, start: Path, plain: str, within: Path) -> bool:
        """Tell a path that is absolute, climbs, or leaves a folder by a link."""
        steps = PurePosixPath(plain.replace("\\", "/"))
        if steps.is_absolute() or ".." in steps.parts or Path(plain).is_absolute():
            return True
        return not (start / plain).resolve().is_relative_to(within.resolve())


# ----------------------------------------------------------------------------------------------------

_OLDEST, _NEWEST = (1, 3), (1, 12)
_SCENERY = {
    "model", "include", "frame", "gravity", "physics", "joint", "plugin", "light", "actor", "audio", "wind",
    "magnetic_field", "atmosphere", "gui", "scene", "road", "spherical_coordinates", "state", "population",
}  # fmt: skip
_MODELS = 1000
"""How many models a file may nest or include, so that files that include each other end."""
_DEPTH = 50
"""How deep they may be nested."""


@dataclass(frozen=True, eq=False)
class SdfDocument:
    """The robot of a file.

    Attributes
    ----------
    model
        Its outermost model, or the world where several models are the robot.
    world
        The world around it, or None.
    gravity
        (3,) acceleration of free fall that the world states [m/s²], or None.
    notes
        What was found; the readers of all parts write here.
    """

    model: Scope
    world: Scope | None
    gravity: tuple[float, float, float] | None
    notes: list[Note]


def open_document(path: Path) -> SdfDocument:
    """Open a file, and find its robot.

    Parameters
    ----------
    path
        File with ``<sdf>`` as its root.

    Returns
    -------
    SdfDocument
        The robot, with all frames known by name.

    Raises
    ------
    FileFormatError
        If the file is broken, or holds no model, or several without joints.
    UnsupportedError
        If it includes a model that stands elsewhere than in the folder of the file.
    """
    return _Opener(path).document()


@dataclass(frozen=True)
class _Glance:
    """What a model of a world is at first sight: whether it has joints, and whether it stands still."""

    has_joints: bool
    is_static: bool


class _Opener:
    def __init__(self, path: Path) -> None:
        self.path = path
        self.library = IncludedFiles(path.parent)
        self.notes: list[Note] = []
        self.count = 0

    def document(self) -> SdfDocument:
        reader, root, version = self._open(self.path)
        worlds, models = reader.children(root, "world"), reader.children(root, "model")
        if len(worlds) + len(models) != 1:
            names = ", ".join(f"'{element.get('name', '')}'" for element in [*worlds, *models])
            raise reader.error(
                f"the file has {len(worlds)} <world> and {len(models)} <model> ({names or 'none'}); keep one",
                "<sdf>",
            )
        for element in root.iterchildren(etree.Element):
            if shown_tag(element) not in ("world", "model"):
                tag = shown_tag(element)
                reader.refuse_slip(tag, ("world", "model"), element, f"<{tag}>", "the file")
                reader.note("the file", f"<{shown_tag(element)}>: only the model is read")
        if models:
            return SdfDocument(self._model(reader, models[0], version, None, "", 0), None, None, self.notes)
        return self._from_world(reader, worlds[0], version)

    def _open(self, path: Path) -> tuple[SdfReader, etree._Element, tuple[int, ...]]:
        reader, root = SdfReader(path, self.notes), read_xml(path)
        if root.tag != "sdf":
            raise reader.error(
                f"the root element is <{shown_tag(root)}>, an SDFormat file has <sdf>", f"<{shown_tag(root)}>"
            )
        text = reader.text(root, "version", "the file").strip()
        numbers = text.split(".")
        version = tuple(
            int(part) for part in numbers if part.isascii() and part.isdecimal() and len(part) < 5
        )
        if len(version) != len(numbers) or not _OLDEST <= version[:2] <= _NEWEST:
            raise reader.error(
                f"<sdf version='{text}'>: versions 1.3 to 1.12 are read; convert other files with 'gz sdf -p'",
                "<sdf>",
            )
        return reader, root, version

    def _from_world(self, reader: SdfReader, world: etree._Element, version: tuple[int, ...]) -> SdfDocument:
        owner = f"world '{world.get('name', '')}'"
        _note_scenery(reader, world, owner)
        around = Scope(reader, world, "", version)
        _enter_frames(around)
        inside = [e for e in world.iterchildren(etree.Element) if shown_tag(e) in ("model", "include")]
        chosen = self._robots(reader, world, inside, owner)
        self.count = 0
        for element in inside:
            if element not in chosen:
                reader.note(owner, f"<{shown_tag(element)}> '{title(element)}': another model")
        alone = len(chosen) == 1
        for element in chosen:
            if shown_tag(element) == "include":
                model = self._include(reader, element, around, "", 0, alone=alone)
            else:
                prefix = "" if alone else f"{reader.name(element)}::"
                model = self._model(reader, element, version, around, prefix, 0)
            own_name = element.get("name") or (element.findtext("name") or "").strip()
            name = own_name or model.element.get("name", "")
            if name in around.nested:
                raise reader.error(f"{owner} has two models called '{name}'; rename one", name)
            around.nested[name] = model
        if not alone:
            names = ", ".join(f"'{name}'" for name in around.nested)
            text = f"models {names}: read as one mechanism, their links and joints as model::name"
            reader.note(owner, text, Outcome.CHANGED)
        robot = next(iter(around.nested.values())) if alone else around
        return SdfDocument(robot, around, _gravity(reader, world, owner), self.notes)

    def _robots(
        self, reader: SdfReader, world: etree._Element, inside: list[etree._Element], owner: str
    ) -> list[etree._Element]:
        """Choose the models of a world that have joints, and what they hold, or else the only one that moves."""
        closed: dict[etree._Element, str] = {}
        glances: dict[etree._Element, _Glance] = {}
        for element in inside:
            self.count = 0
            try:
                glances[element] = self._glance(reader, element, 0)
            except StewartPinError as error:  # a sun or a house of a simulator's library is no robot
                closed[element] = str(error)
        jointed = [e for e, glance in glances.items() if glance.has_joints]
        moving = [e for e in inside if e in closed or not glances[e].is_static]
        robots = [e for e in jointed if e in moving] or jointed
        candidates = robots or next(
            (found for found in (moving, inside) if len(found) == 1), moving or inside
        )
        tied = _tied(world, inside, robots)
        if len(candidates) != 1 and not robots and not tied:
            names = ", ".join(f"'{title(element)}'" for element in candidates) or "none"
            why = "".join(f"; {closed[element]}" for element in candidates if element in closed)
            raise reader.error(
                f"{owner} has not one model that may be the robot, but: {names}; load the file of the robot alone, or "
                f"remove the others{why}",
                owner,
            )
        chosen = [*tied, *(robots or ([] if tied else candidates))]
        return [element for element in inside if element in chosen]

    def _glance(self, reader: SdfReader, element: etree._Element, depth: int) -> _Glance:
        """Look whether a model, or one that it nests or includes, has joints; a file is opened, and nothing noted."""
        self.count += 1
        if depth > _DEPTH or self.count > _MODELS:
            raise self._too_many(reader, element)
        owner = f"<{shown_tag(element)}> '{title(element)}'"
        static = reader.flag(element, "static", owner)
        if shown_tag(element) == "include":
            path = self.library.find(reader, reader.content(element, "uri", owner), owner)
            inner = SdfReader(path, [])
            models = inner.children(read_xml(path), "model")
            glances = [self._glance(inner, model, depth + 1) for model in models]
            # What <include> says of it comes before what the model says.
            if not reader.children(element, "static"):
                static = any(glance.is_static for glance in glances)
            return _Glance(any(glance.has_joints for glance in glances), static)
        inside = [e for e in element.iterchildren(etree.Element) if shown_tag(e) in ("model", "include")]
        jointed = any(reader.children(element, tag) for tag in ("joint", "drake:joint"))
        return _Glance(jointed or any(self._glance(reader, e, depth + 1).has_joints for e in inside), static)

    @staticmethod
    def _too_many(reader: SdfReader, element: etree._Element) -> FileFormatError:
        return reader.error(
            f"more than {_MODELS} models, or more than {_DEPTH} inside each other, at line "
            f"{element.sourceline}; do files include each other?",
            "<model>",
        )

    def _model(
        self,
        reader: SdfReader,
        element: etree._Element,
        version: tuple[int, ...],
        parent: Scope | None,
        prefix: str,
        depth: int,
    ) -> Scope:
        self.count += 1
        if depth > _DEPTH or self.count > _MODELS:
            raise self._too_many(reader, element)
        name = reader.name(element)
        owner = f"model '{name}'"
        for child in reader.children(element, "include"):
            if reader.flag(child, "merge", owner, attribute=True):
                self._merge(reader, child, version, owner)
        static = reader.flag(element, "static", owner) or (parent is not None and parent.static)
        frame = element.get("placement_frame", "")
        scope = Scope(reader, element, prefix, version, parent, placement_frame=frame, static=static)
        reader.note_strangers(element, owner, WORDS["model"])
        _enter_frames(scope)
        for child in element.iterchildren(etree.Element):
            match shown_tag(child):
                case "model":
                    inner = f"{prefix}{reader.name(child)}::"
                    nested = self._model(reader, child, version, scope, inner, depth + 1)
                case "include":
                    nested = self._include(reader, child, scope, prefix, depth + 1)
                case _:
                    continue
            inner = nested.prefix.removeprefix(prefix).removesuffix("::")
            if inner in scope.nested or inner in scope.elements:
                raise reader.error(
                    f"{owner} has two elements called '{inner}' (line {child.sourceline}); rename one", inner
                )
            scope.nested[inner] = nested
        return scope

    def _include(
        self,
        reader: SdfReader,
        element: etree._Element,
        parent: Scope,
        prefix: str,
        depth: int,
        *,
        alone: bool = False,
    ) -> Scope:
        """Take in the model of another file; the ``<include>`` may give it another name and place."""
        owner = f"<include> (line {element.sourceline}) of {parent.owner}"
        uri = reader.content(element, "uri", owner)
        if reader.flag(element, "merge", owner, attribute=True):
            raise UnsupportedError(
                f"{reader.path}: {owner} merges the model of '{uri}' into a world, which has no links; let a <model> "
                "include it"
            )
        inner, model, version = self._included(reader, element, owner)
        given = reader.children(element, "name")
        name = reader.content(element, "name", owner) if given else inner.name(model)
        inside = "" if alone else f"{prefix}{name}::"
        scope = self._model(inner, model, version, parent, inside, depth)
        if reader.children(element, "static"):
            for part in scope.models():
                part.static = reader.flag(element, "static", owner) or parent.static
        if reader.children(element, "pose"):
            scope.placing = (reader, element)
            if reader.children(element, "placement_frame"):
                scope.placement_frame = reader.content(element, "placement_frame", owner)
        return scope

    def _included(
        self, reader: SdfReader, element: etree._Element, owner: str
    ) -> tuple[SdfReader, etree._Element, tuple[int, ...]]:
        """Open the one model of the file that an ``<include>`` names."""
        uri = reader.content(element, "uri", owner)
        if reader.children(element, "experimental:params"):
            raise UnsupportedError(
                f"{reader.path}: {owner} changes the model of '{uri}'; put its elements into the file"
            )
        reader.note_strangers(element, owner, WORDS["include"])
        inner, root, version = self._open(self.library.find(reader, uri, owner))
        models = inner.children(root, "model")
        if len(models) != 1:
            raise inner.error(
                f"the file is included by {reader.path}, and has {len(models)} <model>; keep one", uri
            )
        return inner, models[0], version

    def _merge(
        self, reader: SdfReader, element: etree._Element, version: tuple[int, ...], model: str
    ) -> None:
        """Put the elements of an included model in the place of its ``<include>``; a frame stands for the model's own.

        The rules are those of libsdformat: what stands in the frame of the model, or names it, stands in that frame.
        """
        owner = f"<include merge='true'> (line {element.sourceline}) of {model}"
        inner, included, inner_version = self._included(reader, element, owner)
        uri = reader.content(element, "uri", owner)
        fault = ""
        if min(version, inner_version) < _MERGING:
            fault = "one of both files is older than version 1.7, before which frames meant something else"
        elif inner.children(included, "include"):
            fault = "it includes other models itself"
        elif included.get("placement_frame") or reader.children(element, "placement_frame"):
            fault = "it is placed by a placement_frame"
        if fault:
            raise UnsupportedError(
                f"{reader.path}: {owner} cannot merge the model of '{uri}': {fault}; put its elements into the file, "
                "or include it without merge"
            )
        given = reader.children(element, "name")
        name = reader.content(element, "name", owner) if given else inner.name(included)
        proxy = f"{MERGED}{name}__model__"
        links = [inner.name(link) for link in inner.children(included, "link")]
        carrier = included.get("canonical_link") or next(iter(links), "")
        if not carrier:
            raise inner.error(
                f"model '{name}' is merged into {model}, and has no <link>; include it without merge", name
            )
        frame = etree.Element("frame", name=proxy, attached_to=carrier)
        placed = reader.optional(element, "pose", owner)
        pose = deepcopy(inner.optional(included, "pose", owner) if placed is None else placed)
        pose = etree.Element("pose") if pose is None else pose
        if not pose.get("relative_to"):
            pose.set("relative_to", MODEL)
        frame.append(pose)
        merged = [deepcopy(child) for child in included.iterchildren(etree.Element)]
        merged = [child for child in merged if shown_tag(child) in _MERGED_TAGS or ":" in shown_tag(child)]
        for child in merged:
            _refer_to(child, proxy)
        folder = Path(inner.path).resolve().parent
        for mesh in (uri for child in merged for uri in child.iterfind(".//mesh/uri")):
            text = (mesh.text or "").strip()
            mesh.text = text if "://" in text else str(folder / text)
        if any(reader.flag(each, "static", owner) for each in (element, included)):
            reader.note(owner, "<static>: left out of a merged model, as libsdformat does")
        text = f"the links, joints and frames of '{uri}' are merged into the model"
        reader.note(owner, text, Outcome.KEPT)
        parent = element.getparent()
        assert parent is not None
        at = parent.index(element)
        parent.remove(element)
        for child in reversed([frame, *merged]):
            parent.insert(at, child)


MERGED = "_merged__"
"""How the name of a frame begins that stands for that of a merged model."""
_MERGING = (1, 7)
"""Version from which on frames have names, and axes stand in that of their joint."""
_MERGED_TAGS = ("link", "joint", "frame", "model", "gripper", "plugin")


def _refer_to(element: etree._Element, proxy: str) -> None:
    """Let an element of a merged model refer to the frame that stands for the model's."""

    def renamed(holder: etree._Element | None, attribute: str, *, always: bool = False) -> None:
        if holder is not None and holder.get(attribute, "") in (MODEL, *([""] if always else [])):
            holder.set(attribute, proxy)

    tag = shown_tag(element)
    if tag in ("link", "model") and element.find("pose") is None:
        etree.SubElement(element, "pose")
    renamed(element.find("pose"), "relative_to", always=tag in ("link", "model"))
    if tag == "frame":
        renamed(element, "attached_to", always=True)
    if tag == "joint":
        for end in (element.find("parent"), element.find("child")):
            if end is not None and (end.text or "").strip() == MODEL:
                end.text = proxy
        for axis in ("axis/xyz", "axis2/xyz"):
            renamed(element.find(axis), "expressed_in")


_NOTED = {
    "state": "a state of a simulation: links stand where the model puts them",
    "population": "copies of models; only the robot is read",
}


def _note_scenery(reader: SdfReader, world: etree._Element, owner: str) -> None:
    """Note what stands in the world around the robot, and stop at what could hold the robot."""
    for element in world.iterchildren(etree.Element):
        tag = shown_tag(element)
        if tag == "plugin":
            reader.note(owner, f"<plugin> '{element.get('name', '')}': {why_ignored(reader, element, owner)}")
        elif tag in _NOTED:
            reader.note(owner, f"<{tag}>: {_NOTED[tag]}")
        elif tag not in _SCENERY:
            reader.refuse_slip(tag, WORDS["world"].tags, element, f"<{tag}>", owner)
            reader.note(f"{owner}, line {element.sourceline}", f"<{tag}>: only the robot is read")


def _gravity(reader: SdfReader, world: etree._Element, owner: str) -> tuple[float, float, float] | None:
    """Read gravity; up to version 1.5 it stood in ``<physics>``, of which the one marked as the default counts."""
    every = reader.children(world, "physics")
    for element in every:
        for child in element.iterchildren(etree.Element):
            tag = shown_tag(child)
            if tag != "gravity":
                reader.refuse_slip(tag, ("gravity",), child, f"<{tag}> of <physics>", owner)
    marked = [e for e in every if reader.flag(e, "default", owner, attribute=True)]
    counts = [*marked, *every][:1]
    for element in every:
        if element not in counts:
            text = f"<physics> '{element.get('name', '')}' (line {element.sourceline}): another one counts"
            reader.note(owner, text)
    found = [holder for holder in (world, *counts) if reader.children(holder, "gravity")]
    if not found:
        return None
    if len(found) > 1:
        reader.note(owner, "<gravity> of <physics>: that of the world counts")
    x, y, z = (float(value) for value in reader.vector(found[0], "gravity", 3, owner))
    return x, y, z


def _tied(
    world: etree._Element, inside: list[etree._Element], robots: list[etree._Element]
) -> list[etree._Element]:
    """Find the models that joints of the world hold, and those that the plugins of robots do."""
    ends = [
        end for joint in world.findall("joint") for end in (*joint.findall("parent"), *joint.findall("child"))
    ]
    heads = {(end.text or "").strip().partition("::")[0] for end in ends}
    tied = [element for element in inside if title(element) in heads]
    waiting = [*robots, *tied]
    while waiting:
        held = {held_model(plugin) for plugin in waiting.pop().findall("plugin")}
        more = [e for e in inside if title(e) in held and e not in tied]
        tied += more
        waiting += more
    return tied


def _enter_frames(scope: Scope) -> None:
    """Enter links, joints and frames by name; links first, where an old file uses a name twice."""
    check_names(scope)
    for element in scope.reader.children(scope.element, "frame"):
        owner = f"frame '{scope.prefix + scope.reader.name(element)}'"
        scope.reader.note_strangers(element, owner, WORDS["frame"])
    for tag in ("link", "joint", "frame"):
        for element in scope.reader.children(scope.element, tag):
            scope.elements.setdefault(scope.reader.name(element), element)
