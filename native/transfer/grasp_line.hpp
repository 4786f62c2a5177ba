// SPDX-License-Identifier: Apache-2.0
// Grasp-line coordinates (Sections III-B and IV-B).
#pragma once

#include "../geometry/moments.hpp"
#include "../geometry/places.hpp"

namespace grasptrack {

// The coordinates of a grasp line, and what they are measured in.
struct GraspLine {
    double d_c, alpha_m, d_1, d_2;
};

struct DescribedLine {
    GraspLine line;
    double sine, opening;
};

inline DescribedLine grasp_line(const Moments &frame, Vec first, Vec second) {
    const double opening = length(second - first), root = std::sqrt(frame.area);
    const Vec u = (1 / opening) * (second - first), e{std::cos(frame.angle), std::sin(frame.angle)};
    const Vec centroid = Vec{frame.x, frame.y} - first;
    const double sine = cross(e, u), cosine = dot(e, u), along = dot(centroid, u), left = cross(centroid, u);
    // Along the line, I_min passes the centroid's foot by left * cot(alpha).
    const double meets = along - left * cosine / sine;
    return {{left / root, std::atan2(sine, cosine), -meets / root, (opening - meets) / root}, sine, opening};
}

struct LineReference {
    double area, cx, cy, theta;
};

// contacts is (2, 2), H (3, 3). `ahead` is where I_min is expected to point. Gives the residual.
inline double carry_grasp_line(const Outline &outline, const Moments &frame, const GraspLine &line,
                               const LineReference &reference, Vec ahead, Vec *contacts, double *H) {
    constexpr double pi = 3.14159265358979323846;
    double theta = frame.angle;
    if (!(dot(ahead, {std::cos(theta), std::sin(theta)}) > 0)) theta += pi;
    const double root = std::sqrt(frame.area);
    const Vec centroid{frame.x, frame.y}, e{std::cos(theta), std::sin(theta)};
    const double cosine = std::cos(line.alpha_m), sine = std::sin(line.alpha_m);
    const Vec u{e.x * cosine - e.y * sine, e.y * cosine + e.x * sine};
    // From the centroid along I_min to where the line of that d_c crosses it.
    const Vec q = centroid + (-line.d_c * root / sine) * e;
    Nearest a{line.d_1 * root}, b{line.d_2 * root};
    for_each_crossing(outline, {q, u}, [&](std::size_t, double, double t) { a.offer(t), b.offer(t); });
    contacts[0] = q + a.t * u;
    contacts[1] = q + b.t * u;
    const double scale = root / std::sqrt(reference.area), turn = theta - reference.theta;
    const double c = scale * std::cos(turn), s = scale * std::sin(turn);
    const double rows[] = {c, -s, centroid.x - c * reference.cx + s * reference.cy,
                           s, c,  centroid.y - s * reference.cx - c * reference.cy,
                           0, 0,  1};
    std::copy(rows, rows + 9, H);
    if (a.t == b.t) return std::numeric_limits<double>::infinity();
    return std::isnan(a.t) ? a.t : std::max(a.gap, b.gap);
}

}  // namespace grasptrack
