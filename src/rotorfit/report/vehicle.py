"""Section 2: the vehicle to scale, from above and from the side, and its centre close up."""

from __future__ import annotations

from math import cos, pi, sin
from typing import TYPE_CHECKING

import numpy as np

from rotorfit.frozen_dataclass import frozen_dataclass
from rotorfit.report.pages import drawing, label, nice_step, tag
from rotorfit.report.scene import Body, Point, Scene, scene_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rotorfit.results.result import IdentificationResult

Axes = tuple[tuple[int, float], tuple[int, float]]
"""Index and sign of the body axes that point right and up."""
SIZE = 440.0
MARGIN = 40.0
BASE = 44.0
"""Height of the strip below the drawing that holds its axes and scale bar [px]."""
CHI95 = 2.4477
"""Standard deviations of a two-dimensional 95 % ellipse."""
TOP = ((1, -1.0), (0, 1.0))
"""Seen from above: to the right is -y, up is x."""
SIDE = ((0, 1.0), (2, 1.0))
"""Seen from the vehicle's right: to the right is x, up is z."""

CLOSE = (
    ("center-top", "Centre of mass, close up, from above", TOP),
    ("center-side", "Centre of mass, close up, from the side", SIDE),
)


@frozen_dataclass
class View:
    """A direction to look from, and a scale."""

    right: tuple[int, float]
    up: tuple[int, float]
    scale: float
    middle: tuple[float, float]
    width: float
    height: float

    def place(self, point: Point) -> tuple[float, float]:
        """Project a point into the drawing [px]."""
        a, b = self.right[1] * point[self.right[0]], self.up[1] * point[self.up[0]]
        x = self.width / 2 + (a - self.middle[0]) * self.scale
        y = self.height / 2 - (b - self.middle[1]) * self.scale
        return x, y


@frozen_dataclass
class VehicleDrawings:
    """The drawings, and what their caption says."""

    views: tuple[tuple[str, str, str], ...]
    bodies: tuple[Body, ...]
    imu_label: str
    arms: str
    radius: float


def vehicle_drawings(result: IdentificationResult) -> VehicleDrawings | None:
    """Draw the vehicle, None if the settings do not describe one."""
    scene = scene_of(result)
    if scene is None:
        return None
    views = [
        ("vehicle-top", "From above, front up", whole_view(scene, TOP)),
        ("vehicle-side", "From its right side, front to the right", whole_view(scene, SIDE)),
    ]
    for name, words, axes in CLOSE:
        if any(com_in(body, axes) is not None for body in scene.bodies):
            views.append((name, words, close_view(scene, axes)))
    return VehicleDrawings(
        views=tuple(views),
        bodies=scene.bodies,
        imu_label=scene.imu_label,
        arms=_arm_text(scene),
        radius=rotor_radius(scene),
    )


def com_in(body: Body, axes: Axes) -> Point | None:
    """Locate a centre of mass where a view can show it: both of its directions are known."""
    (i, _), (j, _) = axes
    if body.com[i] is None or body.com[j] is None:
        return None
    x, y, z = (value or 0.0 for value in body.com)
    return (x, y, z)


def rotor_radius(scene: Scene) -> float:
    """Choose a radius [m] so that rotors nearly touch; the settings do not have it."""
    flat = scene.vehicle.positions[:, :2]
    distances = np.linalg.norm(flat[:, None] - flat[None], axis=2)
    distances = distances[distances > 1e-3]
    return 0.42 * float(distances.min()) if distances.size else 0.1


def whole_view(scene: Scene, axes: Axes) -> str:
    """Draw the whole vehicle, from above or from the side."""
    radius = rotor_radius(scene)
    points = [rotor.position for rotor in scene.vehicle.rotors]
    edges = [
        (x + a, y + b, z)
        for x, y, z in points
        for a in (-radius, radius)
        for b in (-radius, radius)
    ]
    loads = [p.position for body in scene.bodies for p in body.payloads]
    top = axes == TOP
    view = _fit_view([*edges, *loads, scene.imu], axes, height=SIZE if top else 220.0)
    parts = [_draw_arms(scene, view)]
    parts += _draw_rotors(scene, view, radius, top=top)
    parts += _arm_labels(scene, view, radius) if top else []
    parts += _draw_payloads(scene, view)
    parts += _draw_centers(scene, view, symbol=5.0)
    name = "from above" if top else "from the side"
    return _view_svg(view, parts, f"Vehicle {name}, to scale")


def close_view(scene: Scene, axes: Axes) -> str:
    """Draw the surroundings of the centre of mass, much enlarged."""
    points: list[Point] = [scene.imu, scene.center]
    for body in scene.bodies:
        com = com_in(body, axes)
        if com is not None:
            std = CHI95 * np.sqrt(np.diag(body.covariance).clip(min=0))
            x, y, z = com
            points += [
                (x - std[0], y - std[1], z - std[2]),
                (x + std[0], y + std[1], z + std[2]),
            ]
    view = _fit_view(points, axes, height=338.0, least=0.01)
    parts = _draw_centers(scene, view, symbol=9.0)
    name = "from above" if axes == TOP else "from the side"
    return _view_svg(view, parts, f"Centre of mass with its uncertainty, {name}")


def _fit_view(
    points: Sequence[Point],
    axes: Axes,
    *,
    height: float,
    least: float = 0.05,
) -> View:
    """Choose the largest view that holds all points."""
    (i, a), (j, b) = axes
    flat = np.array([(a * p[i], b * p[j]) for p in points])
    low, high = flat.min(axis=0), flat.max(axis=0)
    extent = np.maximum(high - low, least)
    scale = float(min((SIZE - 2 * MARGIN) / extent[0], (height - BASE - 1.5 * MARGIN) / extent[1]))
    x, y = (0.5 * (low + high)).tolist()
    middle = (x, y - 0.5 * (BASE - 0.5 * MARGIN) / scale)
    return View(right=axes[0], up=axes[1], scale=scale, middle=middle, width=SIZE, height=height)


def _view_svg(view: View, parts: Sequence[str], words: str) -> str:
    attributes: dict[str, str | float] = {
        "class": "vehicle",
        "role": "img",
        "aria-label": words,
        "data-scale": f"{view.scale:.9g}",
    }
    return drawing(
        view.width, view.height, attributes, *parts, _scale_bar(view), _axis_arrows(view)
    )


def _draw_arms(scene: Scene, view: View) -> str:
    """Draw a line from the rotor centre to each rotor."""
    cx, cy = view.place(scene.center)
    ends = (view.place(rotor.position) for rotor in scene.vehicle.rotors)
    lines = (
        tag("path", {"class": "arm", "d": f"M{cx:.2f} {cy:.2f}L{x:.2f} {y:.2f}"}) for x, y in ends
    )
    return tag("g", {"class": "arms"}, *lines)


def _arm_labels(scene: Scene, view: View, radius: float) -> list[str]:
    """Label each different arm length once, at the part of its arm that no disc hides."""
    cx, cy = view.place(scene.center)
    lengths: set[str] = set()
    parts: list[str] = []
    for rotor in scene.vehicle.rotors:
        x, y = view.place(rotor.position)
        pixels = float(np.hypot(x - cx, y - cy))
        words = f"{pixels / view.scale:.3f} m"
        if pixels < 1.0 or words in lengths:
            continue
        lengths.add(words)
        ux, uy = (x - cx) / pixels, (y - cy) / pixels
        along = max(0.5 * (pixels - radius * view.scale), 0.3 * pixels)
        # Words are wider than high: they stand further off beside an upright arm.
        aside = 11.0 + 17.0 * abs(uy)
        place = {"x": cx + along * ux + aside * uy, "y": cy + along * uy - aside * ux + 4}
        parts.append(label(words, {"class": "arm-length middle halo", **place}))
    return parts


def _arm_text(scene: Scene) -> str:
    offsets = (scene.vehicle.positions - np.array(scene.center))[:, :2]
    lengths = np.hypot(offsets[:, 0], offsets[:, 1])
    low, high = float(lengths.min()), float(lengths.max())
    return f"{low:.3f} m" if high - low < 5e-4 else f"{low:.3f} to {high:.3f} m"


def _draw_rotors(scene: Scene, view: View, radius: float, *, top: bool) -> list[str]:
    """Draw the rotors with numbers; stacked ones share a circle and list their numbers."""
    stacks: dict[tuple[float, ...], list[int]] = {}
    for i, rotor in enumerate(scene.vehicle.rotors):
        at = view.place(rotor.position)
        stacks.setdefault(tuple(round(c, 1) for c in at), []).append(i)
    draw = _rotor_from_above if top else _rotor_from_side
    return [draw(scene, view, radius, members) for members in stacks.values()]


def _rotor_from_above(scene: Scene, view: View, radius: float, members: list[int]) -> str:
    rotors = scene.vehicle.rotors
    x, y = view.place(rotors[members[0]].position)
    r = radius * view.scale
    parts = [tag("circle", {"class": "disc", "cx": x, "cy": y, "r": r})]
    for depth, i in enumerate(members):
        parts.append(_spin_arrow(x, y, r * (0.8 - 0.22 * depth), rotors[i].spin))
    numbers = "/".join(str(i + 1) for i in members)
    spins = "/".join(rotors[i].spin for i in members)
    parts.append(label(numbers, {"class": "rotor-number middle halo", "x": x, "y": y + 3}))
    parts.append(label(spins, {"class": "rotor-spin middle halo", "x": x, "y": y + 19}))
    return tag("g", {"class": f"rotor {rotors[members[0]].spin}", "data-rotors": numbers}, *parts)


def _rotor_from_side(scene: Scene, view: View, radius: float, members: list[int]) -> str:
    rotor = scene.vehicle.rotors[members[0]]
    x, y = view.place(rotor.position)
    r = radius * view.scale
    lean = float(np.degrees(np.arctan2(rotor.axis[0], rotor.axis[2])))
    disc: dict[str, str | float] = {"class": "disc", "cx": x, "cy": y, "rx": r, "ry": 4.0}
    blade = tag("ellipse", {**disc, "transform": f"rotate({lean:.1f} {x:.2f} {y:.2f})"})
    numbers = ", ".join(str(i + 1) for i in members)
    word = label(numbers, {"class": "rotor-number small middle halo", "x": x, "y": y - 9})
    return tag("g", {"class": "rotor side"}, blade, word)


def _spin_arrow(x: float, y: float, r: float, spin: str) -> str:
    """Draw an arc of 250 degrees with a head; on the page, seen from above, ccw is ccw."""
    turn = 1.0 if spin == "ccw" else -1.0
    start, end = turn * 0.25 * pi, turn * (0.25 + 250 / 180) * pi
    x0, y0 = x + r * cos(start), y - r * sin(start)
    x1, y1 = x + r * cos(end), y - r * sin(end)
    sweep = 0 if spin == "ccw" else 1
    arc = f"M{x0:.2f} {y0:.2f}A{r:.2f} {r:.2f} 0 1 {sweep} {x1:.2f} {y1:.2f}"
    heading = end + turn * pi / 2
    head = [
        (x1 + 9 * cos(heading), y1 - 9 * sin(heading)),
        (x1 + 5 * cos(end), y1 - 5 * sin(end)),
        (x1 - 5 * cos(end), y1 + 5 * sin(end)),
    ]
    points = " ".join(f"{a:.2f},{b:.2f}" for a, b in head)
    return tag(
        "g",
        {"class": f"spin {spin}"},
        tag("path", {"class": "arc", "d": arc}),
        tag("polygon", {"class": "head", "points": points}),
    )


def _draw_payloads(scene: Scene, view: View) -> list[str]:
    parts: list[str] = []
    for body in scene.bodies:
        for load in body.payloads:
            x, y = view.place(load.position)
            corner = {"x": x - 6, "y": y - 6}
            parts.append(tag("rect", {"class": "payload", **corner, "width": 12.0, "height": 12.0}))
            words = f"{load.mass:g} kg"
            parts.append(label(words, {"class": "payload-mass middle halo", "x": x, "y": y + 22}))
    return parts


def _draw_centers(scene: Scene, view: View, *, symbol: float) -> list[str]:
    """Draw rotor centre, IMU, and each centre of mass with its ellipse."""
    x, y = view.place(scene.center)
    s = 1.5 * symbol
    cross = f"M{x - s:.2f} {y:.2f}H{x + s:.2f}M{x:.2f} {y - s:.2f}V{y + s:.2f}"
    parts = [tag("path", {"class": "rotor-center", "d": cross})]
    x, y = view.place(scene.imu)
    box = {"x": x - symbol * 0.8, "y": y - symbol * 0.8}
    parts.append(
        tag("rect", {"class": "imu", **box, "width": symbol * 1.6, "height": symbol * 1.6})
    )
    for number, body in enumerate(scene.bodies):
        com = com_in(body, (view.right, view.up))
        if com is not None:
            parts.append(_draw_com(body, com, view, symbol=symbol, number=number))
    return parts


def _draw_com(body: Body, com: Point, view: View, *, symbol: float, number: int) -> str:
    """Draw the sign of a centre of mass, a circle in four quarters, on its ellipse."""
    x, y = view.place(com)
    project = np.zeros((2, 3))
    project[0, view.right[0]], project[1, view.up[0]] = view.right[1], view.up[1]
    variances, turn = np.linalg.eigh(project @ body.covariance @ project.T)
    minor, major = (CHI95 * view.scale * np.sqrt(variances.clip(min=0))).tolist()
    angle = -float(np.degrees(np.arctan2(turn[1, 1], turn[0, 1])))
    r = 0.62 * symbol
    quarters = (
        f"M{x:.2f} {y:.2f}V{y - r:.2f}A{r:.2f} {r:.2f} 0 0 1 {x + r:.2f} {y:.2f}Z"
        f"M{x:.2f} {y:.2f}V{y + r:.2f}A{r:.2f} {r:.2f} 0 0 1 {x - r:.2f} {y:.2f}Z"
    )
    place = {"cx": x, "cy": y}
    turned = f"rotate({angle:.2f} {x:.2f} {y:.2f})"
    size = {"rx": major, "ry": minor, "transform": turned}
    return tag(
        "g",
        {"class": f"com body-{number % 4}"},
        tag("ellipse", {"class": "uncertainty", **place, **size}),
        tag("circle", {"class": "ring", **place, "r": r}),
        tag("path", {"class": "quarters", "d": quarters}),
    )


def _scale_bar(view: View) -> str:
    """Draw a bar of a round length, in metres."""
    length = nice_step(0.7 * SIZE / view.scale, 3)
    x1 = view.width - 16
    x0, y = x1 - length * view.scale, view.height - 14
    words = f"{length:g} m" if length >= 0.02 else f"{length:g} m ({1e3 * length:g} mm)"
    path = f"M{x0:.2f} {y - 4}V{y + 4}M{x0:.2f} {y}H{x1:.2f}M{x1:.2f} {y - 4}V{y + 4}"
    return tag(
        "g",
        {"class": "scale-bar", "data-metres": f"{length:g}"},
        tag("path", {"d": path}),
        label(words, {"class": "middle halo", "x": (x0 + x1) / 2, "y": y - 8}),
    )


def _axis_arrows(view: View) -> str:
    x, y, n = 20.0, view.height - 14.0, 28.0
    right, up = "xyz"[view.right[0]], "xyz"[view.up[0]]
    # Seen from above y points to the left; the arrow does too.
    sign = view.right[1]
    x = x if sign > 0 else x + n
    tip = x + sign * n
    d = f"M{x} {y}H{tip}M{tip - sign * 5} {y - 4}L{tip} {y}L{tip - sign * 5} {y + 4}"
    d += f"M{x} {y}V{y - n}M{x - 4} {y - n + 5}L{x} {y - n}L{x + 4} {y - n + 5}"
    return tag(
        "g",
        {"class": "axes"},
        tag("path", {"d": d}),
        label(right, {"class": "middle", "x": tip + sign * 9, "y": y + 4}),
        label(up, {"class": "middle", "x": x, "y": y - n - 6}),
    )
