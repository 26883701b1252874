"""A second generator of campaigns, by numpy alone: it imports nothing of qsframework.

`independent_arm.py` holds the arms and where they come to rest, `independent_effects.py` and `unknown.py` what may be
hidden in them. What is written here are the files that a user has: a URDF, a robot.yaml, nominal values, an experiment
and tables of readings with the noise of real instruments.

The size of what is hidden is s, the norm of what it adds to the readings, whitened by their noise, after the fitted
parameters have absorbed their part: those are differenced at the true arm, one by one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from independent_arm import WARM, Arm, Array, Coil, Hidden, Mounted, NoRest, Spring, Visits, positions, turn

SIGMA, SHARED, GAUGE = 3e-5, 5e-5, 2e-6
"""sd of a coordinate of a reading, of what the markers of a visit share where they do, and of a dial gauge, m."""
NOISES = (
    "nominal",
    "shared",
    "growing",
    "outliers",
    "student_t3",
    "quantised",
    "sigma_too_small",
    "sigma_too_large",
    "repeats",
    "repeatability",
)
STATED = {"sigma_too_small": SIGMA / 1.5, "sigma_too_large": SIGMA / 0.5, "quantised": 6e-6}
"""sd that the file says where it is not SIGMA, m."""
VISIT = ("shared", "repeats", "repeatability")
_STEP, _FINE = 1e-5, 5e-6
"""Rounding of quantised readings, and their sd before it, m."""
_FLAT = 1e-9
"""Singular value, of columns of length 1, below which a direction is not fitted."""


class Unreachable(Exception):
    """No size within what is real shows as much."""


@dataclass(frozen=True)
class Setting:
    """A campaign: arm that is measured; told: the arm that the files describe, where it is another one.

    kind: displacements, positions, or mixed (half of the poses as displacements, half as positions of the unloaded
    arm); fit: of positions, `springs` alone or `geometry` too; loads: two or many; recorded: whether the tables hold
    time, temperature and side of approach; plan: pendant angles (N, n) rad in place of random ones; pull: forces (N, 3)
    N of its poses, in place of the loads in turns
    """

    arm: Arm
    poses: int = 40
    seed: int = 0
    kind: str = "displacements"
    noise: str = "nominal"
    fit: str = "geometry"
    loads: str = "two"
    recorded: bool = False
    told: Arm | None = None
    plan: Array | None = None
    pull: Array | None = None

    @property
    def described(self) -> Arm:
        """The arm of the files."""
        return self.told or self.arm

    @property
    def placed(self) -> bool:
        """Whether there are positions."""
        return self.kind != "displacements"


# ---------------------------------------------------------------- what is commanded


def random_poses(setting: Setting, rng: np.random.Generator) -> Array:
    """Pendant angles (N, n) rad as a controller shows them; parallelograms stay away from flat."""
    arm = setting.arm
    low, high = (np.array([0.9 * link.limits[e] for link in arm.links]) for e in (0, 1))
    found: list[Array] = []
    while len(found) < setting.poses:
        shown = np.deg2rad(np.round(rng.uniform(low, high), 3))
        flat = any(a.lever > 0.0 and np.cos(a.joints(shown[None])[0, 2]) < 0.25 for a in (arm, setting.described))
        found += [] if flat else [shown]
    return np.array(found)


def forces(setting: Setting) -> Array:
    """The loads (L, 3) N that poses have in turns, base frame."""
    weight = 9.81 * setting.arm.payload
    shares = [(0.0, 0.0, 0.9), (0.0, 0.36, 0.9)]
    if setting.loads == "many":
        shares = [(0, 0, 0.9), (0, 0.35, 0.6), (-0.3, 0, 0.8), (0, 0, 0.4), (0.25, -0.25, 0.9), (0, -0.4, 0.5)]
    return weight * np.array(shares) * [1.0, 1.0, -1.0]


def visits_of(setting: Setting) -> tuple[tuple[Visits, Visits] | None, Visits | None]:
    """Unloaded and loaded states of the displacements, and the states of the positions, as they were visited."""
    rng = np.random.default_rng([setting.seed, setting.poses, 1])
    shown = random_poses(setting, rng) if setting.plan is None else setting.plan
    each = 2 if setting.noise == "repeats" else 1
    count = len(shown)
    force = forces(setting)[np.arange(count) % len(forces(setting))] if setting.pull is None else setting.pull
    first = {"displacements": count, "positions": 0, "mixed": count // 2}[setting.kind]
    rows = np.tile(np.arange(count), each)
    moved, placed = rows[rows < first], rows[rows >= first]
    both = None
    if len(moved):
        start = np.cumsum(rng.uniform(60.0, 180.0, len(moved)))
        wait = rng.uniform(60.0, 600.0, len(moved))
        start += np.concatenate([[0.0], np.cumsum(wait)[:-1]])
        side = rng.choice([-1.0, 1.0], len(moved))
        share = np.arange(len(moved)) / len(moved)
        empty = _visits(shown[moved], 0.0 * force[moved], share, start, side, moved.astype(float))
        both = (
            empty,
            _visits(shown[moved], force[moved], share + 0.5 / len(moved), start + wait, side, moved.astype(float)),
        )
    states = None
    if len(placed):
        loads = 1 if setting.kind == "mixed" else 2
        state = np.repeat(placed, loads)
        pull = force[state] * (np.arange(len(state)) % loads)[:, None]
        time = np.cumsum(rng.uniform(60.0, 300.0, len(state)))
        side = np.repeat(rng.choice([-1.0, 1.0], len(placed)), loads)
        states = _visits(shown[state], pull, np.arange(len(state)) / len(state), time, side, state.astype(float))
    return both, states


def _visits(shown: Array, force: Array, order: Array, time: Array, side: Array, number: Array) -> Visits:
    """A hall and an arm that warm up by 6 K."""
    loaded = (np.abs(force).max(axis=1) > 0.0).astype(np.float64)
    warmth = 6.0 * (1.0 - np.exp(-time / 5000.0))
    return Visits(shown, force, loaded, order, time, warmth, side, number.astype(np.float64))


# ---------------------------------------------------------------- the true arm and what is read of it


@dataclass(frozen=True)
class Built:
    """An arm as it was built, and what the files' parameters are.

    compliance rad/(N m) (n,); foot: of the pedestal about x and y; zeros rad (n,); frames: errors m and rad (n, 6);
    markers m (K, 3); station: the base in the tracker's frame, a rotation vector and a place m (6,)
    """

    compliance: Array
    foot: Array
    zeros: Array
    frames: Array
    markers: Array
    station: Array

    @property
    def hidden(self) -> Hidden:
        """Its pedestal and its geometry."""
        zeros, frames = self.zeros, self.frames
        feet = (Spring(0, "foot", (1, 0, 0), float(self.foot[0])), Spring(0, "foot", (0, 1, 0), float(self.foot[1])))
        return Hidden(
            springs=feet if self.foot.any() else (),
            angles=(lambda q, visits: np.broadcast_to(zeros, q.shape),),
            shifts=(lambda visits: np.broadcast_to(frames[:, :3], (len(visits.force), *frames[:, :3].shape)),),
            tilts=tuple((k, (float(f[3]), float(f[4]), float(f[5]))) for k, f in enumerate(frames) if f[3:].any()),
        )

    @property
    def vector(self) -> Array:
        """All numbers in a row."""
        return np.concatenate([v.ravel() for v in self._parts])

    def at(self, vector: Array) -> Built:
        """With other numbers."""
        parts: list[Array] = []
        start = 0
        for part in self._parts:
            parts.append(vector[start : start + part.size].reshape(part.shape))
            start += part.size
        return Built(*parts)

    @property
    def _parts(self) -> tuple[Array, ...]:
        return self.compliance, self.foot, self.zeros, self.frames, self.markers, self.station


def built(setting: Setting) -> Built:
    """Springs within 20 % of the maker's; geometry, markers and tracker off where they are fitted."""
    arm = setting.arm
    rng = np.random.default_rng([setting.seed, setting.poses, 2])
    n, K = len(arm.links), len(arm.markers)
    off = setting.placed and setting.fit == "geometry"
    return Built(
        np.array(arm.compliance) * (1.0 + 0.2 * rng.standard_normal(n)).clip(0.3),
        arm.foot * (1.0 + 0.2 * rng.standard_normal(2)).clip(0.3),
        off * 5e-4 * rng.standard_normal(n),
        off * np.array([3e-4] * 3 + [3e-4] * 3) * rng.standard_normal((n, 6)),
        np.array(arm.markers) + setting.placed * 1e-3 * rng.standard_normal((K, 3)),
        setting.placed * np.concatenate([rng.uniform(-1.5, 1.5, 3), rng.uniform([2, -2, -0.5], [5, 2, 1])]),
    )


@dataclass(frozen=True)
class Campaign:
    """A setting with its true arm; what is hidden comes on top."""

    setting: Setting

    @cached_property
    def visits(self) -> tuple[tuple[Visits, Visits] | None, Visits | None]:
        """Of displacements and of positions."""
        return visits_of(self.setting)

    @cached_property
    def built(self) -> Built:
        """The true arm."""
        return built(self.setting)

    def clean(self, hidden: Hidden, of: Built | None = None, mounted: Sequence[Mounted] = ()) -> tuple[Array, ...]:
        """Readings without noise (V, K, 3) m of each table: displacements, base frame, then positions, tracker's; what
        is mounted beside the markers comes last."""
        arm, x = self.setting.arm, of or self.built
        whole = x.hidden + hidden

        def read(visits: Visits) -> Array:
            return positions(arm, whole, x.compliance, visits, x.markers, mounted)

        both, states = self.visits
        out = [] if both is None else [read(both[1]) - read(both[0])]
        if states is not None:
            out.append(read(states) @ turn(x.station[:3]).T + x.station[3:])
        return tuple(out)

    def whiten(self, tables: Sequence[Array]) -> Array:
        """Readings in units of their noise, in one row; what a visit shares by the inverse root of I + rho^2 1 1'."""
        sigma = _FINE if self.setting.noise == "quantised" else SIGMA
        rho = SHARED / SIGMA if self.setting.noise in VISIT else 0.0
        out: list[Array] = []
        for table in tables:
            own = 1.0 - 1.0 / np.sqrt(1.0 + rho**2 * table.shape[1])
            out.append(((table - own * table.mean(axis=1, keepdims=True)) / sigma).ravel())
        return np.concatenate(out)

    @cached_property
    def fitted(self) -> Array:
        """Orthonormal columns (m, f) of what the fitted parameters can do to the whitened readings."""
        at, steps = self.built.vector, self._steps()
        here = self.whiten(self.clean(Hidden()))
        columns: list[Array] = []
        for i in np.flatnonzero(steps):
            there = self.built.at(at + steps[i] * np.eye(len(at))[i])
            columns.append((self.whiten(self.clean(Hidden(), there)) - here) / steps[i])
        X = np.stack(columns, axis=1)
        X /= np.linalg.norm(X, axis=0).clip(1e-300)
        U, values, _ = np.linalg.svd(X, full_matrices=False)
        return U[:, values > _FLAT * values[0]]

    def _steps(self) -> Array:
        """By how much each number is moved to difference the readings; 0 for those that are not fitted."""
        x, placed = self.built, self.setting.placed
        geometry = float(placed and self.setting.fit == "geometry")
        return np.concatenate(
            [
                0.01 * x.compliance,
                0.01 * x.foot,
                geometry * np.full(x.zeros.size, 1e-5),
                geometry * np.full(x.frames.size, 1e-5),
                placed * np.full(x.markers.size, 1e-4),
                placed * np.full(x.station.size, 1e-5),
            ]
        )

    def added(self, hidden: Hidden) -> Array:
        """What is hidden adds to the whitened readings beyond what the fitted parameters absorb (m,)."""
        more = self.whiten(self.clean(hidden)) - self.whiten(self.clean(Hidden()))
        return more - self.fitted @ (self.fitted.T @ more)

    def s(self, hidden: Hidden) -> float:
        """Its size; NoRest where the arm does not come to rest."""
        return float(np.linalg.norm(self.added(hidden)))

    def sized(self, make: Callable[[float], Hidden], wanted: float, first: float, most: float) -> float:
        """The size up to `most` that shows as `wanted`, within 1 %; Unreachable where none does."""
        low, high = 0.0, np.inf
        size = first
        for _ in range(40):
            try:
                found = self.s(make(size))
            except NoRest:
                found = np.inf
            if abs(found - wanted) <= 0.01 * wanted:
                return size
            low, high = (size, high) if found < wanted else (low, size)
            if low >= most:
                break
            guess = size * float(np.clip(wanted / max(found, 1e-9), 0.1, 10.0))
            size = guess if low < guess < high else 0.5 * (low + high) if np.isfinite(high) else 2.0 * low
            size = min(size, most)
        raise Unreachable


# ---------------------------------------------------------------- noise


def noisy(campaign: Campaign, tables: Sequence[Array]) -> tuple[Array, ...]:
    """Readings as the instrument gives them, m."""
    setting = campaign.setting
    rng = np.random.default_rng([setting.seed, setting.poses, NOISES.index(setting.noise), 3])
    return tuple(table + _noise(setting.noise, table, rng) for table in tables)


def _noise(kind: str, table: Array, rng: np.random.Generator) -> Array:
    """Errors (V, K, 3) m."""
    shape = table.shape
    plain = SIGMA * rng.standard_normal(shape)
    if kind in VISIT:
        return plain + SHARED * rng.standard_normal((shape[0], 1, 3))
    if kind == "growing":  # from 0.4 to 2 times, by the distance from the tracker or by the size of what is read
        far = np.linalg.norm(table, axis=2, keepdims=True)
        return plain * (0.4 + 1.6 * (far - far.min()) / np.ptp(far))
    if kind == "student_t3":
        return SIGMA * rng.standard_t(3, shape)
    if kind == "quantised":
        return np.round((table + _FINE * rng.standard_normal(shape)) / _STEP) * _STEP - table
    if kind == "outliers":
        hit = rng.choice(shape[0] * shape[1], max(1, round(0.05 * shape[0] * shape[1])), replace=False)
        way = rng.standard_normal((len(hit), 3))
        way *= (rng.uniform(10.0, 30.0, len(hit)) / np.linalg.norm(way, axis=1))[:, None] * SIGMA
        plain.reshape(-1, 3)[hit] += way
    return plain


# ---------------------------------------------------------------- files


def write_robot(arm: Arm, folder: Path) -> None:
    """URDF, robot.yaml and nominal.yaml of an arm as its maker describes it."""
    folder.mkdir(parents=True, exist_ok=True)
    text = [f'<robot name="{arm.name}"><link name="base"/>']
    for k, link in enumerate(arm.links, 1):
        i = 0.1 * link.mass
        xyz = " ".join(map(str, link.centre))
        text.append(
            f'<link name="l{k}"><inertial><origin xyz="{xyz}"/><mass value="{link.mass}"/>'
            f'<inertia ixx="{i}" iyy="{i}" izz="{i}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
            f'<joint name="j{k}" type="revolute"><parent link="{"base" if k == 1 else f"l{k - 1}"}"/>'
            f'<child link="l{k}"/><origin xyz="{" ".join(map(str, link.origin))}"/>'
            f'<axis xyz="{" ".join(map(str, link.axis))}"/>'
            '<limit lower="-3.5" upper="3.5" effort="1e5" velocity="2"/></joint>'
        )
    (folder / "arm.urdf").write_text("\n".join([*text, "</robot>"]))
    effects, values = _effects(arm)
    limits: list[str] = []
    for k, link in enumerate(arm.links, 1):
        shown = f"equals: J3 {'-' if arm.sense > 0 else '+'} J2, " if k == 3 and arm.absolute else ""
        limits.append(f"  j{k}: {{{shown}limits_deg: {list(link.limits)}}}")
    lines = [f"name: {arm.name}", f"title: {arm.name}, an arm of another code", "urdf: arm.urdf", "base: base"]
    lines += [f"flange: l{len(arm.links)}", "controller:", *limits, "effects:", *effects]
    lines += ["nominal: nominal.yaml", f"payload_kg: {arm.payload}"]
    (folder / "robot.yaml").write_text("\n".join(lines) + "\n")
    (folder / "nominal.yaml").write_text("\n".join(values) + "\n")


def _effects(arm: Arm) -> tuple[list[str], list[str]]:
    """Lines of robot.yaml and of nominal.yaml."""
    effects: list[str] = []
    if arm.lever:
        effects.append(
            f"  - {{effect: parallelogram, driver: j2, driven: j3, lever_m: {arm.lever}, zero_deg: 90, margin_deg: 5}}"
        )
    effects.append("  - {effect: joint_compliance, joints: all}")
    values = [
        f"joint_compliance[j{k}]: {{value_urad/(N m): {1e6 * c}, sd_percent: 30, source: maker}}"
        for k, c in enumerate(arm.compliance, 1)
    ]
    b = arm.balancer
    if isinstance(b, Coil):
        effects.append(f"  - {{effect: gravity_compensator, joint: j2, lc_m: {b.lc}, l2_m: {b.l2}}}")
        values.append(f"gravity_compensator[j2].stiffness: {{value_N/m: {b.stiffness}, source: maker}}")
        values.append(f"gravity_compensator[j2].free_length: {{value_m: {b.free}, source: maker}}")
    elif b is not None:
        effects.append(
            f"  - {{effect: gas_balancer, joint: j2, lc_m: {b.lc}, l2_m: {b.l2}, length_m: {b.length}, "
            f"pressure_Pa: {b.pressure}, volume_l: {1e3 * b.volume}, piston_area_m^2: {b.area}}}"
        )
    for way in ("rx", "ry") if arm.foot else ():
        effects.append(f"  - {{effect: base_compliance, direction: {way}}}")
        values.append(f"base_compliance[{way}]: {{value_urad/(N m): {1e6 * arm.foot}, sd_percent: 30, source: maker}}")
    return effects, values


def write_campaign(campaign: Campaign, tables: Sequence[Array], folder: Path) -> Path:
    """Write what a user has; the path of the experiment's file."""
    setting = campaign.setting
    arm = setting.described
    write_robot(arm, folder / "robot")
    both, states = campaign.visits
    names = [name for name, has in (("weights.csv", both), ("tracker.csv", states)) if has is not None]
    for name, table in zip(names, tables, strict=True):
        one = states if name == "tracker.csv" else None
        lines = _states(setting, one, table) if one is not None else _displaced(setting, both, table)
        (folder / name).write_text("\n".join(lines) + "\n")
    sigma = 1e3 * STATED.get(setting.noise, SIGMA)
    noise = f"position_sigma_mm: {sigma}, displacement_sigma_mm: {sigma}" if len(names) > 1 else f"sigma_mm: {sigma}"
    if setting.noise == "repeatability":
        noise += f", repeatability_mm: {1e3 * SHARED}"
    lines = ["robot: robot", f"data: {names[0] if len(names) == 1 else '[' + ', '.join(names) + ']'}"]
    lines += [f"load: {{point_mm: {[1e3 * c for c in arm.tool]}}}", "markers:"]
    lines += [f"  m{m}: {{xyz_mm: {[1e3 * c for c in xyz]}}}" for m, xyz in enumerate(arm.markers, 1)]
    lines += [f"noise: {{{noise}}}"]
    if setting.placed:
        geometry = ["geometry"] if setting.fit == "geometry" else []
        fit = ["marker_offset", *geometry, "joint_compliance", *(["base_compliance"] if arm.foot else [])]
        lines += [
            "states: positions",
            "effects:",
            "  - {effect: marker_offset, markers: all}",
            f"fit: [{', '.join(fit)}]",
        ]
    (folder / "experiment.yaml").write_text("\n".join(lines) + "\n")
    return folder / "experiment.yaml"


@dataclass(frozen=True)
class Mount:
    """A reflector, or a gauge along an axis of the base, on a link of the files; where: on the arm."""

    name: str
    link: str
    where: Mounted
    along: str = ""


def add_mounts(path: Path, campaign: Campaign, mounts: Sequence[Mount], moved: Array, first: int) -> None:
    """Write what was mounted beside the markers into the files of a campaign of displacements: moved (V, M, 3) m is
    what it reads at the visits from `first` on, a gauge with an sd of its own."""
    both = campaign.visits[0]
    assert both is not None
    full = both[1]
    lines = [_columns(campaign.setting, ["fx_N", "fy_N", "fz_N", "marker", *(f"d{c}_mm" for c in "xyz"), *_GAUGED])]
    for i, row in enumerate(moved, first):
        pose = _head(campaign.setting, float(full.number[i]), full.shown[i], {})
        head = [*pose, *(f"{f:.8g}" for f in full.force[i])]
        for mount, d in zip(mounts, row, strict=True):
            cells = [f"{1e3 * x:.5f}" for x in d]
            if mount.along:
                way = [float(mount.along == axis) for axis in "xyz"]
                cells = ["", "", "", f"{1e3 * d['xyz'.index(mount.along)]:.5f}", *map(str, way), str(1e3 * GAUGE)]
            lines.append(",".join([*head, mount.name, *cells, *[""] * (8 - len(cells))]))
    (path.parent / "mounted.csv").write_text("\n".join(lines) + "\n")
    text = path.read_text().replace("data: weights.csv", "data: [weights.csv, mounted.csv]")
    if any(m.along for m in mounts):
        text = text.replace("{sigma_mm:", f"{{gauge_sigma_mm: {1e3 * GAUGE}, displacement_sigma_mm:")
    own = [f"  {m.name}: {{link: {m.link}, xyz_mm: {[1e3 * c for c in m.where[1]]}}}" for m in mounts]
    path.write_text(text.replace("\nnoise:", "\n" + "\n".join(own) + "\nnoise:"))


_GAUGED = ("gauge_mm", "ux", "uy", "uz", "sigma_mm")


def _head(setting: Setting, number: float, shown: Array, seen: dict[float, int]) -> list[str]:
    """Pose, repeat and angles of a visit."""
    degrees = [f"{a:.10g}" for a in np.rad2deg(shown)]
    again = [str(seen[number])] if setting.noise == "repeats" else []
    return [f"p{int(number) + 1:02d}", *again, *degrees]


def _columns(setting: Setting, more: Sequence[str]) -> str:
    angles = [f"q{k}_deg" for k in range(1, len(setting.arm.links) + 1)]
    return ",".join(["pose", *(["repeat"] if setting.noise == "repeats" else []), *angles, *more])


def _displaced(setting: Setting, both: tuple[Visits, Visits] | None, table: Array) -> list[str]:
    """readings.csv of displacements."""
    assert both is not None
    empty, full = both
    when = ["time_s", "time_unloaded_s", "temperature_degC", "temperature_unloaded_degC", "approach"]
    when = when if setting.recorded else []
    lines = [_columns(setting, ["fx_N", "fy_N", "fz_N", "marker", "dx_mm", "dy_mm", "dz_mm", *when])]
    seen: dict[float, int] = {}
    for i, moved in enumerate(table):
        number = float(full.number[i])
        seen[number] = seen.get(number, 0) + 1
        head = [*_head(setting, number, full.shown[i], seen), *(f"{f:.8g}" for f in full.force[i])]
        warm = [full.warmth[i] + WARM - 273.15, empty.warmth[i] + WARM - 273.15]
        tail = [f"{v:.4f}" for v in (full.time[i], empty.time[i], *warm)] + [f"{full.side[i]:g}"]
        for m, d in enumerate(moved, 1):
            lines.append(",".join([*head, f"m{m}", *(f"{1e3 * x:.5f}" for x in d), *(tail if when else [])]))
    return lines


def _states(setting: Setting, states: Visits, table: Array) -> list[str]:
    """readings.csv of states."""
    when = ["time_s", "temperature_degC", "approach"] if setting.recorded else []
    lines = [_columns(setting, ["fx_N", "fy_N", "fz_N", "state", "marker", "x_mm", "y_mm", "z_mm", *when])]
    seen: dict[float, int] = {}
    for i, placed in enumerate(table):
        number, loaded = float(states.number[i]), bool(states.loaded[i])
        key = number + 0.5 * loaded
        seen[key] = seen.get(key, 0) + 1
        head = _head(setting, number, states.shown[i], {number: seen[key]})
        head += [f"{f:.8g}" for f in states.force[i]] + ["loaded" if loaded else "unloaded"]
        tail = [f"{states.time[i]:.4f}", f"{states.warmth[i] + WARM - 273.15:.4f}", f"{states.side[i]:g}"]
        for m, p in enumerate(placed, 1):
            lines.append(",".join([*head, f"m{m}", *(f"{1e3 * x:.5f}" for x in p), *(tail if when else [])]))
    return lines


def write(setting: Setting, hidden: Hidden, folder: Path) -> Path:
    """A campaign of an arm in which something is hidden; the path of its experiment."""
    campaign = Campaign(setting)
    return write_campaign(campaign, noisy(campaign, campaign.clean(hidden)), folder)
