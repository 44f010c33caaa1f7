"""The body wrenches that a vehicle's rotors can produce within their limits.

If the rotor inputs are bounded, the wrenches are a convex polytope: the image of a box. `wrench_polytope`
returns all of it, or the section in which some components have a given value, with its vertices and
facets.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tilthex._core import GRAVITY
from tilthex._geometry import ridges, section_vertices, volume

if TYPE_CHECKING:
    from tilthex import Vehicle

Array = NDArray[np.float64]
COMPONENTS = ("fx", "fy", "fz", "tx", "ty", "tz")
"""Components of a body wrench: force (N) and torque (N m) along the robot's axes."""
NO_TORQUE = {"tx": 0.0, "ty": 0.0, "tz": 0.0}


@dataclass(frozen=True)
class WrenchPolytope:
    """A convex set of wrenches, or of some components of them.

    Attributes:
        components: Names of the k components, of `COMPONENTS`.
        vertices: (v, k), N and N m.
        inputs: (v, n), rotor inputs in Hz^2 that produce each vertex.
        normals: (m, k), outward, of unit length.
        offsets: (m,): a point x is inside if `normals @ x <= offsets`.
        dimension: Dimension of the set; below k if the vehicle cannot produce the components
            independently.
        volume: Volume in that dimension.
    """

    components: tuple[str, ...]
    vertices: Array
    inputs: Array
    normals: Array
    offsets: Array
    dimension: int
    volume: float

    def margin(self, wrench: ArrayLike) -> Array:
        """Distance to the nearest facet, negative outside; for one point (k,) or many (..., k)."""
        point = np.asarray(wrench, dtype=float)
        if point.shape[-1:] != (len(self.components),):
            found, wanted = point.shape, len(self.components)
            raise ValueError(f"wrench has the shape {found}; expected {wanted} numbers: {self.components}")
        margin: Array = np.min(self.offsets - point @ self.normals.T, axis=-1)
        return margin

    def contains(self, wrench: ArrayLike, tolerance: float = 1e-9) -> NDArray[np.bool_]:
        """Whether points are inside, to within `tolerance`."""
        inside: NDArray[np.bool_] = self.margin(wrench) >= -tolerance
        return inside

    def reach(self, direction: ArrayLike, start: ArrayLike | None = None) -> float:
        """How far the set reaches from a start (default: no wrench) along a direction.

        Negative if the start is outside.
        """
        along = np.asarray(direction, dtype=float)
        along = along / np.linalg.norm(along)
        begin = np.zeros(len(self.components)) if start is None else np.asarray(start, dtype=float)
        if self.margin(begin) < -1e-7:
            return -math.inf
        speed = self.normals @ along
        room = self.offsets - self.normals @ begin
        outwards = speed > 1e-12
        return max(0.0, float(np.min(room[outwards] / speed[outwards])))

    @cached_property
    def inscribed_ball(self) -> tuple[Array, float]:
        """Centre and radius of the largest ball inside; the radius of a flat set is 0."""
        from scipy.optimize import linprog

        k = len(self.components)
        lengths = np.linalg.norm(self.normals, axis=1)
        found = linprog(
            np.append(np.zeros(k), -1.0),
            A_ub=np.column_stack([self.normals, lengths]),
            b_ub=self.offsets,
            bounds=[(None, None)] * k + [(0, None)],
        )
        solution: Array = np.asarray(found.x)
        return solution[:k], float(solution[k])

    def ball_around(self, centre: ArrayLike) -> float:
        """Radius of the largest ball around a point; negative from outside."""
        return float(self.margin(centre))

    def plot(self, axes: Any = None, **style: Any) -> Any:
        """Draws a set of three components (pyplot's 3-D axes) or of two (its polygon)."""
        import matplotlib.pyplot as plt

        k = len(self.components)
        if k not in (2, 3) or self.dimension != k:
            raise ValueError(
                f"a set of dimension {self.dimension} in {self.components} cannot be drawn; "
                "expected two or three independent components: fix the others"
            )
        if axes is None:
            axes = plt.figure().add_subplot(projection="3d" if k == 3 else None)
        from scipy.spatial import ConvexHull

        hull = ConvexHull(self.vertices)
        if k == 3:
            from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

            faces = Poly3DCollection(self.vertices[hull.simplices], **({"alpha": 0.3} | style))
            axes.add_collection3d(faces)
            axes.add_collection3d(Line3DCollection(self.vertices[ridges(hull)], colors="k", linewidths=0.7))
            axes.auto_scale_xyz(*self.vertices.T)
            axes.set_zlabel(self._label(2))
        else:
            ring = self.vertices[np.append(hull.vertices, hull.vertices[0])]
            axes.plot(*ring.T, **style)
            axes.set_aspect("equal")
        axes.set_xlabel(self._label(0))
        axes.set_ylabel(self._label(1))
        return axes

    def _label(self, i: int) -> str:
        name = self.components[i]
        return f"{name} [{'N' if name[0] == 'f' else 'N m'}]"


def wrench_polytope(
    vehicle: Vehicle,
    hover: bool = False,
    fix: Mapping[str, float] | None = None,
    lost: Sequence[int] = (),
    rotation: ArrayLike | None = None,
) -> WrenchPolytope:
    """The set of body wrenches of a vehicle, or a section of it.

    Args:
        vehicle: The vehicle, with the limits of its rotors.
        hover: Whether to subtract the wrench that carries the weight: the set then holds what the vehicle
            can exert in addition to hovering.
        fix: Components (`COMPONENTS`) and their values; the set has the other components.
        lost: Rotors, from 0, that stand still.
        rotation: Orientation `R_WR` of the hover, (3, 3); level by default.

    Raises:
        ValueError: A name is unknown, or no wrench has the fixed components.
    """
    fixed = {} if fix is None else dict(fix)
    for name in fixed:
        if name not in COMPONENTS:
            raise ValueError(f"fix names `{name}`; expected some of {', '.join(COMPONENTS)}")
    matrix = vehicle.allocation
    lower, upper = _limits(vehicle, lost)
    base = np.zeros(6)
    if rotation is not None:
        vehicle.hover_speeds(rotation)  # refuses what is not a rotation
    if hover:
        turn = np.eye(3) if rotation is None else np.asarray(rotation, dtype=float)
        base[:3] = turn.T @ [0.0, 0.0, vehicle.weight]
    held = [i for i, name in enumerate(COMPONENTS) if name in fixed]
    free = [i for i, name in enumerate(COMPONENTS) if name not in fixed]
    if not free:
        raise ValueError("fix names every component; expected at least one left")
    target = base[held] + [fixed[COMPONENTS[i]] for i in held]
    inputs = np.vstack(
        list(section_vertices(matrix[held], target, lower, upper)) or [np.empty((0, len(lower)))]
    )
    if not len(inputs):
        raise ValueError(f"no inputs within the limits give {fixed}; expected components within reach")
    points = inputs @ matrix[free].T - base[free]
    return _hull(tuple(COMPONENTS[i] for i in free), points, inputs)


def lateral_reach(vehicle: Vehicle, lost: Sequence[int] = ()) -> float:
    """Horizontal force, N, that is possible in every direction in a level hover without a torque.

    Zero for a vehicle that must lean; minus infinity if it cannot hover level.
    """
    try:
        section = wrench_polytope(vehicle, hover=True, fix={"fz": 0.0, **NO_TORQUE}, lost=lost)
    except ValueError:
        return -math.inf
    return section.ball_around([0.0, 0.0])


def payload(vehicle: Vehicle) -> float:
    """Mass, kg, that can be added in the centre of mass so that the vehicle still hovers level."""
    section = wrench_polytope(vehicle, hover=True, fix={"fx": 0.0, "fy": 0.0, **NO_TORQUE})
    return section.reach([1.0]) / GRAVITY


def push(vehicle: Vehicle, direction: ArrayLike, at: ArrayLike | None = None) -> float:
    """Largest force, N, along a direction that the tool tip, or a point `at`, can exert in a level hover."""
    along = np.asarray(direction, dtype=float) / np.linalg.norm(direction)
    lever = vehicle.tool_position if at is None else np.asarray(at, dtype=float)
    wrench = np.concatenate([along, np.cross(lever, along)])
    reach = wrench_polytope(vehicle, hover=True).reach(wrench)
    return reach / float(np.linalg.norm(wrench))


@dataclass(frozen=True)
class StaticHover:
    """A hover without motion (Michieletto, Ryll, Franchi, T-RO 34(3), 2018).

    Attributes:
        thrust_direction: (3,), body: the direction that points up.
        tilt: Its angle from the body's z axis, rad.
        inputs: (n,), Hz^2.
        margin: Part of its input range that every working rotor keeps at either end; at most 0.5.
    """

    thrust_direction: Array
    tilt: float
    inputs: Array
    margin: float


def static_hover(vehicle: Vehicle, lost: Sequence[int] = ()) -> StaticHover | None:
    """The hover that leaves the rotors the largest margin, or None if there is none.

    A set of rotors can hover if some inputs within the limits give no torque, and a force as large as the
    weight in any direction of the body.
    """
    weight = vehicle.weight
    matrix = vehicle.allocation
    lower, upper = _limits(vehicle, lost)
    span = upper - lower

    def best(margin: float) -> StaticHover | None:
        limits = (lower + margin * span, upper - margin * span)
        found = list(section_vertices(matrix[3:], np.zeros(3), *limits))
        if not found:
            return None
        inputs = np.vstack(found)
        forces = inputs @ matrix[:3].T
        size = np.linalg.norm(forces, axis=1)
        strong = int(size.argmax())
        # The set is convex, so that it has a force of every magnitude between its weakest and its
        # strongest.
        weakest = _smallest(forces)
        if size[strong] < weight or np.linalg.norm(weakest[0]) > weight:
            return None
        part = _part_of_size(weakest[0], forces[strong], weight)
        mixed = (1 - part) * (weakest[1] @ inputs) + part * inputs[strong]
        direction = matrix[:3] @ mixed / weight
        tilt = math.acos(min(1.0, max(-1.0, float(direction[2] / np.linalg.norm(direction)))))
        return StaticHover(direction, tilt, mixed, margin)

    found = best(0.0)
    if found is None:
        return None
    low, high = 0.0, 0.5
    for _ in range(30):
        middle = 0.5 * (low + high)
        better = best(middle)
        if better is None:
            high = middle
        else:
            low, found = middle, better
    return found


def _limits(vehicle: Vehicle, lost: Sequence[int]) -> tuple[Array, Array]:
    speeds = vehicle.rotor_speed_limits
    limits: Array = speeds * np.abs(speeds)
    for rotor in lost:
        if not 0 <= rotor < len(limits):
            raise ValueError(f"lost names rotor {rotor}; expected 0 to {len(limits) - 1}")
        limits[rotor] = 0.0
    return limits[:, 0], limits[:, 1]


def _hull(components: tuple[str, ...], points: Array, inputs: Array) -> WrenchPolytope:
    """The convex hull in the space that the points span."""
    from scipy.spatial import ConvexHull, QhullError

    k = len(components)
    centre = points.mean(axis=0)
    # Forces and torques are each divided by their own size, so that "flat" has a meaning.
    spread = np.abs(points - centre).max(axis=0)
    size = np.where(spread > 1e-9 * max(1.0, spread.max()), spread, 1.0)
    scaled = (points - centre) / size
    _, values, axes = np.linalg.svd(scaled, full_matrices=True)
    dimension = int((values > 1e-7 * np.sqrt(len(points))).sum())
    inner, outer = axes[:dimension], axes[dimension:]
    normals = [outer / size, -outer / size]
    offsets = [np.zeros(len(outer))] * 2
    if dimension >= 2:
        try:
            hull = ConvexHull(scaled @ inner.T)
        except QhullError:  # parallel rotors give equal vertices; with joggled input Qhull succeeds
            hull = ConvexHull(scaled @ inner.T, qhull_options="QJ")
        _, first = np.unique(np.round(hull.equations, 9), axis=0, return_index=True)
        facets = hull.equations[first]
        normals.append(facets[:, :-1] @ inner / size)
        offsets.append(-facets[:, -1])
        corner = hull.vertices
    elif dimension == 1:
        along = scaled @ inner[0]
        corner = np.array([along.argmin(), along.argmax()])
        normals.append(np.array([-inner[0], inner[0]]) / size)
        offsets.append(np.array([-along.min(), along.max()]))
    else:
        corner = np.array([0])
    normal = np.vstack(normals)
    offset = np.concatenate(offsets) + normal @ centre
    length = np.linalg.norm(normal, axis=1)
    return WrenchPolytope(
        components,
        points[corner],
        inputs[corner],
        normal / length[:, None],
        offset / length,
        dimension,
        volume(points[corner], dimension, k),
    )


def _smallest(forces: Array) -> tuple[Array, Array]:
    """The point of smallest norm in the hull of some forces, and its weights.

    It comes from non-negative least squares.
    """
    from scipy.optimize import nnls

    heavy = 1e3 * float(np.abs(forces).max())
    weights, _ = nnls(np.vstack([forces.T, heavy * np.ones(len(forces))]), np.array([0.0, 0.0, 0.0, heavy]))
    weights = weights / weights.sum()
    return weights @ forces, weights


def _part_of_size(start: Array, end: Array, size: float) -> float:
    """The fraction of the way from start to end at which a vector has this norm."""
    step = end - start
    a, b, c = float(step @ step), float(start @ step), float(start @ start) - size * size
    return (-b + math.sqrt(max(0.0, b * b - a * c))) / a if a > 0 else 0.0
