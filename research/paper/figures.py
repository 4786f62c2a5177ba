# SPDX-License-Identifier: Apache-2.0
"""Figures 4 to 11 of the paper drawn anew from a run, and the pairs of views behind Tables II to V."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from grasptrack.geometry.contours import View
from grasptrack.geometry.homographies import apply_homography
from grasptrack.grasp.contacts import Grasp
from grasptrack.images import Grey
from grasptrack.transfer import rrp, transfer
from grasptrack.transfer.rrp import INTERPOLATED
from grasptrack.typing import Floats
from grasptrack.view.style import DARK, INK, create_figure
from grasptrack_bench.baselines.literal import LiteralHomography
from research.paper.correspondences import Correspondences
from research.paper.drawing import (
    GRASP,
    PEAK,
    REFERENCE,
    TRUTH,
    WIDE,
    Picture,
    closed,
    draw_contact,
    draw_image,
    draw_label,
    draw_line,
    draw_matches,
    draw_outline,
    draw_references,
    draw_truth,
    frame_axes,
    shown_view,
    to_picture,
    worst_px,
)
from research.paper.footage import Footage
from research.paper.objects import ObjectRuns
from research.paper.principles import draw_grasp_line, figure_five, figure_six, figure_ten
from research.paper.transfers import Refused


def paper_figures(told: ObjectRuns) -> Iterator[tuple[str, Picture]]:
    """Names and pictures, each with its caption; a figure whose transfer was refused is left out."""
    images, frame = told.images, told.frame
    rendered = [f for f in told.examples if f.kind == "rendered"]
    seen = [f for f in rendered if isinstance(f.tracked[frame], View)]
    if seen:
        yield "paper-fig-4", figure_four(max(seen, key=lambda f: _widest_bulge(f)[0]))
        yield "paper-fig-5", figure_five((seen[0], seen[-1]))
        yield "paper-fig-6", figure_six(seen[0], frame)
        yield "paper-fig-7", figure_seven(seen[0], images[seen[0].part.name, seen[0].motion], frame)
    for f in rendered:
        if (drawn := figure_eight(f, images[f.part.name, f.motion], frame)) is not None:
            yield "paper-fig-8", drawn
            break
    found = [c for c in told.pairs if isinstance(c, Correspondences) and c.transfer == "ours"]
    if found:
        c = found[0]
        yield "paper-fig-9", figure_nine(c, images[c.footage.part.name, c.footage.motion])
    letter = [c for c in told.pairs if isinstance(c, Correspondences) and c.transfer != "ours"]
    if letter:
        yield "paper-fig-10", figure_ten(letter[0])
    sampled = [f for f in told.footage if (f.kind, f.motion) == ("resampled", "6 DoF")]
    if (refined := figure_eleven(sampled)) is not None:
        yield "paper-fig-11", refined


def table_pictures(told: ObjectRuns) -> Iterator[Picture]:
    """Captions and pictures of the pairs of Tables II to V; refused pairs have none."""
    images, frame = told.images, told.frame
    rendered = [f for f in told.examples if f.kind == "rendered" and isinstance(f.tracked[frame], View)]
    found = [c for c in told.pairs if isinstance(c, Correspondences) and c.transfer == "ours"]
    pairs = [(c, images[c.footage.part.name, c.footage.motion]) for c in found]
    for c, seen in pairs:
        yield (
            f"Table II, {c.footage.part.name}: points and correspondences, with the curvature",
            figure_of_matches(c, seen),
        )
    for f in rendered:
        _, picture = figure_seven(f, images[f.part.name, f.motion], frame)
        yield f"Table III, {f.part.name}: the outline that the snake moved, the grasp, true places crossed", picture
    for f in rendered:
        if (drawn := figure_eight(f, images[f.part.name, f.motion], frame)) is not None:
            yield f"Table IV, {f.part.name}: the grasp line beside the inertia axes, true places crossed", drawn[1]
    for c, seen in pairs:
        _, picture = figure_nine(c, seen)
        yield f"Table V, {c.footage.part.name}: the homography applied and refined, true places crossed", picture


def figure_of_matches(c: Correspondences, images: Sequence[Grey]) -> NDArray[np.uint8]:
    """Selected points and what matches them, above the curvature of both contours along them."""
    figure = create_figure(WIDE, 5.0, layout="constrained")
    above, below = figure.subplots(2, 2, height_ratios=(3, 1))
    titles = "frame 0: selected points", f"frame {c.frame}: correspondences"
    for k, (axes, curve) in enumerate(zip(above, below, strict=True)):
        draw_matches(axes, images[k], (c.first, c.second)[k], c.points[k], titles[k])
        values, marks = c.curvature[k], c.samples[k]
        curve.plot(values, color=DARK, lw=1.0)
        curve.plot(marks, values[marks], "o", color=PEAK, ms=5)
        for number, i in enumerate(marks, start=1):
            curve.annotate(str(number), (i, values[i]), xytext=(5, 3), textcoords="offset points", fontsize=8)
        curve.set_xlabel("curvature along the outer contour, from its first point", fontsize=8.5, color=INK)
    return to_picture(figure)


def figure_four(footage: Footage) -> Picture:
    """RRP coordinates: reference points of the tracked outline, and the points interpolated between two of them."""
    view = shown_view(footage.tracked[0])
    points = view.outer.points
    references = points[::INTERPOLATED]
    figure = create_figure(WIDE, 3.5, layout="constrained")
    whole, close = figure.subplots(1, 2)
    draw_outline(whole, view)
    grasp = Grasp(footage.on_tracked)
    draw_references(whole, references, grasp.contacts)
    for at, label in zip(grasp.contacts, _coordinates(grasp, view), strict=True):
        draw_contact(whole, at, label, references.mean(axis=0))
    frame_axes(whole, points, "reference points, and the grasp's (c, ref, interp)", 0.2)
    gap, ref = _widest_bulge(footage)
    side = points[np.arange(ref * INTERPOLATED, (ref + 1) * INTERPOLATED + 1) % len(points)]
    share = np.linspace(0.0, 1.0, INTERPOLATED + 1)[:, None]
    chord = side[0] + share * (side[-1] - side[0])
    close.plot(
        *points[np.arange(-INTERPOLATED, 2 * INTERPOLATED + 1) + ref * INTERPOLATED - len(points)].T, color=DARK, lw=1.2
    )
    close.plot(*chord.T, "o--", color=TRUTH, ms=4, lw=1.0, label="interpolated on the segment, as in the paper")
    close.plot(*side[1:-1].T, "o", color=DARK, ms=4, label="interpolated on the outline, as here")
    close.plot(*side[[0, -1]].T, "o", color=REFERENCE, ms=8, mec=DARK)
    for k, name in ((0, f"ref = {ref}"), (-1, f"ref = {(ref + 1) % len(references)}")):
        draw_label(close, side[k], name, chord.mean(axis=0), size=9, gap=30)
    for k, at in enumerate(side[1:-1], start=1):
        draw_label(close, at, str(k), chord[k], size=8, gap=11)
    frame_axes(close, side, f"the segment where both differ most, by {gap:.1f} px", 0.35)
    close.legend(loc="lower left", fontsize=7.5, framealpha=0.9)
    return f"Fig. 4, {footage.part.name}: RRP coordinates of contour points", to_picture(figure)


def figure_seven(footage: Footage, images: Sequence[Grey], frame: int) -> Picture:
    """RRP transfer: the same coordinates on the outline that the snake moved."""
    figure = create_figure(WIDE, 3.5, layout="constrained")
    first, second = shown_view(footage.tracked[0]), shown_view(footage.tracked[frame])
    moved = transfer(Grasp(footage.on_tracked), first, second, "rrp").grasp
    truth = footage.truth("rrp", frame)
    panels = ((0, first, Grasp(footage.on_tracked), None), (frame, second, moved, truth))
    for axes, image, (k, view, grasp, true) in zip(figure.subplots(1, 2), images, panels, strict=True):
        draw_image(axes, image)
        draw_outline(axes, view)
        references = view.outer.points[::INTERPOLATED]
        draw_references(axes, references, grasp.contacts)
        draw_truth(axes, true)
        for at, label in zip(grasp.contacts, _coordinates(grasp, view), strict=True):
            draw_contact(axes, at, label, references.mean(axis=0))
        off = "" if true is None else f", off by {worst_px(grasp.contacts, true):.3f} px"
        frame_axes(axes, view.points, f"frame {k}{off}", 0.2)
    return f"Fig. 7, {footage.part.name}: the same RRP coordinates on the outline that the snake moved", to_picture(
        figure
    )


def figure_eight(footage: Footage, images: Sequence[Grey], frame: int) -> Picture | None:
    """Grasp-line transfer: the line relative to the inertia axes; None where it was refused."""
    first, second = footage.silhouettes[0], footage.silhouettes[frame]
    if not isinstance(first, View) or not isinstance(second, View):
        return None
    try:
        moved = transfer(Grasp(footage.on_silhouette), first, second, "grasp-line").grasp
    except Refused:
        return None
    figure = create_figure(WIDE, 4.6, layout="constrained")
    panels = (
        (0, first, Grasp(footage.on_silhouette), None),
        (frame, second, moved, footage.truth("grasp-line", frame)),
    )
    for axes, image, (k, view, grasp, true) in zip(figure.subplots(1, 2), images, panels, strict=True):
        draw_image(axes, image)
        described = draw_grasp_line(axes, view, grasp)
        draw_truth(axes, true)
        root = math.sqrt(described.area)
        d_c, alpha, d_1, d_2 = described.paper()
        off = "" if true is None else f", off by {worst_px(grasp.contacts, true):.3f} px"
        frame_axes(axes, view.points, f"frame {k}{off}", 0.16)
        printed = f"over the area, as printed: ({d_c:.4f}, {alpha:.4f}°, {d_1:.4f}, {d_2:.4f})"
        own = ", ".join(f"{v * root:.4f}" for v in (d_c, d_1, d_2))
        axes.set_xlabel(f"{printed}\n" + r"$d_c, d_1, d_2$ over its root: " + own, fontsize=8.5, color=INK)
    return f"Fig. 8, {footage.part.name}: the grasp line beside the inertia axes", to_picture(figure)


def figure_nine(c: Correspondences, images: Sequence[Grey]) -> Picture:
    """The four steps of the homography transfer."""
    figure = create_figure(WIDE, 6.6, layout="constrained")
    (one, two), (three, four) = figure.subplots(2, 2)
    for axes, image, view, points, title in (
        (one, images[0], c.first, c.points[0], "1. frame 0: four points are selected"),
        (two, images[1], c.second, c.points[1], f"1. frame {c.frame}: and found again, eq. (3)"),
    ):
        draw_matches(axes, image, view, points, title)
    grasp = c.footage.on_silhouette
    one.plot(*grasp.T, "o", color=GRASP, mec=DARK, ms=7)
    draw_outline(three, c.second)
    for contour in c.first.contours:
        carried = apply_homography(c.H, contour.points)
        three.plot(*closed(carried).T, "--", color=PEAK, lw=1.5)
    three.plot([], [], "--", color=PEAK, label="first contour through H")
    three.plot([], [], color=DARK, label="second contour")
    three.plot(*c.applied.T, "o", mfc="none", mec=TRUTH, mew=1.6, ms=11, label="grasp through H")
    three.legend(loc="upper center", bbox_to_anchor=(0.5, -0.01), ncols=3, fontsize=8, frameon=False, columnspacing=1.0)
    frame_axes(three, c.second.points, "2. and 3. H is computed and applied")
    draw_image(four, images[1])
    draw_outline(four, c.second)
    draw_line(four, c.refined)
    four.plot(*c.refined.T, "o", color=GRASP, mec=DARK, ms=7)
    truth = c.footage.truth("homography", c.frame)
    draw_truth(four, truth)
    frame_axes(
        four,
        c.second.points,
        f"4. refined: off by {worst_px(c.refined, truth):.2f} px, {worst_px(c.applied, truth):.2f} before",
    )
    return f"Fig. 9, {c.footage.part.name}: the four steps of the homography transfer", to_picture(figure)


def figure_eleven(sampled: Sequence[Footage]) -> Picture | None:
    """The refinement to the letter, at the pair of views whose correction is the median of all that were answered."""
    letter, plain = LiteralHomography(), LiteralHomography(refined=False)
    pairs: list[tuple[float, Footage, int, Floats, Floats]] = []
    for f in sampled:
        first = shown_view(f.silhouettes[0])
        description = letter.describe(Grasp(f.on_silhouette), first)
        for k, view in enumerate(f.silhouettes[1:], start=1):
            try:
                refined = letter.apply(description, shown_view(view)).grasp.contacts
                applied = plain.apply(description, shown_view(view)).grasp.contacts
            except Refused:
                continue
            pairs.append((worst_px(refined, applied), f, k, applied, refined))
    if not pairs:
        return None
    pairs.sort(key=lambda p: p[0])
    corrected, f, k, applied, refined = pairs[len(pairs) // 2]
    view, truth = shown_view(f.silhouettes[k]), f.truth("paper-homography", k)
    figure = create_figure(WIDE, 3.3, layout="constrained")
    whole, *close = figure.subplots(1, 3)
    reach = max(2.0, 1.5 * max(worst_px(refined, applied), worst_px(refined, truth)))
    for axes in (whole, *close):
        draw_outline(axes, view)
        draw_line(axes, refined)
        axes.plot(*applied.T, "o", mfc="none", mec=TRUTH, mew=1.6, ms=11, label="through H")
        axes.plot(*refined.T, "o", color=GRASP, mec=DARK, ms=7, label="refined")
        axes.plot(*truth.T, "x", color=TRUTH, mew=2.0, ms=8, label="true place")
    frame_axes(whole, view.points, f"frame {k}, corrected by {corrected:.2f} px")
    figure.legend(*whole.get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=8.5, frameon=False)
    for i, axes in enumerate(close):
        before, after = (float(np.hypot(*(p[i] - truth[i]))) for p in (applied, refined))
        frame_axes(
            axes,
            refined[i] + np.array([[-reach, -reach], [reach, reach]]),
            f"contact {i + 1}: {before:.2f} px off, then {after:.2f}",
            0.0,
        )
    return (
        f"Fig. 11, {f.part.name}: the refinement to the letter, at the pair of views of the median correction",
        to_picture(figure),
    )


def _widest_bulge(footage: Footage) -> tuple[float, int]:
    """px and reference point of the segment from which the outline is farthest."""
    points = shown_view(footage.tracked[0]).outer.points
    gaps = []
    for ref in range(len(points) // INTERPOLATED):
        side = points[np.arange(ref * INTERPOLATED, (ref + 1) * INTERPOLATED + 1) % len(points)]
        chord = side[0] + np.linspace(0.0, 1.0, INTERPOLATED + 1)[:, None] * (side[-1] - side[0])
        gaps.append(float(np.hypot(*(side - chord).T).max()))
    return max(gaps), int(np.argmax(gaps))


def _coordinates(grasp: Grasp, view: View) -> list[str]:
    return [str(place) for place in rrp.describe(grasp, view).paper()]
