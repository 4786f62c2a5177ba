# SPDX-License-Identifier: Apache-2.0
"""Tables I to VII worked out anew from the archive, with NumPy alone, and held against those in its `tables/`.

    python score.py [FOLDER]

It shares no line with the program that wrote the archive. README.md says what the files hold. Points are complex: x + iy, px.
"""

import csv
import sys
from collections.abc import Callable
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

Array = Any  # of NumPy
Row = dict[str, str]
Cells = list[tuple[Any, ...]]
HOW = {"": "ours", "paper-": "to the letter"}
NAMES = ("rrp", "grasp-line", "homography")
WAYS = {"there and back": "R_v E", "first view": "SE", "last frame as prior": "SE prior", "carried on": "SE carried on"}
TOLERANCE = 1e-9
point = "({0.real:.2f}, {0.imag:.2f})".format
SMOOTHING, REACH, RADIUS = 0.012, 0.03, 12  # of curvature and eq. (3): shares of a contour's length, values to a side


def integral(contours: list[Array], f: Callable[[Array], Array], origin: complex) -> Any:
    """Of a cubic polynomial over the material: triangles from an origin to each side, exact quadrature on each."""
    sides = [(c - origin, np.roll(c, -1) - origin) for c in contours]
    rule = ((-27, 1 / 3, 1 / 3), (25, 0.6, 0.2), (25, 0.2, 0.6), (25, 0.2, 0.2))
    return sum(w / 96 * (a.conj() * b).imag @ f(i * a + j * b) for a, b in sides for w, i, j in rule)


def relative(contours: list[Array], contacts: Array) -> str:
    """(d_c, alpha_m, d_1, d_2), 1/px and degrees; I_min points to where the third moments are positive."""
    area = integral(contours, lambda z: z.real * 0 + 1, 0)
    centre = integral(contours, lambda z: z, 0) / area
    axis = np.exp(0.5j * np.angle(integral(contours, lambda z: z**2, centre)))
    skew = integral(contours, lambda z: z * abs(z) ** 2, centre) / axis / area**2.5
    axis *= -1 if skew.real < -1e-9 or (skew.real <= 1e-9 and skew.imag < -1e-9) else 1
    opening, line = abs(contacts[1] - contacts[0]), (contacts[1] - contacts[0]) / abs(contacts[1] - contacts[0])
    foot, turn = (centre - contacts[0]) / line, line / axis
    meets = foot.real + foot.imag * turn.real / turn.imag
    found = -foot.imag / area, np.degrees(np.angle(turn)), -meets / area, (opening - meets) / area
    return "({:z.4f}, {:z.4f}°, {:z.4f}, {:z.4f})".format(*found)


def places(contours: list[Array], contacts: Array) -> list[tuple[int, int]]:
    """(c, p) of the point nearest to the foot of each contact on the outline."""
    found = []
    for q, (c, p) in product(contacts, enumerate(contours)):
        side = np.roll(p, -1) - p
        share = np.clip(((q - p) / side).real, 0, 1)
        gap = abs(p + share * side - q)
        found.append((gap.min(), c, round(gap.argmin() + share[gap.argmin()]) % len(p)))
    return [min(found[k : k + len(contours)])[1:] for k in range(0, len(found), len(contours))]


def curvature(points: Array) -> tuple[Array, Array]:
    """Arc length (N + 1,) and curvature times length (N,): the turn between chords of means over a step, per step."""
    side, start = np.roll(points, -1) - points, points - points[0]
    arc = np.append(0.0, abs(side).cumsum())
    sums = np.append(0.0, (abs(side) * (start + side / 2)).cumsum())

    def summed(s: Array) -> Array:
        laps, rest = np.divmod(s, arc[-1])
        i = np.searchsorted(arc, rest, side="right") - 1
        d = rest - arc[i]
        return laps * sums[-1] + sums[i] + d * (start[i] + d / 2 * (side / abs(side))[i])

    before, after = np.diff([summed(arc[:-1] + k * SMOOTHING * arc[-1]) for k in (-1.5, -0.5, 0.5, 1.5)], 2, axis=0)
    return arc, np.angle(after / before) / SMOOTHING


def matching(letter: bool, one: Array, two: Array, i: int, j: int) -> tuple[float, float, float]:
    """Curvature times length at both samples, and eq. (3): a mean along the arc, to the letter the sum over samples."""
    (s, v), (t, w) = curvature(one), curvature(two)
    if letter:
        n = np.arange(-round(REACH * len(v)), round(REACH * len(v)) + 1)
        there = np.interp(j + len(w) / len(v) * n, np.arange(len(w)), w, period=len(w))
        return v[i], w[j], abs(v[(i + n) % len(v)] / s[-1] * t[-1] - there).sum()
    k = np.arange(-RADIUS, RADIUS + 1) * REACH / RADIUS
    here, there = (np.interp(a[n] / a[-1] + k, a[:-1] / a[-1], c, period=1) for n, a, c in ((i, s, v), (j, t, w)))
    return v[i], w[j], abs(here - there).mean()


def moved(H: Array, z: Array) -> Array:
    """Points through a homography, eq. (2)."""
    x, y, w = H @ (z.real, z.imag, np.ones(len(z)))
    return (x + 1j * y) / w


def homography(z: Array, to: Array) -> Array:
    """(3, 3) of four points, eqs. (1) and (2)."""
    p, none = np.stack([z.real, z.imag, np.ones(4)], 1), np.zeros((4, 3))
    A = np.block([[p, none, -to.real[:, None] * p[:, :2]], [none, p, -to.imag[:, None] * p[:, :2]]])
    return np.append(np.linalg.solve(A, np.append(to.real, to.imag)), 1.0).reshape(3, 3)


def read(path: Path) -> list[Row]:
    """Rows of a CSV file by head."""
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def grouped(rows: list[Row], *by: str) -> dict[tuple[str, ...], list[Row]]:
    """Rows that have these columns in common, in the order in which they come."""
    keys = dict.fromkeys(tuple(r[name] for name in by) for r in rows)
    return {key: [r for r in rows if tuple(r[name] for name in by) == key] for key in keys}


def contacts_of(row: Row, of: str = "") -> Array:
    """(2,) the two contacts of a row, or the given or true ones."""
    return np.array([complex(*(float(row[f"{of}{c}{i}"] or "nan") for c in "xy")) for i in (1, 2)])


def errors(row: Row) -> Array:
    """(2, 3) e_av and e_max of Section V in 1/px, px and per cent of the opening; None of a refusal."""
    true, area = contacts_of(row, "true_"), float(row["area_px2"])
    off, units = abs(contacts_of(row) - true), [1 / area, 1, 100 / abs(true[1] - true[0])]
    return None if row["reason"] else np.outer([off.mean(), off.max()], units)


def tables_of_errors(folder: Path) -> dict[str, Cells]:
    """Tables VI, one for each motion, and VII, for each motion and kind of contours."""
    rows, tables = grouped(read(folder / "transfers.csv"), "table", "contours", "object"), dict[str, Cells]()
    for (table, *names), mine in rows.items():
        courses = {key: [errors(r) for r in c] for key, c in grouped(mine, "strategy", "way").items()}
        for (p, how), (way, error) in product(HOW.items(), WAYS.items()):
            found = [courses[p + s, way] for s in NAMES if (p + s, way) in courses]
            told = [[m for m in course if m is not None] for course in found]
            whole = [np.array([np.mean(c, 0)[0], np.max(c, 0)[1]]) if c else None for c in told]
            half = [c[(len(c) - 1) // 2] for c in found]
            for name, ms in (("R_f E", half if way == "first view" else []), (error, whole)):
                for k, e in enumerate(("e_av", "e_max") if ms else ()):
                    cells = ["refused" if m is None else m[k, u] for u in range(3) for m in ms]
                    tables.setdefault(table, []).append((*names, f"{name} ({e})", how, *cells))
    return tables


def tables_of_views(folder: Path) -> dict[str, Cells]:
    """Tables I, III and IV: descriptions of a grasp in two views; II and V: the correspondences between them."""
    tables: dict[str, Cells] = {number: [] for number in ("I", "III", "IV", "II", "V")}
    load = cache(lambda name: np.loadtxt(folder / "contours" / f"{name}.csv", delimiter=",", skiprows=1))

    def view(r: Row, name: str, frame: int) -> list[Array]:
        table = load("-".join([r["object"], r["contours"], r["motion"], name]).replace(" ", "-"))
        return [table[(table[:, :2] == (frame, c)).all(1), 2:] @ (1, 1j) for c in np.unique(table[:, 1])]

    for r in read(folder / "descriptions.csv"):
        k, given, first = int(r["frame"]), contacts_of(r), r["table"] == "I"
        seen, on = (view(r, outline, k) for outline in ("extracted", r["outline"]))
        off, told = abs(given - contacts_of(r, "true_")), relative(seen, given)
        for i, (at, (c, p)) in enumerate(zip(places(seen, given), places(on, given), strict=True)):
            where = (r["object"], "g1") if first else (r["contours"], r["object"], r["transfer"])
            name, cells = "p'_g" if k else "p_g", (str((c, p // 6, p % 6)), "" if i else told)
            more = cells if first else (str(at), *cells, off[i] if k else None)
            tables[r["table"]].append((*where, f"{name}{i + 1}", *more))
    for (name, how), rs in grouped(read(folder / "correspondences.csv"), "object", "transfer").items():
        frame, given, refined = int(rs[0]["frame"]), contacts_of(rs[0], "given_"), contacts_of(rs[0])
        (one, *_), (two, *_) = (view(rs[0], "extracted", k) for k in (0, frame))
        H = load(f"{name}-rendered-6-DoF-homographies")[frame, 1:].reshape(3, 3)
        p, q = np.array([(one[int(r["sample"])], complex(float(r["x"]), float(r["y"]))) for r in rs]).T
        found = homography(p, q)
        for k, r in enumerate(rs):
            i, j, off = int(r["sample"]), int(r["match"]), abs(q - moved(H, p))[k]
            v, w, error = matching(how != "ours", one, two, i, j)
            row = f"p_{k + 1}", f"{point(p[k])}, {i}", v, f"{point(q[k])}, {j}", w, error, off
            tables["II"].append((name, how, *row))
            tables["V"].append((name, how, f"p_{k + 1} and p'_{k + 1}", point(p[k]), point(q[k]), off))
        for k, row in enumerate(found, 1):
            tables["V"].append((name, how, f"H, row {k}", " ".join(f"{v:.6g}" for v in row), "", None))
        for (step, ends), k in product((("H p_g", moved(found, given)), ("refined p'_g", refined)), (0, 1)):
            off = abs(ends - moved(H, given))[k]
            tables["V"].append((name, how, f"{step}{k + 1}", point(given[k]), point(ends[k]), off))
    return tables


def difference(mine: Cells, told: list[list[str]]) -> float:
    """The largest of the tables' numbers, relative beyond 1; infinite where texts differ."""
    cells = zip((c for r in mine for c in r), (c for r in told for c in r), strict=True)
    same = (abs(c - float(b)) / max(1, abs(c)) if isinstance(c, float) else b == (c or "") or np.inf for c, b in cells)
    return max((worst for worst in same if worst is not True), default=0.0)


def score(folder: Path) -> dict[str, float]:
    """The difference by table; rows of the paper's own print and of refusals are left out."""
    made = tables_of_views(folder) | tables_of_errors(folder)
    told = {n: [list(r.values()) for r in read(folder / "tables" / f"{n}.csv")] for n in made}
    kept = {n: [r for r in rows if r[0] != "paper" and "refused: " not in "".join(r)] for n, rows in told.items()}
    return {n: difference(rows, kept[n]) for n, rows in made.items()}


if __name__ == "__main__":
    found = score(Path(sys.argv[1]) if sys.argv[1:] else Path(__file__).parent)
    print("\n".join(f"Table {number}: equal to {worst:.0e}" for number, worst in found.items()))
    sys.exit(int(max(found.values()) > TOLERANCE))
