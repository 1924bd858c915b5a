"""The page: controls beside the picture of a robot, what they ask for, and what is shown of the answer."""

from __future__ import annotations

import html
import threading
import time as clock
from collections import OrderedDict
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, get_args

import numpy as np
import pinocchio as pin

from stewart_pin.building.exporting import export
from stewart_pin.building.loading import load, robots
from stewart_pin.checks import as_array
from stewart_pin.errors import StewartPinError
from stewart_pin.state.chain import ClosedChain
from stewart_pin.state.configurations import as_pose
from stewart_pin.state.freedom import TWIST_AXES
from stewart_pin.state.state import State
from stewart_pin.typing import FloatArray
from stewart_pin.viewer.picture import Colouring, Picture
from stewart_pin.viewer.readings import Readings, read_state
from stewart_pin.viewer.recording import Recording
from stewart_pin.viewer.steering import Grip, Hand, Step, move_joint, move_platform, random_reachable

_NAMES = dict(zip(TWIST_AXES, ("x", "y", "z", "roll", "pitch", "yaw"), strict=True))
_MOST_JOINTS = 40
"""Sliders of passive joints; a list that is longer helps nobody."""
_SPEEDS = {"0.1 ×": 0.1, "0.25 ×": 0.25, "0.5 ×": 0.5, "1 ×": 1.0, "2 ×": 2.0, "5 ×": 5.0}
_TICK = 0.02
"""Pause between two instants of a motion that is played [s]."""
_FORMATS = {"URDF": ".urdf", "MJCF": ".xml", "SDFormat": ".sdf"}


@dataclass(frozen=True, eq=False)
class Shown:
    """What the page shows at one moment.

    Attributes
    ----------
    state
        Where the robot stands.
    readings
        What is shown of it.
    said
        What stood in the way of the last demand; empty where nothing did.
    """

    state: State
    readings: Readings
    said: str


class Page:
    """One robot on a server, steered by all who look at it.

    Demands are met one after the other in a thread of the page's own; of a slider that moves faster than the robot only
    the last demand counts. All clients see the same robot; a page that is loaded again finds it as it stands.

    Parameters
    ----------
    server
        viser server.
    chain
        Closed chain to begin with; None: one of the bundled robots, and a menu of them.
    recording
        Motion of it to be played, or None.
    """

    def __init__(self, server: Any, chain: ClosedChain | None, recording: Recording | None = None) -> None:
        self.server, self._recording = server, recording
        self._requests: OrderedDict[str, Callable[[], Step | None]] = OrderedDict()
        self._wake = threading.Condition()
        self._busy = self._ended = False
        self._rng = np.random.default_rng()
        self._menu = None if chain is not None else robots()
        self._put_up(load("stewart") if chain is None else chain)
        self._thread = threading.Thread(target=self._work, name="stewart_pin viewer", daemon=True)
        self._thread.start()
        self._player = threading.Thread(target=self._play, name="stewart_pin player", daemon=True)
        if recording is not None:
            self._player.start()
        server.on_client_disconnect(self._let_go)

    # -- what is asked for ----------------------------------------------------------------------------------------

    def ask(self, key: str, request: Callable[[], Step | None]) -> None:
        """Ask for something to be done; of several requests of one key only the last is met.

        Parameters
        ----------
        key
            What is moved.
        request
            Leads to another state, or to None where nothing moves.
        """
        with self._wake:
            self._requests[key] = request
            self._wake.notify_all()

    def settle(self, timeout: float = 10.0) -> bool:
        """Wait until every demand has been met.

        Parameters
        ----------
        timeout
            How long at most [s].

        Returns
        -------
        bool
            Whether nothing is left to do.
        """
        with self._wake:
            return self._wake.wait_for(lambda: not (self._requests or self._busy), timeout)

    def end(self) -> None:
        """Stop meeting demands, and playing."""
        with self._wake:
            self._ended = True
            self._wake.notify_all()
        for thread in (self._thread, self._player):
            if thread.is_alive():
                thread.join(timeout=5.0)

    def _work(self) -> None:
        while True:
            with self._wake:
                self._busy = False
                self._wake.notify_all()
                self._wake.wait_for(lambda: self._requests or self._ended)
                if self._ended:
                    return
                _, request = self._requests.popitem(last=False)
                self._busy = True
            try:
                step = request()
                if step is not None:
                    self._show(step)
            except StewartPinError as error:
                self._say(str(error))
            except Exception as error:  # whatever goes wrong with one demand, the page answers the next
                self._say(f"{type(error).__name__}: {error}")

    # -- the controls ---------------------------------------------------------------------------------------------

    def _put_up(self, chain: ClosedChain) -> None:
        """Build picture and controls of a chain, in the place of those before."""
        server = self.server
        with server.atomic():
            server.gui.reset()
            server.scene.reset()
            self.chain, self.hand = chain, Hand(chain)
            self._set_stage()
            self._picture = Picture(server, chain)
            self._sliders: dict[str, tuple[Any, Grip]] = {}
            self._build_roles()
            self._build_motion()
            self._build_platform()
            self._build_load()
            self._build_sliders("Motors", self.hand.motors, expand=True)
            self._build_sliders("Passive joints", self.hand.joints[:_MOST_JOINTS], expand=not chain.nu)
            self._table = server.gui.add_html("")
            self._build_buttons()
        self._show(Step(chain.home_state()))

    def _set_stage(self) -> None:
        scene, size = self.server.scene, self.chain.length_scale
        scene.set_up_direction("+z")
        scene.configure_default_lights()
        points = np.array([at.translation for at in _joints_at_home(self.chain)])
        middle, low = points.mean(axis=0), float(points[:, 2].min())
        reach = max(size, float(np.abs(points - middle).max()))
        scene.add_grid(
            "/ground",
            width=4 * reach,
            height=4 * reach,
            cell_size=reach / 4,
            section_size=reach,
            position=(middle[0], middle[1], low),
        )
        camera = self.server.initial_camera
        camera.position = tuple(middle + reach * np.array([1.6, -2.4, 1.2]))
        camera.look_at = tuple(middle)

    def _build_roles(self) -> None:
        gui = self.server.gui
        if self._menu is not None:
            menu = gui.add_dropdown("Robot", self._menu, initial_value=self.chain.name)
            menu.on_update(lambda event: event.client and self.ask("robot", lambda: self._load(menu.value)))
        buttons = gui.add_button_group("Go", ("home", "somewhere random"))
        buttons.on_click(lambda event: self.ask("button", lambda: self._go(event.target.value)))
        self._message = gui.add_markdown("")
        self._colouring = gui.add_dropdown("Motors show", get_args(Colouring), initial_value="force")
        self._colouring.on_update(lambda event: event.client and self.ask("colour", self._same))

    def _same(self) -> Step:
        moving = self.shown.readings.moving
        efforts = np.array([motor.effort for motor in self.shown.readings.motors]) if moving else None
        return Step(self.shown.state, self.shown.said, efforts)

    def _load(self, name: str) -> None:
        # A page may send anything, a path to some file as well.
        if self._menu is not None and name in self._menu:
            chain = load(name)
            with self._wake:
                self._requests.clear()  # demands on the robot that goes
            self._put_up(chain)

    def _go(self, where: str) -> Step:
        return Step(self.chain.home_state()) if where == "home" else random_reachable(self.hand, self._rng)

    def _build_motion(self) -> None:
        """Put up the controls of a recording: play, time, speed, and whether it begins again."""
        if self._recording is None:
            return
        gui, times = self.server.gui, self._recording.time
        with gui.add_folder("Motion"):
            self._playing = gui.add_checkbox("play", initial_value=False)
            begin, end = float(times[0]), float(times[-1])
            self._time = gui.add_slider(
                "time [s]", min=begin, max=max(end, begin + 1e-3), step=1e-3, initial_value=begin
            )
            self._speed = gui.add_dropdown("speed", tuple(_SPEEDS), initial_value="1 ×")
            self._again = gui.add_checkbox("again and again", initial_value=True)
        self._time.on_update(
            lambda event: event.client and self.ask("time", lambda: self._at(self._time.value))
        )

    def _at(self, time: float) -> Step:
        assert self._recording is not None
        k = self._recording.at(time)
        state = State(self.chain, self._recording.q[k], self._recording.v[k])
        return Step(state, tau_motor=self._recording.tau_motor[k])

    def _play(self) -> None:
        """Let time pass while the box is ticked; what cannot be shown in time is left out."""
        assert self._recording is not None
        begin, end = float(self._recording.time[0]), float(self._recording.time[-1])
        before = clock.monotonic()
        while not self._ended:
            clock.sleep(_TICK)
            now = clock.monotonic()
            passed, before = now - before, now
            if not self._playing.value:
                continue
            time = self._time.value + passed * _SPEEDS[self._speed.value]
            if time > end:
                time = begin if self._again.value else end
                self._playing.value = bool(self._again.value)
            self._time.value = time
            self.ask("time", lambda time=time: self._at(time))

    def _build_platform(self) -> None:
        grips = self.hand.platform
        if not grips:
            return
        gui = self.server.gui
        with gui.add_folder(f"Platform '{self.chain.platform}'"):
            for grip in grips:
                key = f"platform {grip.name}"
                slider = self._slider(_NAMES[grip.name], key, grip)  # type: ignore[index]
                slider.on_update(
                    lambda event, key=key: event.client and self.ask(key, lambda: self._to_coordinate(key))
                )
        axes = {grip.name for grip in grips}
        self._gizmo = self.server.scene.add_transform_controls(
            "/gizmo",
            scale=0.35 * self.chain.length_scale,
            active_axes=_arrows(axes),
            disable_rotations=not axes & set(TWIST_AXES[3:]),
            depth_test=False,
        )
        self._dragging: int | None = None
        self._gizmo.on_update(self._on_gizmo)

    def _build_load(self) -> None:
        """Put up the force on the platform that efforts at rest are shown under."""
        self._load_boxes: list[Any] = []
        if self.chain.platform is None or not self.chain.nu:
            return
        gui = self.server.gui
        with gui.add_folder("Force on the platform", expand_by_default=False):
            for axis in "xyz":
                box = gui.add_number(f"{axis} [N]", initial_value=0.0)
                box.on_update(lambda event: event.client and self.ask("load", self._same))
                self._load_boxes.append(box)

    def _load_on_platform(self) -> FloatArray | None:
        force = [float(box.value) for box in self._load_boxes]
        return np.array([*force, 0.0, 0.0, 0.0]) if any(force) else None

    def _build_sliders(self, title: str, grips: Sequence[Grip], *, expand: bool) -> None:
        if not grips:
            return
        with self.server.gui.add_folder(title, expand_by_default=expand):
            for grip in grips:
                key = f"joint {grip.name}"
                slider = self._slider(grip.name, key, grip)
                slider.on_update(
                    lambda event, key=key, name=grip.name: (
                        event.client and self.ask(key, lambda: self._to_joint(key, name))
                    )
                )

    def _slider(self, label: str, key: str, grip: Grip) -> Any:
        low, high = (float(x if grip.is_length else np.degrees(x)) for x in (grip.low, grip.high))
        digits = int(4 - np.floor(np.log10(high - low))) if high > low else 6
        first, last = _rounded(low, digits - 2, np.ceil), _rounded(high, digits - 2, np.floor)
        if not first < last:  # limits that meet, or differ by less than the digits before them can tell
            first, last = low, max(high, low + 10.0**-digits, float(np.nextafter(low, np.inf)))
        slider = self.server.gui.add_slider(
            f"{label} [{'m' if grip.is_length else '°'}]",
            min=first,
            max=last,
            step=10.0**-digits,
            initial_value=first,
            disabled=not high > low,  # limits that meet leave it nowhere to go
        )
        self._sliders[key] = slider, grip
        return slider

    def _build_buttons(self) -> None:
        gui = self.server.gui
        with gui.add_folder("This state in Python", expand_by_default=False):
            self._code = gui.add_markdown("")
        with gui.add_folder("Save", expand_by_default=False):
            gui.add_button("Picture").on_click(self._save_picture)
            kind = gui.add_dropdown("Format", tuple(_FORMATS), initial_value="URDF")
            gui.add_button("Robot").on_click(lambda event: self._save_robot(event.client, kind.value))

    # -- from controls to demands ---------------------------------------------------------------------------------

    def _to_coordinate(self, key: str) -> Step:
        """Take the platform where one of its sliders stands; its other coordinates stay as they are."""
        slider, grip = self._sliders[key]
        at = self.shown.state.pose
        values = np.concatenate([at.translation, pin.rpy.matrixToRpy(at.rotation)])
        values[TWIST_AXES.index(grip.name)] = slider.value if grip.is_length else np.radians(slider.value)  # type: ignore[arg-type]
        values = as_array("value of the slider", values, (6,))
        return move_platform(
            self.hand, self.shown.state, pin.SE3(pin.rpy.rpyToMatrix(values[3:]), values[:3])
        )

    def _to_joint(self, key: str, name: str) -> Step:
        slider, grip = self._sliders[key]
        value = slider.value if grip.is_length else np.radians(slider.value)
        return move_joint(self.hand, self.shown.state, name, float(value))

    def _on_gizmo(self, event: Any) -> None:
        self._dragging = None if event.phase == "end" else event.client_id
        w, *xyz = np.asarray(event.target.wxyz) / (np.linalg.norm(event.target.wxyz) or 1.0)
        at = np.array([*event.target.position, *xyz, w])
        self.ask(
            "gizmo", lambda: move_platform(self.hand, self.shown.state, as_pose("pose of the gizmo", at))
        )

    def _let_go(self, client: Any) -> None:
        """Let go of the gizmo for a page that was closed while it held it."""
        if self.hand.platform and self._dragging == client.client_id:
            self._dragging = None

    def _save_picture(self, event: Any) -> None:
        if event.client is not None:
            picture = event.client.get_render(height=900, width=1200, transport_format="png")
            event.client.send_file_download(f"{self.chain.name}.png", _png(picture))

    def _save_robot(self, client: Any, kind: str) -> None:
        if client is None:
            return
        import tempfile  # noqa: PLC0415 - for this button alone
        from pathlib import Path  # noqa: PLC0415

        try:
            with tempfile.TemporaryDirectory() as folder:
                path = Path(folder) / f"robot{_FORMATS[kind]}"
                export(self.chain, path)
                client.send_file_download(f"{self.chain.name}{_FORMATS[kind]}", path.read_bytes())
        except StewartPinError as error:
            self._say(str(error))

    # -- from answers to the page ---------------------------------------------------------------------------------

    def _show(self, step: Step) -> None:
        readings = read_state(step.state, step.tau_motor, load=self._load_on_platform())
        self.shown = Shown(step.state, readings, step.said)
        with self.server.atomic():
            self._picture.show(step.state, readings, self._colouring.value)
            self._follow(step.state, readings)
            self._table.content = readings_table(readings)
            self._code.content = as_python(self.chain, step.state)
            self._say(step.said)

    def _follow(self, state: State, readings: Readings) -> None:
        """Move sliders and gizmo to where the robot stands, but for those that somebody still moves."""
        values = {}
        if readings.pose is not None:
            turned = pin.rpy.matrixToRpy(readings.pose.rotation)
            values = dict(
                zip(_keys_of_platform(), [*readings.pose.translation, *np.degrees(turned)], strict=True)
            )
        with self._wake:
            asked = set(self._requests)
        for key, (slider, grip) in self._sliders.items():
            if key in asked:
                continue
            value = values.get(key)
            if value is None:
                joint = self.chain.model.joints[self.chain.model.getJointId(grip.name)]
                value = (
                    float(state.q[joint.idx_q]) if grip.is_length else np.degrees(float(state.q[joint.idx_q]))
                )
            # Ends are rounded inwards. What is really beyond, as an angle after whole turns, is shown all the same.
            coarse = round(-np.log10(slider.step)) - 2
            if value < slider.min - 10.0**-coarse:
                slider.min = _rounded(value, coarse, np.floor)
            elif value > slider.max + 10.0**-coarse:
                slider.max = _rounded(value, coarse, np.ceil)
            slider.value = float(np.clip(value, slider.min, slider.max))
        if self.hand.platform and readings.pose is not None and self._dragging is None:
            self._gizmo.position = np.array(readings.pose.translation)
            turn = pin.Quaternion(readings.pose.rotation)
            self._gizmo.wxyz = np.array([turn.w, turn.x, turn.y, turn.z])

    def _say(self, said: str) -> None:
        with suppress(AttributeError):
            self._message.content = f"**Held here:** {_plain(said)}" if said else ""


def readings_table(readings: Readings) -> str:
    """Write the readings as a table.

    Parameters
    ----------
    readings
        Of a state.

    Returns
    -------
    str
        HTML.
    """
    rows = []
    for motor in readings.motors:
        where = f"{motor.position:.4f} m" if motor.is_length else f"{np.degrees(motor.position):.2f}°"
        effort = "–" if np.isnan(motor.effort) else f"{motor.effort:.4g} {'N' if motor.is_length else 'N m'}"
        left = "–" if np.isnan(motor.stroke_left) else f"{100 * motor.stroke_left:.0f} %"
        cells = [html.escape(motor.name), where, effort, left]
        if readings.moving:
            rate = f"{motor.rate:+.3f} m/s" if motor.is_length else f"{np.degrees(motor.rate):+.1f} °/s"
            cells.insert(2, rate)
        rows.append(cells)
    heads = ["motor", "position", "effort at rest", "stroke left"]
    if readings.moving:
        heads[2:3] = ["rate", "effort"]
    head = "".join(f"<th align=left>{x}</th>" for x in heads)
    body = "".join("<tr>" + "".join(f"<td>{x}</td>" for x in row) + "</tr>" for row in rows)
    facts = []
    if np.isfinite(readings.condition):
        facts.append(f"condition number {readings.condition:.4g}")
    if readings.nearest and np.isfinite(readings.distance):
        facts.append(f"singular value {readings.distance:.3g} of the nearest kind: {readings.nearest}")
    facts += [f"limit passed: {html.escape(text)}" for text in readings.exceeded]
    if readings.missing:
        facts.append(html.escape(readings.missing))
    told = "".join(f"<li>{fact}</li>" for fact in facts)
    table = f"<table width='100%'><tr>{head}</tr>{body}</table>" if rows else ""
    return f"<div style='font-size: 0.8em; padding: 0 0.7em'>{table}<ul style='padding-left: 1.2em'>{told}</ul></div>"


def as_python(chain: ClosedChain, state: State) -> str:
    """Write the state as lines of Python.

    Parameters
    ----------
    chain
        Closed chain.
    state
        Where it stands.

    Returns
    -------
    str
        Markdown with a block of code.
    """
    lines = []
    if chain.platform is not None:
        turn = pin.Quaternion(state.pose.rotation).coeffs()
        lines.append(f"pose = {_numbers([*state.pose.translation, *turn])}  # x y z qx qy qz qw")
    if chain.nu:
        lines.append(f"q_motor = {_numbers(state.q[chain.motor_q_index])}")
    lines.append(f"q = {_numbers(state.q)}")
    return "```python\n" + "\n".join(lines) + "\n```"


def _numbers(values: Sequence[float] | FloatArray) -> str:
    return "[" + ", ".join(repr(float(x)) for x in values) + "]"


def _rounded(value: float, digits: int, towards: Callable[[float], float]) -> float:
    """Round to some decimals, inwards: what a slider shows must be within the limits."""
    return float(round(float(towards(round(value * 10.0**digits, 6))) / 10.0**digits, max(digits, 0)))


def _keys_of_platform() -> list[str]:
    return [f"platform {axis}" for axis in TWIST_AXES]


def _arrows(axes: set[str]) -> tuple[bool, bool, bool]:
    """Axes of a gizmo; it turns about one where it has arrows along both others."""
    arrows = [axis in axes for axis in TWIST_AXES[:3]]
    for k, axis in enumerate(TWIST_AXES[3:]):
        if axis in axes:
            arrows[(k + 1) % 3] = arrows[(k + 2) % 3] = True
    return arrows[0], arrows[1], arrows[2]


def _joints_at_home(chain: ClosedChain) -> list[pin.SE3]:
    data = pin.Data(chain.model)
    pin.framesForwardKinematics(chain.model, data, chain.q_home)
    return list(data.oMf)


def _plain(text: str) -> str:
    """Text without a meaning for Markdown."""
    return html.escape(text, quote=False).replace("*", "\\*").replace("_", "\\_").replace("|", "\\|")


def _png(picture: Any) -> bytes:
    import io  # noqa: PLC0415 - for this button alone

    from PIL import Image  # noqa: PLC0415 - comes with viser

    buffer = io.BytesIO()
    Image.fromarray(picture).save(buffer, format="png")
    return buffer.getvalue()
